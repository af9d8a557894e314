"""Affine stereo in worlds that are affine, where all that it assumes is exact; and in the simulation."""

import gymnasium as gym
import numpy as np
import pytest

import agents
import calfree_gym
from agents.base.observation import Observation
from agents.calibrated.affine_stereo import Affine, AffineStereo
from agents.calibrated.robot_model import RobotModel
from experiments.evaluation import evaluate

TELL = ("gripper_position",)


def environment(mount="waist", **options):
    return gym.make("CalFree/Reach-v0", camera_mount=mount, dynamics="kinematic", tell=TELL, **options)


class AffineWorld:
    """The nominal arm, its gripper and an object seen by two cameras infinitely far away."""

    def __init__(self, rng):
        self.arm = RobotModel.of(calfree_gym.nominal(), "stand")
        self.matrix, self.offset = rng.standard_normal((4, 3)), 0.1 * rng.standard_normal(4)
        self.object = np.array([0.40, 0.05, 0.15]) + rng.uniform(-0.05, 0.05, 3)
        self.registers = np.zeros(3)

    def position(self):
        return self.arm.gripper(self.arm.joints(self.registers[None]))[0]

    def observe(self, position=None):
        points = [self.matrix @ place + self.offset for place in (self.position(), self.object)]
        place = self.position() if position is None else position
        return Observation(
            np.reshape(points, (4, 2)), np.ones(4, bool), self.registers.copy(), {"gripper_position": place}
        )


@pytest.mark.parametrize("seed", range(3))
def test_four_positions_determine_all_of_an_affine_world(seed):
    """Twelve parameters map displacements; the offsets are those of the first position."""
    rng = np.random.default_rng(seed)
    matrix, arm, offset = rng.standard_normal((8, 3)), rng.standard_normal((3, 3)), rng.standard_normal(8)
    positions = rng.standard_normal((4, 3))
    affine = Affine.through(positions, positions @ matrix.T + offset, positions @ arm.T)
    np.testing.assert_allclose(affine.points, matrix)
    np.testing.assert_allclose(affine.arm, arm)
    elsewhere = rng.standard_normal(3)
    predicted = positions[0] @ matrix.T + offset + affine.moved(arm @ (elsewhere - positions[0])).ravel()
    np.testing.assert_allclose(predicted, matrix @ elsewhere + offset)


@pytest.mark.parametrize("gain", [0.3, 0.6])
@pytest.mark.parametrize("seed", range(3))
def test_steps_reduce_the_distance_by_the_gain_in_an_affine_world(gain, seed):
    world = AffineWorld(np.random.default_rng(seed))
    agent = AffineStereo(environment(), gain=gain)
    running = agent.procedure(world.observe(), None)
    words, lengths = next(running), []
    for _ in range(9):
        world.registers = world.registers + words
        lengths.append(np.linalg.norm(world.object - world.position()))
        words = running.send(world.observe())
    shares = np.array(lengths[3:]) / np.array(lengths[2:-1])
    np.testing.assert_allclose(shares, 1 - gain, rtol=1e-3)


def test_it_uses_four_positions_and_none_after_them():
    def words_of(later):
        world = AffineWorld(np.random.default_rng(5))
        running = AffineStereo(environment()).procedure(world.observe(), None)
        words, made = next(running), []
        for motion in range(8):
            world.registers = world.registers + words
            made.append(words)
            words = running.send(world.observe(later if motion > 2 else None))
        return np.array(made)

    np.testing.assert_array_equal(words_of(None), words_of(np.full(3, np.nan)))


def test_a_position_at_which_a_point_is_missing_is_looked_at_again():
    """And so the affine function is the same as where none was."""
    world, steps = AffineWorld(np.random.default_rng(5)), []

    def look(number, missing):
        seen = world.observe()
        shown = np.arange(4) != 1
        elsewhere = np.where(shown[:, None], seen.points, 9.0)
        return seen.estimated(elsewhere, shown) if number in missing else seen

    for missing in ((), (0, 3)):
        world.registers, looks, made = np.zeros(3), 0, []
        running = AffineStereo(environment()).procedure(look(looks, missing), None)
        words = next(running)
        while len(made) < 6:
            world.registers, looks = world.registers + words, looks + 1
            if words.any():
                made.append(words)
            words = running.send(look(looks, missing))
        steps.append(made)
    np.testing.assert_allclose(*steps, atol=1e-6)


def test_linear_errors_of_the_arm_are_corrected_by_the_known_positions():
    """The same steps, whatever linear map stands between the nominal arm and the true one."""
    rng = np.random.default_rng(0)
    matrix, positions = rng.standard_normal((8, 3)), rng.standard_normal((4, 3))
    arm = np.eye(3) + 0.3 * rng.standard_normal((3, 3))
    affine = Affine.through(positions, positions @ matrix.T, positions @ arm.T)
    distance = (matrix[:4] - matrix[4:]) @ np.array([0.02, -0.01, 0.03])
    np.testing.assert_allclose(
        np.linalg.solve(arm, affine.step(distance, 0.5)), -0.5 * np.array([0.02, -0.01, 0.03])
    )


def test_the_nominal_robot_reaches(mount):
    env = environment(mount, world="nominal")
    records = evaluate(agents.make("affine_stereo", env), env, trials=40, seed=3000)
    assert np.mean([record.rendezvous for record in records]) >= 0.95
    assert np.median([record.motions for record in records]) <= 12
