"""Agents before a dock: on plane geometry of our own, and in the environment."""

import gymnasium as gym
import numpy as np
import pytest

import agents
from tests.agents.docking.robot import Robot

NAMES = agents.names("dock")


def trials(name, robot, count):
    """Whether each trial docked, its motions, and how far off it ended (m)."""
    made, seen = agents.make(name, robot), []

    def note(_):
        if robot.arrived or robot.count == robot.LIMIT:
            seen.append((robot.arrived, robot.count, np.hypot(*robot.pose[:2])))
        return len(seen) < count

    made.learn(count * robot.LIMIT, note)
    return np.array(seen), made


def test_arcs_docks_at_once_in_fewer_motions_later_and_after_a_knock():
    robot = Robot(20, noise_px=0.5, slip=0.01)
    first, agent = trials("arcs", robot, 4)
    assert first[:, 0].all()
    assert (first[:, 2] < 0.02).all()
    assert first[1:, 1].mean() < 0.6 * first[0, 1]
    robot.knock(12, 0.03)
    before = agent.num_timesteps
    agent.learn(robot.LIMIT, lambda _: not robot.arrived)
    assert robot.arrived
    assert agent.num_timesteps - before < first[0, 1]


def test_a_jacobian_servo_docks_on_omnidirectional_wheels_and_stops_beside_the_dock_on_two():
    (omni, _), (differential, _) = (
        trials("jacobian_servo", Robot(21, each), 3) for each in ("omni", "differential")
    )
    assert omni[:, 0].all()
    assert differential[:, 0].mean() < 0.5 < 3 * np.median(differential[:, 2]) / 0.1


def test_a_commutator_moves_the_robot_aside():
    robot = Robot(22)
    agent = agents.make("commuting_servo", robot)
    agent.learn(30)
    assert agent.learned.aside.any()


@pytest.mark.parametrize("name", NAMES)
def test_what_an_agent_knows_is_saved_and_predicting_changes_nothing(name, tmp_path):
    env = gym.make("calfree_gym:CalFree/Dock-v0", tell=("pose", "wheels"))
    env.reset(seed=3)
    agent, other = (agents.make(name, env) for _ in range(2))
    agent.learn(12)
    observation, _ = env.reset()
    words, state = agent.predict(observation)
    agent.predict(env.step(words)[0], state)
    other.load_path = agent.save(tmp_path / "agent.npz")
    other.load(tmp_path / "agent.npz")
    np.testing.assert_array_equal(other.predict(observation)[0], words)
    np.testing.assert_array_equal(agent.predict(observation, episode_start=np.ones(1, bool))[0], words)
