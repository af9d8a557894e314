"""Agents before a dock: on plane geometry of the tests, and in the environment."""

import gymnasium as gym
import numpy as np
import pytest

import agents
from agents.base import storage
from agents.docking.servo import DockingTrial
from tests.agents.docking.robot import Robot
from tests.agents.trials import carry_out


def live(name, robot, count):
    """Whether each of an agent's trials docked (t,), its motions (t,), and how far off it ended (t,) in m."""
    agent, ended = agents.make(name, robot), []

    def note(_):
        if robot.arrived or robot.count == robot.LIMIT:
            ended.append((robot.arrived, robot.count, np.hypot(*robot.pose[:2])))
        return len(ended) < count

    agent.learn(count * robot.LIMIT, note)
    return agent, np.array(ended).T


def test_arcs_docks_at_once_later_in_fewer_motions_and_after_a_knock():
    robot = Robot(20, noise_px=0.5, slip=0.01)
    agent, (docked, motions, off) = live("arcs", robot, 3)
    assert docked.all()
    assert (off < 0.02).all()
    assert motions[1:].mean() < 0.7 * motions[0]
    robot.knock(12, 0.03)
    before = agent.num_timesteps
    agent.learn(robot.LIMIT, lambda _: not robot.arrived)
    assert robot.arrived
    assert agent.num_timesteps - before < motions[0]


def test_a_jacobian_servo_docks_on_omnidirectional_wheels_and_stops_beside_the_dock_on_two():
    _, (docked, _, _) = live("jacobian_servo", Robot(21, "omni"), 3)
    _, (beside, _, off) = live("jacobian_servo", Robot(21), 3)
    assert docked.all()
    assert not beside.all()
    assert off.max() > 0.05


def before_the_dock(robot):
    """A trial that begins 1 m before the dock, and what carries motions out: words sent, and the value."""
    agent = agents.make("commuting_servo", robot)
    robot.reset()
    robot.pose = np.array([-1.0, 0.0, 0.0])
    trial = DockingTrial(agent.observed(robot.look()), agent.new_findings())

    return trial, lambda motions: carry_out(motions, lambda words: agent.observed(robot.step(words)[0]))


def test_a_commutator_moves_the_robot_aside_and_no_motor_does():
    robot = Robot(22)
    trial, made = before_the_dock(robot)
    trial.find_ways(made(trial.test())[1])
    before = robot.pose
    for words in trial.commutator(20.0):
        robot.step(words)
    ahead, aside, turn = np.abs(robot.pose - before)
    assert aside > 2 * ahead
    assert turn < 1e-9


def test_marks_that_are_lost_are_looked_for_where_the_robot_came_from():
    robot = Robot(23)
    trial, made = before_the_dock(robot)
    away = np.linalg.lstsq(robot.wheels, [0, 0, 2.0], rcond=None)[0]
    sent, seen = made(trial.drive([away, away]))
    assert not seen
    np.testing.assert_allclose(sent, [away, away, -away, -away])
    np.testing.assert_allclose(robot.pose, [-1, 0, 0], atol=1e-9)


def test_the_oracle_docks_in_a_few_arcs_on_any_wheels():
    for base, most in (("differential", 6), ("omni", 3)):
        env = gym.make("calfree_gym:CalFree/Dock-v0", base=base, tell=("pose", "wheels"))
        oracle, state, over = agents.make("oracle", env), None, False
        observation, _ = env.reset(seed=3)
        for motions in range(1, 9):  # noqa: B007
            words, state = oracle.predict(observation, state)
            observation, _, over, _, info = env.step(words)
            if over:
                break
        assert over
        assert motions <= most
        assert info["truth"]["offset_mm"] < 20


@pytest.mark.parametrize("name", agents.names("dock"))
def test_what_an_agent_knows_is_saved_and_predicting_changes_nothing(name, tmp_path):
    env = gym.make("calfree_gym:CalFree/Dock-v0", tell=("pose", "wheels"))
    env.reset(seed=3)
    agent, other = (agents.make(name, env) for _ in range(2))
    agent.learn(12)
    observation, _ = env.reset()
    words, state = agent.predict(observation)
    agent.predict(env.step(words)[0], state)
    agent.save(tmp_path / "agent.npz")
    other.load(tmp_path / "agent.npz")
    for each in (agent, other):
        np.testing.assert_array_equal(each.predict(observation, episode_start=np.ones(1, bool))[0], words)


def test_one_name_stands_for_what_docks_and_for_what_reaches():
    dock, reach = (gym.make(f"calfree_gym:CalFree/{task}-v0") for task in ("Dock", "Reach"))
    assert type(agents.make("jacobian_servo", dock)) is not type(agents.make("jacobian_servo", reach))
    with pytest.raises(ValueError, match="'arcs' cannot reach"):
        agents.make("arcs", reach)
    with pytest.raises(ValueError, match="cannot dock"):
        agents.make("paper_servo", dock)
    with pytest.raises(ValueError, match="cameras is 3"):
        agents.make("arcs", dock, cameras=3)


@pytest.mark.slow
def test_arcs_docks_by_both_cameras_where_the_robot_has_two():
    dock = gym.make("calfree_gym:CalFree/Dock-v0", world="wild", dynamics="kinematic", cameras=2)
    agent = agents.make("arcs", gym.wrappers.RecordEpisodeStatistics(dock))
    dock.reset(seed=8000)
    agent.learn(150)
    assert sum(agent.env.length_queue) / len(agent.env.length_queue) < 20


def test_test_words_that_move_nothing_are_refused(tmp_path):
    agent = agents.make("commuting_servo", Robot(23))
    storage.save(tmp_path / "agent.npz", agent.kind, agent.arrays() | {"words": np.array([0.0, 0.1])}, 0, 2)
    with pytest.raises(ValueError, match="damaged: the saved words hold 0; allowed"):
        agent.load(tmp_path / "agent.npz")
