"""Registers and joints against a model of one motor in plain Python, alike in all tasks and arms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from calfree_gym import WorldDistribution, nominal
from calfree_gym.robot.arms.arm import robot_of
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from tests.arms.every import arm_named
from tests.calfree_gym.environments import TASKS, begun, kinematic
from tests.calfree_gym.robot.one_motor import EXACT, FIELDS, Motor, made, registers_of


def each(low, high):
    return st.lists(st.floats(low, high), min_size=3, max_size=3)


@st.composite
def rough_worlds(draw):
    periods, phases, depths = (draw(each(*of)) for of in ((0.05, 2), (-4, 4), (0, 0.9)))
    return replace(
        WorldDistribution("wild").sample(draw(st.integers(0, 99))),
        shortfall=draw(each(0, 0.9)),
        longest_motion=draw(each(0.05, 1)),
        word_gain=draw(each(0.25, 3)),
        dead_zone=draw(each(0, 0.2)),
        gear_ripple=np.transpose([periods, phases, depths]),
    )


KINEMATIC = made(world=replace(nominal(), word_gain=0.25))
PHYSICS = made(world=replace(nominal(), word_gain=0.25), dynamics="physics")


def follow(env, world, words, atol):
    env.set_world(world)
    motors = [Motor(world, motor) for motor in range(3)]
    for seed in (0, None):  # home puts all right
        observation, info = env.reset(seed=seed)
        for motor in motors:
            motor.register = motor.joint = 0.0
        for word in [np.zeros(3), *words]:
            observation, *_, info = env.step(word)
            for motor, sent in zip(motors, word, strict=True):
                motor.move(sent)
            told = [motor.register / motor.of("word_gain") for motor in motors]
            np.testing.assert_allclose(registers_of(observation), told, rtol=1e-6, atol=1e-6)
            there = [motor.position(motor.joint) for motor in motors]
            np.testing.assert_allclose(info["truth"]["joints"][:3], there, rtol=0, atol=atol)
            assert env.observation_space.contains(observation)


@settings(max_examples=40)
@given(rough_worlds(), st.lists(each(-1, 1), min_size=1, max_size=8))
def test_registers_tell_what_was_executed_and_joints_stand_where_the_model_says(world, words):
    follow(KINEMATIC, world, np.array(words), atol=1e-9)


@settings(max_examples=3)
@given(rough_worlds(), st.lists(each(-0.3, 0.3), min_size=1, max_size=3))
def test_so_they_do_where_physics_moves_them(world, words):
    follow(PHYSICS, world, np.array(words), atol=2e-3)


def test_the_order_of_a_motion_by_hand():
    """Word 0.5; at most 0.4 of it; a tenth less: 0.36; a half of that as built: 0.18 of the way."""
    world = replace(nominal(), longest_motion=0.4, shortfall=0.1, word_gain=0.5, dead_zone=[0, 0.5, 0])
    env = made(world=world)
    home = env.reset(seed=0)[1]["truth"]["joints"][:3]
    for word, told, there in ((0.5, 0.36, [0.18, 0, 0.18]), (0.6, 0.72, [0.36, 0.18, 0.36])):
        observation, *_, info = env.step(np.full(3, word))
        moved = (info["truth"]["joints"][:3] - home) / MOVEMASTER.span
        np.testing.assert_allclose(moved, there, atol=1e-12)
        np.testing.assert_allclose(registers_of(observation), told, rtol=1e-6)
    np.testing.assert_allclose(env.reset()[1]["truth"]["joints"][:3], home, atol=1e-12)


def noise_of(rows, motions, **fields):
    """Deviations (motions and looks at home, rows, 3) of registers from what was executed."""
    env = kinematic(rows, world=replace(nominal(), **fields), terminate_on_success=False, threads=1)
    found, executed = [], np.zeros(3)
    observation, _ = env.reset(seed=5)
    for motion in range(motions):
        found.append(registers_of(observation) - executed)
        word = np.where(motion % 2, -0.1, 0.1)
        executed = executed + word
        observation, *_ = env.step(np.full((rows, 3), word))
    return np.array(found, float)


def test_the_noise_of_registers_is_normal_independent_and_as_large_as_was_set():
    sigma = np.array([0.001, 0.005, 0.02])
    found = noise_of(64, 40, register_noise=sigma) / sigma
    flat = found.reshape(-1, 3)
    n = len(flat)
    for of_motor in flat.T:
        assert stats.kstest(of_motor, "norm").pvalue > 1e-3
        assert of_motor.std() == pytest.approx(1, abs=4.5 / math.sqrt(2 * n))
    assert np.abs(np.corrcoef(flat.T) - np.eye(3)).max() < 4.5 / math.sqrt(n)
    assert abs(np.corrcoef(found[:-1].ravel(), found[1:].ravel())[0, 1]) < 4.5 / math.sqrt(3 * n)
    assert found[0].std() == pytest.approx(1, abs=4.5 / math.sqrt(2 * 192)), "the look at home included"


@settings(max_examples=30)
@given(st.floats(1e-3, 0.7), st.floats(0, 0.05), each(-1, 1))
def test_told_registers_are_the_nearest_whole_multiples_of_their_step(step, noise, words):
    world = replace(nominal(), register_step=[step, 0, step], register_noise=noise)
    KINEMATIC.set_world(world)
    KINEMATIC.reset(seed=3)
    stepped = registers_of(KINEMATIC.step(np.array(words))[0]).astype(float)
    KINEMATIC.set_world(replace(world, register_step=0))
    KINEMATIC.reset(seed=3)
    smooth = registers_of(KINEMATIC.step(np.array(words))[0]).astype(float)
    assert stepped[1] == smooth[1], "the noise is that of seed, trial and motion alone"
    multiples = stepped[[0, 2]] / step
    np.testing.assert_allclose(multiples, np.rint(multiples), atol=1e-3)
    assert (np.abs(stepped - smooth)[[0, 2]] <= step / 2 + 1e-6).all()


def test_noise_takes_no_register_out_of_the_space():
    env = begun(made(world=replace(nominal(), register_noise=0.5, register_step=0.3)))
    for _ in range(30):
        observation = env.step(np.ones(3))[0]
        assert env.observation_space.contains(observation)
    assert np.abs(registers_of(observation)).max() <= np.float32(0.9), "whole steps within 1"


def test_registers_of_weak_words_end_farther_out_and_the_space_says_so():
    weak = replace(nominal(), word_gain=[0.25, 1, 2])
    env = made(world=weak, tell=("object_registers",))
    assert env.observation_space["observation"].high.tolist() == [1] * 4 + [4] * 3
    assert env.observation_space["object_registers"].high.tolist() == [4] * 3
    assert made().observation_space["observation"].high.tolist() == [1] * 7
    env.reset(seed=0)
    for _ in range(5):
        observation, *_ = env.step(np.ones(3))
    ends = [Motor(weak, motor).highest / weak.word_gain[motor] for motor in range(3)]
    np.testing.assert_allclose(registers_of(observation), ends, rtol=1e-6)
    assert ends[0] == 4
    observation, info = env.reset()
    for _ in range(8):  # the oracle's way
        observation, *_, info = env.step(observation["object_registers"] - registers_of(observation))
    assert info["truth"]["distance_mm"] < 0.1
    rows = kinematic(2, world=["wild", weak], keep_in_view=False)
    assert rows.single_observation_space["observation"].high.max() == 4
    rows.unwrapped.set_world(weak, 0)


@pytest.mark.parametrize("task", TASKS)
def test_a_world_whose_registers_go_beyond_the_space_is_refused_before_anything_changes(task):
    env = begun(made(task, world="nominal"))
    world, state = env.world, env.get_state()
    weak = replace(world, word_gain=np.append(0.25, np.ones(len(world.motor_sign) - 1)))
    message = r"word_gain is \[0.25, .*registers would go to \+-4; .* observes them within \+-1"
    with pytest.raises(ValueError, match=message):
        env.set_world(weak)
    with pytest.raises(ValueError, match=message):
        env.set_state(state | {"_worlds": weak})
    assert env.world == world
    env.set_world(replace(world, word_gain=2))


def lived(env, motions, seed=1):
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(motions):
        observation, *_, info = env.step(rng.uniform(-0.3, 0.3, env.action_space.shape))
        found += [*observation.values(), info["truth"]["joints"]]
    return np.concatenate([np.ravel(each) for each in found])


@pytest.mark.parametrize("task", TASKS)
def test_defaults_are_no_change_and_every_field_is_one_that_registers_or_joints_show(task):
    given_ = {name: getattr(nominal(), name)[0] for name in FIELDS}

    def run(**fields):
        env = begun(made(task, world="nominal"), 2)
        env.set_world(replace(env.world, **fields))
        env.reset(seed=2)
        return lived(env, 3)

    plain = run()
    np.testing.assert_array_equal(run(**given_), plain)
    for name, value in FIELDS.items():
        other = 2.0 if name == "word_gain" else value  # within the space
        assert (run(**{name: other}) != plain).any(), name


def test_a_stopped_arm_stands_where_its_registers_and_its_joints_were_on_the_way():
    env = begun(made("SafeReach", world="nominal", force_bound=1e9))
    world = replace(env.world, dead_zone=0.2, gear_ripple=(0.5, 1, 0.6), motor_gain=np.full(3, 4.0))
    env.set_world(world)
    rng, stopped = np.random.default_rng(0), 0
    for _ in range(4):
        env.reset()
        for _ in range(3):
            motors = motors_at(env)
            before = [(each.register, each.joint) for each in motors]
            words = rng.uniform(-0.6, 0.6, 3)
            observation, *_, info = env.step(words)
            share = env.arms.simulation.touched.shares[0]
            for i, motor in enumerate(motors):
                motor.move(words[i])
                ends = [motor.position(at) for at in (*before[i], motor.register, motor.joint)]
                there = (1 - share) * ends[1] + share * ends[3]
                assert info["truth"]["joints"][i] == pytest.approx(there, abs=5e-3)
                told = registers_of(observation)[i]
                by_register = (1 - share) * ends[0] + share * ends[2]
                assert motor.position(float(told)) == pytest.approx(by_register, abs=1e-4)
            stopped += share < 1
    assert stopped > 0


def test_a_stopped_arm_whose_motor_gets_play_stays_where_it_was_stopped():
    event = {"at": {"motion": 1}, "do": {"type": "backlash", "motor": "shoulder", "degrees": 8}}
    env = begun(made("SafeReach", world="nominal", perturbations=[event], force_bound=1e9))
    down = env.step([0, -1, -0.3])[-1]
    assert env.arms.simulation.touched.shares[0] < 1
    rests = env.step(np.zeros(3))[-1]
    assert env.world.backlash[1] > 0
    np.testing.assert_allclose(rests["truth"]["joints"], down["truth"]["joints"], atol=1e-4)


def motors_at(env):
    motors = [Motor(env.world, motor) for motor in range(3)]
    for i, motor in enumerate(motors):
        motor.register, motor.joint = env.arms.registers[0, i], env.arms._registers.joints[0, i]
    return motors


@pytest.mark.parametrize("name", ["scara", "gantry"])
def test_other_arms_have_them_too(name):
    robot = robot_of(arm_named(name))
    world = replace(nominal(robot), **FIELDS | EXACT)
    env = begun(made(arm=arm_named(name), world=world))
    motors = [Motor(world, motor, robot) for motor in range(len(robot.motors))]
    for words in np.random.default_rng(0).uniform(-0.3, 0.3, (5, len(motors))):
        observation, *_, info = env.step(words)
        for i, motor in enumerate(motors):
            motor.move(words[i])
            told = registers_of(observation, len(motors))[i]
            assert told == pytest.approx(motor.register / 0.5, abs=1e-6)
            assert info["truth"]["joints"][i] == pytest.approx(motor.position(motor.joint), abs=1e-9)
