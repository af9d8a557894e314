"""Makes the priors of `simulation_prior`: `python -m agents.rivals.train --out FILE`.

In each of many simulated worlds the arm moves at random for many objects, and noise-free image points are
fitted by polynomials. Their mean and principal components over all worlds are the prior.
"""

import argparse
import platform
import time
from importlib.metadata import version
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

from ..base.observation import Array
from .prior import MOUNTS, Prior, features, save_priors

EXTENT = 0.9
"""The arm moves between such registers (wild motors: the work space lies within)."""
FAR = 1.3
"""Image points farther out are left out: a camera behind a point sees it anywhere. Choice."""
RIDGE = 1e-5
"""Of the fit in a world, to each look. Choice."""
FEW = 100
"""A world in which fewer looks are left is left out. Choice."""
OUTLYING = 4.0
"""And one where a coefficient is so many times farther from its mean than is usual (median). Choice."""


def look_around(
    worlds: range, mount: str, objects: int, motions: int, rng: np.random.Generator
) -> tuple[Array, Array, Array]:
    """Random motions in simulated wild worlds.

    Args:
        worlds: Their seeds, w.
        mount: What the cameras are fixed to.
        objects: So many, one after the other.
        motions: For each, from home on.
        rng: Draws the motions.

    Returns:
        Registers (w, n, 3), objects' home views (w, n, 4), and image points (w, n, 2, 4), all free of noise.
    """
    env: Any = gym.make_vec(
        "calfree_gym:CalFree/Reach-v0",
        num_envs=len(worlds),
        world="wild",
        camera_mount=mount,
        dynamics="kinematic",
        terminate_on_success=False,
        max_episode_steps=2**31,
        autoreset_mode=AutoresetMode.DISABLED,
        threads=1,
    ).unwrapped
    looks = []
    for trial in range(objects):
        _, infos = env.reset(seed=list(worlds) if trial == 0 else None)
        home = infos["truth"]["points"].reshape(-1, 2, 4)[:, 1]
        registers = np.zeros((len(worlds), env.single_action_space.shape[0]))
        for _ in range(motions):
            words = rng.uniform(-EXTENT, EXTENT, registers.shape) - registers
            observation, *_, infos = env.step(words.clip(-1, 1).astype(np.float32))
            registers = observation["observation"][:, 4:].astype(float)
            looks.append((registers, home, infos["truth"]["points"].reshape(-1, 2, 4)))
    registers, homes, points = (np.stack(each, 1) for each in zip(*looks, strict=True))
    return registers, homes, points


def fit(registers: Array, homes: Array, points: Array) -> Array | None:
    """Coefficients (`TERMS`, 4) of both polynomials in one world; None where too little is in view."""
    coefficients = []
    targets = (points[:, 0], points[:, 1] - homes)
    for part, (terms, target) in enumerate(zip(features(registers, homes), targets, strict=True)):
        near = np.abs(points[:, part]).max(1) < FAR
        if near.sum() < FEW:
            return None
        normal = terms[near].T @ terms[near] + RIDGE * near.sum() * np.eye(terms.shape[1])
        coefficients.append(np.linalg.solve(normal, terms[near].T @ target[near]))
    return np.concatenate(coefficients)


def prior_of(fits: Array, components: int) -> Prior:
    """The prior by the coefficients (w, `TERMS`, 4) of many worlds, with so many components."""
    flat = fits.reshape(len(fits), -1)
    farthest = np.abs(flat - flat.mean(0)).max(1)
    flat = flat[farthest < OUTLYING * np.median(farthest)]
    mean = flat.mean(0)
    _, sizes, ways = np.linalg.svd(flat - mean, full_matrices=False)
    shape = fits.shape[1:]
    basis = ways[:components].T.reshape(*shape, -1)
    return Prior(mean.reshape(shape), basis, sizes[:components] / np.sqrt(len(flat)))


def main(arguments: list[str] | None = None) -> None:
    """Reads the command line, simulates, and writes the file."""
    parser = argparse.ArgumentParser(
        prog="python -m agents.rivals.train", description="Makes the priors of simulation_prior."
    )
    parser.add_argument("--out", required=True, help="file of priors, .npz")
    parser.add_argument("--seed", type=int, default=0, help="of motions")
    parser.add_argument("--worlds-from", type=int, default=900_000, help="seed of the first training world")
    parser.add_argument("--worlds", type=int, default=600, help="how many; the same ones for each mount")
    parser.add_argument("--objects", type=int, default=40, help="in each world")
    parser.add_argument("--motions", type=int, default=10, help="for each object")
    parser.add_argument("--components", type=int, default=120, help="of the coefficients that are kept")
    given = parser.parse_args(arguments)

    worlds = range(given.worlds_from, given.worlds_from + given.worlds)
    priors, used = {}, {}
    for mount in MOUNTS:
        rng = np.random.default_rng(given.seed)
        looks = look_around(worlds, mount, given.objects, given.motions, rng)
        fits = [found for each in zip(*looks, strict=True) if (found := fit(*each)) is not None]
        priors[mount], used[mount] = prior_of(np.array(fits), given.components), len(fits)
        print(f"{mount}: {len(fits)} worlds, {time.process_time():.0f} CPU seconds", flush=True)
    settings = {key: value for key, value in vars(given).items() if key != "out"}
    command = " ".join(f"--{key.replace('_', '-')} {value}" for key, value in settings.items())
    training = {
        "command": f"python -m agents.rivals.train {command} --out FILE",
        **settings,
        "world": "wild, kinematic",
        "worlds_used": used,
        "cpu_seconds": round(time.process_time(), 1),
        "versions": {
            "python": platform.python_version(),
            **{name: version(name) for name in ("numpy", "gymnasium", "mujoco")},
        },
    }
    save_priors(given.out, priors, training)


if __name__ == "__main__":
    main()
