"""The bench for every test: a fake SO-101, and the environment over it."""

import pytest

from calfree_gym.lerobot import LeRobotReachEnv
from tests.calfree_gym.lerobot.fake_so101 import FakeSO101


class Bench:
    """A robot and its environment, in whose motions something may happen.

    Attributes:
        actions: What was sent at each tick.
    """

    def __init__(self, robot, **arguments):
        self.robot, self.actions = robot, []
        self._moment, self._happens = None, None
        settings = {"place_object": robot.place_object, "on_tick": self._tick} | arguments
        self.env = LeRobotReachEnv(robot, ("left", "right"), **settings)

    def then(self, moment, happens):
        self._moment, self._happens = [moment, moment], happens

    def _tick(self, observation, action):
        self.actions.append(action)
        if self._moment and self.env.doing == self._moment[-1]:
            self._moment.pop()
            if not self._moment:
                self._happens()


@pytest.fixture
def bench(opengl):
    return lambda seed=0, robot=None, **arguments: Bench(robot or FakeSO101(seed), **arguments)


@pytest.fixture
def ready(bench):
    """One whose first trial has begun."""
    begun = bench()
    begun.env.reset()
    return begun
