"""FetchReach, somebody else's environment, whose camera is turned: what that costs four policies.

It runs where gymnasium-robotics does: with MuJoCo below 3.11, which has no `mujoco.batch`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import agents
from calfree_gym.geometry import Array, looking_at, rotation_matrix
from calfree_gym.perturb import FixedCamera, StereoPoints, Words, paired
from experiments.reporting.tables import Table

CAMERA, FOVY = "external_camera_0", 60.0
"""The camera that is turned, and the field of view of both (degrees): by 20°, it still sees most goals."""
_BESIDE, _GRIPPER_AT_HOME = np.array([1.35, 1.75, 0.9]), np.array([1.34, 0.75, 0.53])
SIDE = FixedCamera(_BESIDE, looking_at(_BESIDE, _GRIPPER_AT_HOME), FOVY)
"""The camera that stands still."""
WORDS = Words((0, 1, 2), steps=5, settle=4)
REACH = 0.05 * WORDS.steps
"""Metres that a word of 1 moves the gripper."""
NOISE_PX = 0.5
GRIPPER = "robot0:grip"
SUCCESS = 0.02
"""Within so many metres when the 50 steps of the environment are over."""
EPISODES, DEMONSTRATED = 100, 150
FIRST_DEMONSTRATION = 10_000
"""Seed of the first one; those of the episodes are below."""
MIDDLE = 25
"""Steps of the environment."""


def _aim(degrees: float, step: int = 0) -> list[dict[str, Any]]:
    return [{"at": {"step": step}, "do": {"type": "camera_aim", "camera": CAMERA, "degrees": degrees}}]


SCHEDULES = {
    "as built": [],
    "5°": _aim(5),
    "10°": _aim(10),
    "20°": _aim(20),
    "10° in mid-episode": _aim(10, MIDDLE),
}


def fetch() -> gym.Env[Any, Any]:
    """FetchReach, with a wider lens."""
    import gymnasium_robotics

    gym.register_envs(gymnasium_robotics)
    env = gym.make("FetchReach-v4")
    env.unwrapped.model.camera(CAMERA).fovy = FOVY  # type: ignore[attr-defined]
    return env


def points_of(env: gym.Env[Any, Any]) -> gym.Env[Any, Any]:
    """As all four policies see it."""
    return StereoPoints(
        env,
        GRIPPER,
        lambda env: env.unwrapped.goal,  # type: ignore[attr-defined]
        (CAMERA, SIDE),
        WORDS,
        registers=_registers,
        noise_px=NOISE_PX,
        terminate_on_success=False,
    )


def _registers(env: gym.Env[Any, Any]) -> Array:
    """Where the gripper stands, as joints tell it, in words from home (3,); words fall short by a third."""
    made: Any = env.unwrapped
    return np.asarray((made.data.site(GRIPPER).xpos - made.initial_gripper_xpos) / REACH)


def succeeded(env: gym.Env[Any, Any], info: Mapping[str, Any]) -> bool:
    """Whether the gripper is at the goal."""
    made: Any = env.unwrapped
    return bool(np.linalg.norm(made.data.site(GRIPPER).xpos - made.goal) < SUCCESS)


class Calibrated:
    """Hand-eye calibrated as built: finds the goal by stereo; its registers tell where the gripper is."""

    def __init__(self) -> None:
        env: Any = fetch()
        env.reset(seed=0)
        built = env.unwrapped.data.camera(CAMERA)
        self._home = env.unwrapped.initial_gripper_xpos.copy()
        self._poses = (
            (built.xpos.copy(), built.xmat.reshape(3, 3).copy()),
            (np.array(SIDE.position), rotation_matrix(np.array(SIDE.orientation))),
        )
        self._half = np.tan(np.radians(FOVY) / 2)
        env.close()

    def __call__(self, observation: Mapping[str, Array]) -> Array:
        """Words (3,) that lead to the goal."""
        here = self._home + REACH * observation["observation"][4:]
        return np.asarray(np.clip((self._goal(observation["desired_goal"]) - here) / REACH, -1, 1))

    def _goal(self, points: Array) -> Array:
        """The place (3,) that is nearest to both lines of sight."""
        normal, right = np.zeros((3, 3)), np.zeros(3)
        for (position, axes), (x, y) in zip(self._poses, points.reshape(2, 2).astype(float), strict=True):
            sight = axes @ [self._half * x, -self._half * y, -1]
            across = np.eye(3) - np.outer(sight, sight) / (sight @ sight)
            normal, right = normal + across, right + across @ position
        return np.asarray(np.linalg.solve(normal, right), float)


class Cloned:
    """A network that was shown which way to go from what both images and the registers tell, as built."""

    UNITS, EPOCHS = 64, 2000
    """Choice: the training error no longer falls."""
    EXPLORED = 0.3
    """Standard deviation of what leads demonstrations astray, so that ways back are shown, too (choice)."""

    def __init__(self, seed: int = 1) -> None:
        import torch

        seen, shown = self._demonstrations(seed)
        torch.manual_seed(seed)
        units = self.UNITS
        self._net = torch.nn.Sequential(
            *(torch.nn.Linear(seen.shape[1], units), torch.nn.Tanh()),
            *(torch.nn.Linear(units, units), torch.nn.Tanh(), torch.nn.Linear(units, 3)),
        )
        inputs, targets = (torch.as_tensor(each, dtype=torch.float32) for each in (seen, shown))
        optimizer = torch.optim.Adam(self._net.parameters(), lr=3e-3)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, self.EPOCHS)
        for _ in range(self.EPOCHS):
            optimizer.zero_grad()
            torch.nn.functional.mse_loss(self._net(inputs), targets).backward()
            optimizer.step()
            schedule.step()

    def __call__(self, observation: Mapping[str, Array]) -> Array:
        """Words (3,) as they would have been shown."""
        import torch

        with torch.no_grad():
            words = self._net(torch.as_tensor(_flat(observation), dtype=torch.float32))
        return np.clip(words.numpy(), -1, 1)

    def _demonstrations(self, seed: int) -> tuple[Array, Array]:
        """What is seen (n, 15), and the words (n, 3) that lead to the goal from there."""
        env: Any = points_of(fetch())
        rng = np.random.default_rng(seed)
        seen, shown = [], []
        for episode in range(DEMONSTRATED):
            observation, _ = env.reset(seed=FIRST_DEMONSTRATION + episode)
            over = False
            while not over:
                made = env.unwrapped
                words = (made.goal - made.data.site(GRIPPER).xpos) / REACH
                seen.append(_flat(observation))
                shown.append(words)
                observation, _, terminated, truncated, _ = env.step(words + rng.normal(0, self.EXPLORED, 3))
                over = terminated or truncated
        env.close()
        return np.array(seen), np.array(shown)


def _flat(observation: Mapping[str, Array]) -> Array:
    return np.concatenate([observation[key] for key in ("achieved_goal", "desired_goal", "observation")])


def _lives(name: str) -> Callable[[gym.Env[Any, Any]], Any]:
    return lambda env: agents.make(name, env)


SERVO, MEMORY = "unified_servo", "memory"
POLICIES: dict[str, tuple[Callable[[], Any], bool]] = {
    "calibrated": (Calibrated, False),
    "cloned": (Cloned, False),
    SERVO: (lambda: _lives(SERVO), True),
    MEMORY: (lambda: _lives(MEMORY), True),
}
"""What makes each policy, and whether it learns."""


def tables(episodes: int = EPISODES, policies: Sequence[str] = tuple(POLICIES)) -> Iterator[Table]:
    """Success of each policy under each change; and what each change cost it."""
    found = {}
    for name in policies:
        make, learns = POLICIES[name]
        found[name] = paired(
            fetch,
            make(),
            SCHEDULES,
            episodes=episodes,
            learns=learns,
            success=succeeded,
            wrap=points_of,
            images={CAMERA: None},
            per="episode",
        ).rows
    shares = [[name, *(rows[i].success for rows in found.values())] for i, name in enumerate(SCHEDULES)]
    yield Table(
        "knocked",
        "FetchReach, one of two cameras turned: success",
        pd.DataFrame(shares, columns=["camera turned by", *found]),
        dict.fromkeys(found, ".0%"),
        f"Success: within {100 * SUCCESS:g} cm when {2 * MIDDLE} steps are over. {episodes} episodes, the "
        f"same for all; in each the camera turns another way, in mid-episode after {MIDDLE} steps. "
        f"Two cameras of {FOVY:g}°, noise {NOISE_PX:g} px of 512. Cloned: from {DEMONSTRATED} episodes. "
        f"`{SERVO}` and `{MEMORY}` begin knowing nothing, and live through all episodes of a row.",
    )
    rows = [
        {
            "policy": name,
            "camera turned by": row.schedule,
            "won, lost": f"{row.won}, {row.lost}",
            "p": row.p,
            "difference": f"{row.difference:+.0%} [{row.low:+.0%}, {row.high:+.0%}]",
        }
        for name, rows in found.items()
        for row in rows[1:]
    ]
    yield Table(
        "knocked_pairs",
        "What each change cost, episode by episode",
        pd.DataFrame(rows),
        {"p": ".2g"},
        "Against the same policy in the same episodes as built. p: McNemar's exact test. Brackets: Tango's "
        "95 % score interval.",
    )


def figure(tables: Sequence[Table]) -> Figure:
    """Success of each policy under each change."""
    shares = next(table for table in tables if table.name == "knocked").frame
    drawn = Figure(figsize=(7.0, 3.2), layout="constrained")
    axes = drawn.subplots()
    policies = list(shares.columns[1:])
    for place, name in enumerate(policies):
        at = np.arange(len(shares)) + (place - (len(policies) - 1) / 2) * 0.2
        axes.bar(at, 100 * shares[name].astype(float), 0.18, label=name)
    axes.set_xticks(range(len(shares)), shares.iloc[:, 0])
    axes.set_ylim(0, 100)
    axes.set_ylabel("success (%)")
    axes.legend(ncols=len(policies), loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
    return drawn
