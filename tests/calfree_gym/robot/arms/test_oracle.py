"""A controller that knows the world reaches: so every world and every object of an arm can be reached."""

import pytest

from tests.arms.every import arm_named, rows_of, three_mounts
from tests.arms.fetched import FETCHED
from tests.arms.own import ARMS

FEW, MANY = 4, 50
CASES = [
    *((name, FEW) for name in ARMS),
    *(pytest.param(name, MANY, marks=pytest.mark.slow) for name in [*ARMS, *FETCHED]),
]


def reached(arm, mount, worlds):
    """In how many worlds the oracle comes to the rendezvous within two motions."""
    env = rows_of(
        arm,
        worlds,
        camera_mount=mount,
        dynamics="kinematic",
        terminate_on_success=False,
        tell=("object_registers",),
    )
    observation, infos = env.reset(seed=100)
    motors = len(arm.robot.motors)
    done = infos["is_success"].copy()
    for _ in range(2):
        words = observation["object_registers"] - observation["observation"][:, 4 : 4 + motors]
        observation, *_, infos = env.step(words)
        done |= infos["is_success"]
    return int(done.sum())


@pytest.mark.parametrize(("name", "worlds"), CASES)
def test_the_oracle_reaches(name, worlds):
    arm = arm_named(name)
    counts = {mount: reached(arm, mount, worlds) for mount in three_mounts(arm.robot)}
    assert sum(counts.values()) >= 0.99 * worlds * len(counts), counts
