"""Affine stereo in worlds that are affine, where all that it assumes is exact; and in the simulation."""

from functools import partial
from itertools import count

import numpy as np
import pytest

import agents
import calfree_gym
from agents.base.observation import Observation
from agents.calibrated.affine_stereo import AffineStereo
from agents.calibrated.robot_model import RobotModel
from experiments.evaluation import evaluate
from tests.agents.trials import carry_out


@pytest.fixture
def told(make_env):
    """Makes an environment that tells where the gripper is."""
    return partial(make_env, tell=("gripper_position",))


class AffineWorld:
    """The nominal arm, its gripper and an object seen by two cameras infinitely far away."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        self.arm = RobotModel.of(calfree_gym.nominal(), "stand")
        self.matrix, self.offset = rng.standard_normal((4, 3)), 0.1 * rng.standard_normal(4)
        self.object = np.array([0.40, 0.05, 0.15]) + rng.uniform(-0.05, 0.05, 3)
        self.registers = np.zeros(3)

    def position(self):
        return self.arm.gripper(self.arm.joints(self.registers[None]))[0]

    def observed(self, words=0.0, position=None):
        """What is seen after words (3,), and where the gripper is said to be."""
        self.registers = self.registers + words
        points = [self.matrix @ place + self.offset for place in (self.position(), self.object)]
        told = {"gripper_position": self.position() if position is None else position}
        return Observation(np.reshape(points, (4, 2)), np.ones(4, bool), self.registers.copy(), told)


@pytest.mark.parametrize("gain", [0.3, 0.6])
@pytest.mark.parametrize("seed", range(3))
def test_steps_reduce_the_distance_by_the_gain_in_an_affine_world(told, gain, seed):
    world, lengths = AffineWorld(seed), []

    def observed(words):
        seen = world.observed(words)
        lengths.append(np.linalg.norm(world.object - world.position()))
        return seen

    carry_out(AffineStereo(told(), gain=gain).procedure(world.observed(), None), observed, 9)
    shares = np.array(lengths[3:]) / np.array(lengths[2:-1])
    np.testing.assert_allclose(shares, 1 - gain, rtol=1e-3)


def test_a_position_at_which_a_point_is_missing_is_looked_at_again(told):
    steps = []
    for missing in ((), (0, 3)):
        world, looks = AffineWorld(5), count()

        def look(words=0.0, world=world, looks=looks, missing=missing):
            seen, shown = world.observed(words), np.arange(4) != 1
            elsewhere = np.where(shown[:, None], seen.points, 9.0)
            return seen.estimated(elsewhere, shown) if next(looks) in missing else seen

        words, _ = carry_out(AffineStereo(told()).procedure(look(), None), look, 6 + len(missing))
        steps.append(words[words.any(1)])
    np.testing.assert_allclose(*steps, atol=1e-6)


def test_the_nominal_robot_reaches(told, mount):
    env = told(mount, world="nominal")
    records = evaluate(agents.make("affine_stereo", env), env, trials=40, seed=3000)
    assert np.mean([record.rendezvous for record in records]) >= 0.95
    assert np.median([record.motions for record in records]) <= 12
