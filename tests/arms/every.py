"""All test arms by name: our own, and the fetched ones, which are slow, and skipped where they are not."""

from functools import lru_cache

import gymnasium as gym
import pytest

from calfree_gym import Arm
from tests.arms.fetched import FETCHED, fetched_arms
from tests.arms.own import ARMS

EVERY = [*ARMS, *(pytest.param(name, marks=pytest.mark.slow) for name in FETCHED)]
"""For `pytest.mark.parametrize`."""


def arm_named(name):
    """The arm of that name: our own are built once a process; of the large fetched ones two are kept."""
    return own_arm(name) if name in ARMS else fetched_arm(name)


@lru_cache(maxsize=len(ARMS))
def own_arm(name):
    """An arm of `ARMS`."""
    return Arm(**ARMS[name])


@lru_cache(maxsize=2)
def fetched_arm(name):
    """An arm that `make arms` fetches."""
    if (arguments := fetched_arms().get(name)) is None:
        pytest.skip("`make arms` has not fetched it")
    return Arm(**arguments)


def rows_of(arm, count, **arguments):
    """So many rows of an arm, whose next trials begin when they are told to."""
    fixed = {"num_envs": count, "threads": 1, "autoreset_mode": "Disabled"}
    return gym.make_vec("calfree_gym:CalFree/Reach-v0", arm=arm, **fixed, **arguments)


def moved_by(robot, motor):
    """Name of the body that a motor moves."""
    return robot.model.body(robot.model.joint(robot.motors[motor]).bodyid.item()).name


def three_mounts(robot):
    """Cameras turning with the first link, in the room, and on the link that the middle motor moves."""
    return ("waist", "stand", moved_by(robot, len(robot.motors) // 2))
