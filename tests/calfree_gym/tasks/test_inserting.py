"""Inserting: a peg that is led along the axis goes in, what is told is true, and one arm is as many."""

import copy

import gymnasium as gym
import numpy as np
import pytest

import calfree_gym  # noqa: F401
from calfree_gym.geometry import rotation_matrix
from calfree_gym.robot.inserting import CLEAR, LEANS
from calfree_gym.tasks.insert import depth_told

INSERT = "CalFree/Insert-v0"


def go(env, ahead, beside=0.0):
    """Brings the peg's end before (m, negative) or beyond the hole, along the gripper, by the closed form."""
    arms, row = env.unwrapped.arms, np.array([0])
    world, robot, hole = arms.world(0), arms.robot, arms.poses[0, :3]
    rest = robot.rest(world.joint_zeros)
    at = robot.positions_at(hole[None], rest, world.link_lengths)
    axis = robot.axis(arms.motors.angles(at[None], row)[0])
    side = np.cross(axis[0], [0, 0, 1.0])
    place = hole + ahead * axis + beside * side / np.linalg.norm(side)
    registers = arms.motors.registers(robot.positions_at(place, rest, world.link_lengths)[0], 0)
    return env.step((registers - arms.registers[0]).astype(np.float32))


def test_a_peg_beside_the_plate_is_not_in():
    """Where it hangs beside it, as deep as one in the hole."""
    axis, visible = np.array([[0.0, 0.4], [0.05, 0.4]]), np.ones(1, bool)
    for across, told in ((0.03, 0.2), (0.2, 0.0)):
        way = 0.2 * axis + [[across, 0.0], [across, 0.0]]
        depth = depth_told(np.zeros((1, 2, 2)) + way, (way - axis)[None], np.zeros((1, 2, 2)), visible)
        assert depth == pytest.approx(told, abs=0.02)
    assert depth_told(-way[None], (-way - axis)[None], np.zeros((1, 2, 2)), visible) < -0.1, (
        "above it, as ever"
    )


@pytest.mark.parametrize("mount", ["waist", "stand"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_peg_that_is_led_along_the_axis_goes_in(mount, seed):
    env = gym.make(INSERT, camera_mount=mount, terminate_on_success=False)
    env.reset(seed=seed)
    observation, *_, info = go(env, -0.05)
    assert info["truth"]["depth_mm"] == pytest.approx(-50, abs=1)
    assert observation["achieved_goal"][4] == pytest.approx(-50 / 92, abs=0.15), "perspective bends it"
    assert not info["is_success"]
    for ahead in (-0.02, -0.004, 0.005, 0.014, 0.024):  # joints do not move the peg along a line
        observation, reward, *_, info = go(env, ahead)
    assert info["truth"]["depth_mm"] == pytest.approx(24, abs=1.5)
    assert info["is_success"]
    assert reward == 0
    assert env.unwrapped.is_solved(info["truth"])
    goals = observation["achieved_goal"], observation["desired_goal"]
    assert env.unwrapped.compute_reward(*goals, {}) == reward


def test_beside_the_hole_is_the_plate_and_a_guard():
    env = gym.make(INSERT)
    env.reset(seed=4)
    go(env, -0.02, 0.005)
    for ahead in np.arange(-0.016, 0.01, 0.004):
        *_, info = go(env, ahead, 0.005)
        assert info["truth"]["depth_mm"] < 2
        assert not info["is_success"]
    assert 10 < info["truth"]["force"] < 30
    assert info["truth"]["force"] >= info["force_plate"]


def test_plates_lean_as_the_gripper_does_and_arms_begin_above_them():
    env = gym.make(INSERT).unwrapped
    for seed in range(5):
        _, info = env.reset(seed=seed)
        arms = env.arms
        angles, reached = arms._holes.joints_at(0, arms.world(0), arms.poses[:1, :3])
        upwards = rotation_matrix(arms.poses[0, 3:])[:, 2]
        assert reached.all()
        assert -upwards @ arms.robot.axis(angles)[0] >= np.cos(LEANS) - 1e-9
        assert info["truth"]["depth_mm"] < -1000 * CLEAR
        assert arms.visible[0].all()


def test_the_same_in_one_and_in_many():
    rng = np.random.default_rng(0)
    many, one = gym.make_vec(INSERT, 3), gym.make(INSERT)
    batched, _ = many.reset(seed=7)
    single, _ = one.reset(seed=8)
    for _ in range(4):
        for key, value in single.items():
            np.testing.assert_array_equal(value, batched[key][1])
        words = rng.uniform(-0.3, 0.3, (3, 4)).astype(np.float32)
        batched, _, _, _, infos = many.step(words)
        single, _, _, _, info = one.step(words[1])
        assert info["truth"]["depth_mm"] == infos["truth"]["depth_mm"][1]


def test_copies_go_on_as_they_would_have():
    env = gym.make(INSERT).unwrapped
    env.reset(seed=3)
    go(env, -0.03)
    other = copy.deepcopy(env)
    state = env.get_state()
    first = go(env, 0.01)
    second = go(other, 0.01)
    env.reset(seed=5)
    env.set_state(state)
    third = go(env, 0.01)
    for again in (second, third):
        np.testing.assert_array_equal(first[0]["observation"], again[0]["observation"])
        assert first[4]["truth"]["depth_mm"] == again[4]["truth"]["depth_mm"]


def test_the_hole_may_be_given_where_the_arm_reaches_it():
    env = gym.make(INSERT, world="nominal", camera_mount="stand")
    env.reset(seed=0)
    _, info = env.reset(options={"object": (0.4, 0.05, 0.1)})
    np.testing.assert_allclose(info["truth"]["object"], [0.4, 0.05, 0.1])
    with pytest.raises(ValueError, match=r"the hole at \[0.9, 0.0, 0.1\] is out of reach.*0.3 to 0.5 m"):
        env.reset(options={"object": (0.9, 0.0, 0.1)})
    with pytest.raises(ValueError, match="allowed: 'object'"):
        env.reset(options={"hole": (0.4, 0.0, 0.1)})


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"clearance": 0}, r"clearance is 0; it must be a number from 0.1 to 10.0, in mm"),
        ({"clearance": "2"}, r"clearance is '2'; it must be a number"),
        ({"clearance": float("nan")}, r"clearance is nan"),
        ({"observation": "vision"}, r"observation is 'vision'; allowed: points"),
        ({"world": "wilder"}, r"did you mean wild"),
        ({"tolerance_px": 0}, r"tolerance_px is 0"),
    ],
)
def test_what_is_not_allowed_is_named(arguments, told):
    with pytest.raises(ValueError, match=told):
        gym.make(INSERT, **arguments)


def test_words_are_four_and_there_is_no_dense_reward():
    env = gym.make(INSERT)
    assert env.action_space.shape == (4,)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"shape \(5,\); it must be \(4,\)"):
        env.unwrapped.step(np.zeros(5, np.float32))
    with pytest.raises(TypeError, match="unexpected keyword argument 'reward'"):
        gym.make(INSERT, reward="dense")
