"""Other arms than the built-in one: whether who knows the world reaches, and whether physics settles.

The arms are those of the tests: our own, and other people's where `make arms` has fetched them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import gymnasium as gym
import pandas as pd

import agents
from calfree_gym import Arm
from experiments.arm_check import SETTLED_PX, ArmCheck
from experiments.benchmarks.speed.rates import batched
from experiments.benchmarks.trials import CAP, REACH, each_alone, share_of
from experiments.evaluation import evaluate
from experiments.reporting.tables import Table

WORLDS = 50
REQUIRED = 0.99
SPEED_ROUNDS, SPEED_REQUIRED = 20, 0.9


def arms(worlds: int = WORLDS, chosen: Mapping[str, Mapping[str, Any]] | None = None) -> Iterator[Table]:
    """All arms on four mounts; and how fast many rows of each are.

    Args:
        worlds: Wild worlds, one trial each.
        chosen: Arguments of arms, by name; those of the tests by default.

    Raises:
        ValueError: An arm cannot be used.
    """
    every = {name: Arm.from_dict(given) for name, given in (chosen or arms_of_tests()).items()}
    rows = [
        {"arm": name, "motors": len(arm.robot.motors), **_on_mount(arm, mount, worlds)}
        for name, arm in every.items()
        for mount in _mounts(arm)
    ]
    note = (
        f"The oracle, which is told the object's registers; wild worlds 0-{worlds - 1}, physics, 0.5 px "
        f"noise, one trial each of at most {CAP} motions. Brackets: 95 % intervals over worlds. Px: the "
        "largest difference of image points to kinematics in 100 random motions of the nominal robot."
    )
    formats = {
        "rendezvous": ".0%",
        "required": ".0%",
        "most motions": ".0f",
        "px": ".0e",
        "required px": ".1f",
    }
    yield Table("arms", "Other arms", pd.DataFrame(rows), formats, note)
    ratios = {name: batched(SPEED_ROUNDS, arm, SPEED_REQUIRED) for name, arm in every.items()}
    yield Table(
        "arms_speed",
        "Other arms, 256 rows at once",
        pd.DataFrame(
            {"arm": name, "ratio": each.ratio, "required": each.wanted, "ours a second": each.ours}
            for name, each in ratios.items()
        ),
        {"ratio": ".2f", "required": ".2f", "ours a second": ",.0f"},
        f"Against a bare `Batch` of the same model over the same substeps, all cores, cameras on the waist; "
        f"median of {SPEED_ROUNDS} pairs, timed in turn.",
    )


def arms_of_tests() -> dict[str, dict[str, Any]]:
    """The arms of the tests, which stand in the repository alone."""
    from tests.arms.fetched import fetched_arms
    from tests.arms.own import ARMS

    return {**ARMS, **fetched_arms()}


def _mounts(arm: Arm) -> dict[str, str | tuple[str, str]]:
    """The waist, the room, the gripper's body, and the gripper's body with the room."""
    hand = arm.robot.parts.bodies[arm.robot.parts.holder]
    return {"waist": "waist", "stand": "stand", "hand": hand, "hand and stand": (hand, "stand")}


def _on_mount(arm: Arm, mount: str, worlds: int) -> dict[str, Any]:
    camera_mount = _mounts(arm)[mount]
    env = gym.make(REACH, arm=arm, camera_mount=camera_mount, tell=("object_registers",))
    oracle = agents.make("oracle", env)
    records = [evaluate(oracle, env, trials=1, seed=seed)[0] for seed in range(worlds)]
    env.close()
    worst, _ = ArmCheck(arm, camera_mount).worst_px()
    return {
        "mount": mount,
        "worlds": worlds,
        **share_of("rendezvous", each_alone(records), ".0%"),
        "required": REQUIRED,
        "most motions": max(record.motions for record in records),
        "px": worst,
        "required px": SETTLED_PX,
    }
