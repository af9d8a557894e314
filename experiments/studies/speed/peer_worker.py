"""Times any Gymnasium environment, under whatever interpreter has it: `PYTHON -c THIS ENV_ID`.

It imports nothing of ours, nothing beside gymnasium and what registers the environment, and runs under Python
3.8 and later. It answers in lines of JSON: first what the environment is; then, for every line "STEPS" on its
input, the seconds that this many environment steps of random actions took; for a line "ppo", how long PPO of
stable-baselines3 takes to reach, where it is installed. An answer may also be an error.
"""

from __future__ import annotations

import json
import os
import sys
import time
from importlib.metadata import PackageNotFoundError, version
from typing import Any

REGISTER = ("panda_gym", "gymnasium_robotics")
ENVPOOL, ROWS = "envpool:", 64
"""Of ids that EnvPool knows, which steps so many rows together."""


def make(env_id: str) -> Any:
    """The environment, once the packages that may have it are registered; of EnvPool rows, on one thread."""
    import gymnasium

    if env_id.startswith(ENVPOOL):
        import envpool

        return envpool.make_gymnasium(env_id[len(ENVPOOL) :], num_envs=ROWS, num_threads=1, seed=0)

    without = []
    for package in REGISTER:
        try:
            module = __import__(package)
        except Exception as error:  # not installed, or not with these versions of others
            without.append(f"; {package}: {error}")
            continue
        if hasattr(gymnasium, "register_envs"):
            gymnasium.register_envs(module)
    try:
        return gymnasium.make(env_id)
    except gymnasium.error.Error as error:
        hint = "" if ":" in env_id else f"; where importing MODULE registers it, say MODULE:{env_id}"
        raise LookupError(f"{error}{''.join(without)}{hint}") from None


def substeps_and_timestep(env: Any) -> tuple[int | None, float | None]:
    """Physics substeps in a step and seconds in a substep, or Nones where they are not known."""
    base = env.unwrapped
    sim: Any = getattr(base, "sim", None)
    if hasattr(sim, "n_substeps"):  # panda-gym
        return int(sim.n_substeps), float(sim.timestep)
    model: Any = getattr(base, "model", None)
    substeps = getattr(base, "frame_skip", getattr(base, "n_substeps", None))
    if substeps and hasattr(model, "opt"):  # MuJoCo environments of gymnasium and gymnasium-robotics
        return int(substeps), float(model.opt.timestep)
    return None, None


def versions() -> dict[str, str]:
    """Versions of the interpreter, and of what an environment's speed depends on, where it is loaded."""
    found = {"python": sys.version.split()[0]}
    for package in ("gymnasium", "numpy", "mujoco", "pybullet", "envpool", *REGISTER):
        if package in sys.modules:
            try:
                found[package] = version(package)
            except PackageNotFoundError:
                found[package] = "unknown"
    return found


def seconds(env: Any, steps: int) -> float:
    """Makes environment steps; how long they took, without the resets between."""
    actions, total = [_action(env) for _ in range(steps)], 0.0
    for action in actions:
        start = time.perf_counter()
        _, _, terminated, truncated, _ = env.step(action)
        total += time.perf_counter() - start
        if rows(env) == 1 and (terminated or truncated):  # rows begin anew by themselves
            env.reset()
    return total


def rows(env: Any) -> int:
    """How many it steps together."""
    return int(getattr(env, "num_envs", 1))


def _action(env: Any) -> Any:
    import numpy as np

    one = env.action_space.sample
    return one() if rows(env) == 1 else np.stack([one() for _ in range(rows(env))])


ROLLOUT, SHARE, MOST_MOTIONS = 2048, 0.9, 300_000


def reached_by_ppo(env: Any) -> dict[str, Any]:
    """How long PPO takes until so many of its last 100 trials reach, on one thread.

    Args:
        env: A goal environment, or a `VecEnv` of stable-baselines3 with such rows.

    Returns:
        Seconds, motions of all rows, and whether so many reached before it was given up; nothing where
        there are no goals, or no stable-baselines3.
    """
    if "desired_goal" not in getattr(env.observation_space, "spaces", ()):
        return {}
    try:
        import torch
        from stable_baselines3 import PPO
    except ImportError:
        return {}
    torch.set_num_threads(1)
    model = PPO(
        "MultiInputPolicy",
        env,
        n_steps=ROLLOUT // getattr(env, "num_envs", 1),
        batch_size=512,
        gamma=0.9,
        policy_kwargs={"log_std_init": -2.0},
        seed=0,
        device="cpu",
    )

    def goes_on(*_: Any) -> bool:
        successes = model.ep_success_buffer or ()
        return len(successes) < 100 or sum(successes) < 100 * SHARE

    start = time.perf_counter()
    model.learn(MOST_MOTIONS, callback=goes_on)
    took = time.perf_counter() - start
    return {"seconds": took, "motions": model.num_timesteps, "reached": not goes_on()}


def main(env_id: str) -> None:
    """Answers until its input ends; what others print goes to the error stream."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)

    def answer(found: dict[str, Any]) -> None:
        print(json.dumps(found), file=answers, flush=True)

    try:
        env = make(env_id)
        env.reset(seed=0)
        env.action_space.seed(0)
        substeps, timestep = substeps_and_timestep(env)
        answer({"substeps": substeps, "timestep": timestep, "rows": rows(env), "versions": versions()})
        for line in sys.stdin:
            answer(reached_by_ppo(env) if line == "ppo\n" else {"seconds": seconds(env, int(line))})
    except Exception as error:
        answer({"error": " ".join(f"{type(error).__name__}: {error}".split())})


if __name__ == "__main__":
    main(sys.argv[1])
