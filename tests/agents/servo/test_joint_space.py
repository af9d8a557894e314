"""The servo in joint space against MuJoCo's own derivatives, and its gain where the world is linear."""

from functools import partial
from itertools import islice

import numpy as np
import pytest

import agents
from agents.base.observation import Observation
from agents.base.prior_knowledge import PriorKnowledge
from agents.servo.joint_space import JointSpaceServo
from experiments.studies import priors
from tests.agents.analytic import distance_jacobian
from tests.agents.trials import carry_out, motions_of


@pytest.fixture
def environment(make_env):
    """Makes an environment that tells the joint angles."""
    return partial(make_env, tell=("joint_angles",))


class LinearRobot:
    """Joints that words turn linearly, and image points that joints move linearly."""

    def __init__(self, rng):
        self.by_joints = 0.2 * rng.standard_normal((4, 3))
        self.by_words = np.diag(rng.choice([-1.0, 1.0], 3) * rng.uniform(1.0, 3.0, 3))
        self.object = -0.1 * self.by_joints @ rng.choice([-1.0, 1.0], 3)
        self.registers = np.zeros(3)
        self.start = rng.uniform(-1, 1, 5)

    def observed(self, **more):
        turned = self.by_words @ self.registers
        angles = self.start + np.append(turned, [0.0, 0.0])
        points = np.concatenate([self.by_joints @ turned, self.object])
        privileged = {"joint_angles": angles, **more}
        return Observation(points.reshape(4, 2), np.ones(4, bool), self.registers.copy(), privileged)


def steps_of(agent, robot, motions, **more):
    """All words, and the distances before and after each motion of all joints at once."""
    seen = [robot.observed(**more)]

    def observed(words):
        robot.registers = robot.registers + words
        seen.append(robot.observed(**more))
        return seen[-1]

    words, _ = carry_out(agent.procedure(seen[0], None), observed, motions)
    lengths, whole = np.linalg.norm([each.distance for each in seen], axis=1), np.all(words, axis=1)
    return words, np.stack([lengths[:-1], lengths[1:]], 1)[whole]


@pytest.mark.parametrize("gain", [0.5, 0.8])
@pytest.mark.parametrize("seed", range(3))
def test_in_a_linear_world_each_step_leaves_one_minus_gain(environment, gain, seed):
    robot = LinearRobot(np.random.default_rng(seed))
    agent = JointSpaceServo(environment(), gain=gain, step_rad=10.0, damping=0.0)
    _, distances = steps_of(agent, robot, 12)
    assert len(distances) >= 2
    np.testing.assert_allclose(distances[:, 1], (1 - gain) * distances[:, 0], rtol=1e-4)


def test_no_joint_turns_further_in_a_step_than_allowed(environment):
    robot = LinearRobot(np.random.default_rng(1))
    robot.object *= 8
    agent = JointSpaceServo(environment(), gain=1.0, step_rad=0.2, damping=0.0)
    words, _ = steps_of(agent, robot, 8)
    turned = [np.abs(robot.by_words @ word).max() for word in words if np.count_nonzero(word) == 3]
    assert max(turned) == pytest.approx(0.2, rel=1e-6)


@pytest.mark.parametrize("seed", [3000, 3004, 3010])
def test_its_first_step_is_that_of_the_true_jacobian_of_the_joints(noise_free, mount, seed, monkeypatch):
    env = noise_free(mount, seed, tell=("joint_angles",))
    observation, info = env.reset()
    step, used = JointSpaceServo._step, []
    monkeypatch.setattr(JointSpaceServo, "_step", lambda self, j, d: used.append(j) or step(self, j, d))
    agent = agents.make("joint_space_servo", env)
    registers, angles = [np.zeros(3)], [info["truth"]["joints"][:3]]
    for _, seen, _, info in islice(motions_of(agent, env, observation), 30):
        if used:
            break
        registers.append(seen["observation"][4:].astype(float))
        angles.append(info["truth"]["joints"][:3])
    registers, angles = np.array(registers), np.array(angles)
    middle = (registers.max(0) + registers.min(0)) / 2
    turned_by_word = env.world.motor_sign * np.ptp(angles, axis=0) / np.ptp(registers, axis=0)
    true = distance_jacobian(env, middle) / turned_by_word
    missed = np.linalg.norm(used[0] - true, axis=0) / np.linalg.norm(true, axis=0)
    assert missed.max() < 0.25


def test_a_joint_that_a_word_does_not_turn_leaves_words_numbers():
    motions = priors.motions("joint_space_servo", 5008, 6, priors.ALTERATIONS[PriorKnowledge.ARM])
    assert len(motions) == 6
