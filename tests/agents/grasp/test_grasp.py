"""The whole procedure in worlds that it does not know, and each of its parts against the truth."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import agents
from agents.base.registers import Stops
from agents.grasp.observation import ARM, GraspObservation
from agents.grasp.seen import target
from agents.grasp.turning import Turning, turn_needed
from calfree_gym.robot.grasping.gripping_arm import AXIS
from calfree_gym.robot.grasping.shapes import SHAPE_NAMES
from experiments.evaluation import evaluate
from experiments.running.lifetime import LifetimeRecorder, learn_trials
from tests.agents.trials import STAND_FIRST, assert_same_arrays, motions_of

GRASP = "CalFree/Grasp-v0"


@pytest.mark.parametrize("mount", STAND_FIRST)
def test_it_grasps_in_worlds_that_it_has_not_seen(mount):
    records = []
    for seed, shape in enumerate(SHAPE_NAMES * 2):
        env = gym.make(GRASP, shape=shape, camera_mount=mount)
        records += evaluate(agents.make("grasp", env), env, trials=1, seed=700 + seed)
    assert sum(record.success for record in records) >= 9
    assert np.median([record.motions for record in records]) <= 20


def test_it_grasps_where_registers_go_on_beyond_1():
    drawn, records = gym.make(GRASP), []
    for seed in (40_000, 40_007, 40_009, 40_015):
        drawn.reset(seed=seed)
        env = gym.make(GRASP, world=replace(drawn.unwrapped.world, word_gain=np.asarray(0.5)))
        env.reset(seed=seed)
        records += evaluate(agents.make("grasp", env), env, trials=3, seed=seed)
    assert sum(record.success for record in records) >= 11


@pytest.mark.slow
def test_it_grasps_what_it_sees(opengl):
    env = gym.make(GRASP, shape="bar", camera_mount="stand", observation="vision")
    agent = agents.make("grasp", env, knowledge=None)
    records = [evaluate(agent, env, trials=1, seed=710 + seed)[0] for seed in range(3)]
    env.close()
    assert sum(record.success for record in records) >= 2


@given(
    st.lists(st.floats(-5.0, 5.0), min_size=4, max_size=4),
    st.floats(2.5, 6.0),
    st.sampled_from([-1, 1]),
    st.lists(st.lists(st.floats(-0.06, 0.06), min_size=3, max_size=3), min_size=20, max_size=20),
)
def test_rates_of_turning_are_told_though_the_arm_turns_the_jaws_too(rates, size, sign, ways):
    true = np.array([*rates[:3], sign * size])
    known, angle = Turning.unknown(ARM).seen(0.3), 0.3
    for place, way in enumerate(ways):
        turn = known.longest if known.known else 0.1
        words = np.array([*way, (-1) ** place * min(turn, 0.7)])
        angle -= true @ words
        known = known.moved(words).seen((angle + np.pi / 2) % np.pi - np.pi / 2)
    assert known.known
    assert known.rates[-1] == pytest.approx(true[-1], rel=0.15)
    assert abs((known.angle - angle + np.pi / 2) % np.pi - np.pi / 2) < 0.2


def test_a_reversed_motor_is_noticed():
    rng, known, left = np.random.default_rng(0), Turning.unknown(ARM), []
    for rate in [3.0] * 6 + [-3.0] * 6:
        angle = rng.uniform(-1.4, 1.4)
        known = known.in_new_trial().seen(angle)
        for _ in range(6):
            word = (known.angle or 0.0) / known.rates[-1] if known.known else 0.15
            words = np.array([0.0, 0.0, 0.0, np.clip(word, -known.longest, known.longest)])
            angle -= rate * words[-1]
            known = known.moved(words).seen((angle + np.pi / 2) % np.pi - np.pi / 2)
        left.append(abs((angle + np.pi / 2) % np.pi - np.pi / 2))
    assert max(left[3:6] + left[9:]) < 0.1
    assert known.rates[-1] == pytest.approx(-3.0, rel=0.15)


@pytest.mark.parametrize("mount", STAND_FIRST)
def test_with_memory_it_grasps_ever_faster_and_no_less_surely(mount):
    recorder = LifetimeRecorder(gym.make(GRASP, camera_mount=mount), seed=502)
    records = learn_trials(agents.make("grasp", recorder), recorder, 30)
    motions = [record.motions for record in records]
    assert sum(record.success for record in records) >= 29
    assert np.mean(motions[10:]) <= 0.6 * np.mean(motions[:5])


def over_an_object(shape, *pose):
    """A nominal environment whose gripper stands over an object, where (1, 3) that is, and what is seen."""
    env = gym.make(GRASP, shape=shape, camera_mount="stand", world="nominal").unwrapped
    env.reset(seed=1, options={"object": pose})
    arms = env.arms
    at = np.array([[*pose[:2], arms.placed[0].pose[2] + AXIS]])
    rest = arms.robot.rest(arms.world(0).joint_zeros)
    registers = arms.motors.registers(arms.robot.positions_at(at, rest, arms.world(0).link_lengths)[0], 0)
    observation, *_ = env.step(np.append(registers, 0).astype(np.float32))
    return env, at, GraspObservation.of(observation)


def test_the_intermediate_position_is_one_gripper_length_before_the_object():
    env, at, _ = over_an_object("box", 0.4, 0.0)
    env.set_world(replace(env.world, point_noise=0.0))
    now = GraspObservation.of(env.step(np.zeros(5, np.float32))[0])
    along, seen = target("along_axis", now, 1.0)
    true, _ = env.arms._workspaces.cameras.project(at[None], np.array([0]))
    assert seen.all()
    assert 256 * np.abs(along - true[0]).max() < 6, "perspective over one gripper length"
    assert 256 * np.abs(now.at("tip") - true[0]).max() < 1


@pytest.mark.parametrize(
    ("orientation", "angle", "off"),
    [
        *[("least_squares", angle, 0.12) for angle in (-1.0, -0.3, 0.1, 0.4, 1.2)],
        ("both_images", 1.4, 0.12),  # nearly right: elsewhere perspective bends it
        ("one_image", 1.4, 0.3),
    ],
)
def test_the_turn_that_is_needed_is_the_true_one_near_the_object(orientation, angle, off):
    _, _, now = over_an_object("bar", 0.4, 0.0, angle)
    edges = np.pi / 2  # the jaws' edges lie across the arm, seen from above
    true = min(abs(edges - angle) % np.pi, np.pi - abs(edges - angle) % np.pi)
    assert abs(turn_needed(orientation, now)) == pytest.approx(true, abs=off)


@pytest.mark.parametrize("name", ["grasp", "insert"])
def test_what_it_has_learned_is_saved_and_loaded(name, tmp_path):
    env = gym.make(f"calfree_gym:CalFree/{name.title()}-v0", camera_mount="stand")
    agent = agents.make(name, env).learn(60)
    agent.save(tmp_path / "agent.npz")
    assert_same_arrays(agents.make(name, env).load(tmp_path / "agent.npz"), agent)
    with pytest.raises(ValueError, match=f"this agent is {name} over"):
        agents.make(name, env, caution=9.0).load(tmp_path / "agent.npz")


@pytest.mark.parametrize(
    ("words", "executed", "stops_at"),
    [
        ([0.3, 0.2, -0.3], [0.1, 0.06, -0.1], np.inf),  # something is in the way
        ([0.3, 0.1, -0.3], [0.1, 0.1, -0.3], 0.1),  # a motor's stop
        ([0.3, 0.0, 0.0], [0.1, 0.0, 0.0], 0.1),
    ],
)
def test_what_the_arm_meets_is_no_motors_stop(words, executed, stops_at):
    stops, words, executed = Stops(np.zeros(3)), np.array(words), np.array(executed)
    stops.learn(words, words - executed, executed)
    stops.learn(words, np.where(words == words[0], words, words - executed), executed)
    assert stops.found[1].tolist() == [stops_at, np.inf, np.inf]


def test_the_procedure_grasps_at_any_orientation():
    lifted = []
    for seed in range(1000, 1006):
        env = gym.make(GRASP, shape=SHAPE_NAMES[seed % 5], orientation="any", camera_mount="stand")
        *_, (*_, info) = motions_of(agents.make("grasp", env, seed=seed), env, seed=seed)
        lifted.append(env.unwrapped.is_solved(info["truth"]))
    assert sum(lifted) >= 5


def test_with_a_table_of_six_dimensions_it_grasps_and_fills_a_cell():
    recorder = LifetimeRecorder(gym.make(GRASP, shape="bar", world="nominal"), seed=3)
    agent = agents.make("grasp", recorder, knowledge="grid_table", direction=True, cells=2)
    assert all(record.success for record in learn_trials(agent, recorder, 3))
    assert np.count_nonzero(~np.isnan(agent.table.records[:, 0])) >= 2**6
