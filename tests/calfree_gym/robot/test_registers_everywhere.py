"""What registers tell is alike in all tasks and arms, and default worlds are as before."""

import copy
from dataclasses import replace

import numpy as np
import pytest

from calfree_gym import nominal
from calfree_gym.robot.arms.arm import robot_of
from tests.arms.every import arm_named
from tests.calfree_gym.environments import TASKS
from tests.calfree_gym.robot.one_motor import EXACT, FIELDS, Motor, made, registers_of


@pytest.mark.parametrize("task", TASKS)
def test_a_world_whose_registers_go_beyond_the_space_is_refused_before_anything_changes(task):
    env = made(task, world="nominal")
    env.reset(seed=0)
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
        env = made(task, world="nominal")
        env.reset(seed=2)
        env.set_world(replace(env.world, **fields))
        env.reset(seed=2)
        return lived(env, 3)

    plain = run()
    np.testing.assert_array_equal(run(**given_), plain)
    for name, value in FIELDS.items():
        other = 2.0 if name == "word_gain" else value  # within the space
        assert (run(**{name: other}) != plain).any(), name


@pytest.mark.parametrize(("task", "first"), [("Reach", 4), ("SafeReach", 4), ("Grasp", 18), ("Insert", 22)])
def test_every_task_tells_registers_alike(task, first):
    env = made(task, world="nominal")
    env.reset(seed=0)
    motors = len(env.world.motor_sign)
    env.set_world(replace(env.world, register_step=0.1, shortfall=0.5, register_noise=1e-4))
    env.reset(seed=0)
    words = np.zeros(env.action_space.shape)
    words[0], words[1] = 0.23, -0.12
    observation = env.step(words)[0]
    told = registers_of(observation, motors, first)
    np.testing.assert_allclose(told, [0.1, -0.1, *np.zeros(motors - 2)], atol=1e-6)


def test_what_motors_no_longer_err_by_is_in_copies_too():
    """A copy forgot the error of a motor that has rested since its repeatability was undone."""
    schedule = [
        {"at": {"motion": 1}, "do": {"type": "repeatability", "motor": "shoulder", "degrees": 4}},
        {"at": {"motion": 2}, "undo": 0},
    ]
    env = made(world="nominal", perturbations=schedule)
    env.reset(seed=0)
    for _ in range(2):
        env.step(np.array([0, 0.1, 0]))
    env.step(np.array([0.1, 0, 0]))
    twin = copy.deepcopy(env)
    expected = lived(env, 3)
    np.testing.assert_array_equal(lived(twin, 3), expected)


def test_a_stopped_arm_stands_where_its_registers_and_its_joints_were_on_the_way():
    """Of a motion that ends at a share of its way, both have come as far, each from where it was."""
    env = made("SafeReach", world="nominal", force_bound=1e9)
    env.reset(seed=0)
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


def motors_at(env):
    """Models of the motors of an environment where they are now."""
    motors = [Motor(env.world, motor) for motor in range(3)]
    for i, motor in enumerate(motors):
        motor.register, motor.joint = env.arms.registers[0, i], env.arms._registers.joints[0, i]
    return motors


@pytest.mark.parametrize("name", ["scara", "gantry"])
def test_other_arms_have_them_too(name):
    robot = robot_of(arm_named(name))
    world = replace(nominal(robot), **FIELDS | EXACT)
    env = made(arm=arm_named(name), world=world)
    env.reset(seed=0)
    motors = [Motor(world, motor, robot) for motor in range(len(robot.motors))]
    for words in np.random.default_rng(0).uniform(-0.3, 0.3, (5, len(motors))):
        observation, *_, info = env.step(words)
        for i, motor in enumerate(motors):
            motor.move(words[i])
            told = registers_of(observation, len(motors))[i]
            assert told == pytest.approx(motor.register / 0.5, abs=1e-6)
            assert info["truth"]["joints"][i] == pytest.approx(motor.position(motor.joint), abs=1e-9)
