"""Somebody else's environment as agents see it: points as projected by hand, words, and an agent in it."""

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from calfree_gym import Perturb, StereoPoints
from calfree_gym.geometry import looking_at
from calfree_gym.perturb import FixedCamera, Words
from tests.calfree_gym.environments import begun
from tests.calfree_gym.perturb.table_top import STEP, TableTop

WORDS = Words((0, 1, 2), steps=15)
"""A word of 1 moves the hand by 0.3 m."""


def made(env=None, cameras=("top", "front"), words=WORDS, gripper="tip", **arguments):
    return StereoPoints(env or TableTop(), gripper, "thing", cameras, words, **arguments)


def by_hand(position):
    x, y, z = position
    top, front = 1 / np.tan(np.radians(30)), 1 / np.tan(np.radians(25))
    return [top * x / (1 - z), -top * y / (1 - z), front * x / (1 + y), -front * (z - 0.2) / (1 + y)]


def test_points_are_where_cameras_show_them():
    env = made()
    observation, _ = env.reset(seed=3)
    for words in ([0, 0, 0], [0.4, -0.3, 0.2], [-0.2, 0.1, -0.1]):
        observation, *_ = env.step(np.array(words))
        hand, thing = env.unwrapped.data.mocap_pos
        np.testing.assert_allclose(observation["achieved_goal"], by_hand(hand), atol=1e-6)
        np.testing.assert_allclose(observation["desired_goal"], by_hand(thing), atol=1e-6)
        assert observation["observation"][:4].tolist() == [1, 1, 1, 1]


def test_a_camera_that_is_given_and_one_of_the_model_show_the_same():
    place = np.array([0.0, 0.0, 1.0])
    given = FixedCamera(place, looking_at(place, [0.0, 1e-9, 0.0]), 60)
    observation, _ = made(cameras=("top", given)).reset(seed=0)
    for key in ("achieved_goal", "desired_goal"):
        np.testing.assert_allclose(observation[key][:2], observation[key][2:], atol=1e-6)


def test_a_camera_with_a_sensor_shows_points_where_mujoco_renders_them():
    xml = (
        "<mujoco><worldbody><site name='tip' pos='0.1 0.05 0'/>"
        "<camera name='eye' pos='0 0 1' sensorsize='0.004 0.004' resolution='512 512' focal='0.003 0.002' "
        "principal='0.0003 0.0002'/></worldbody></mujoco>"
    )
    env = TableTop()
    env.model = model = mujoco.MjModel.from_xml_string(xml)
    env.data = data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    scene, eye = mujoco.MjvScene(model, 10), mujoco.MjvCamera()
    eye.type, eye.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, eye, mujoco.mjtCatBit.mjCAT_ALL, scene)
    frustum = scene.camera[0]
    near, centre, half = frustum.frustum_near, frustum.frustum_center, frustum.frustum_width
    middle = (frustum.frustum_top + frustum.frustum_bottom) / 2
    height = (frustum.frustum_top - frustum.frustum_bottom) / 2
    shown = [(0.1 * near - centre) / half, -(0.05 * near - middle) / height]
    points = StereoPoints(env, "tip", "tip", ("eye", "eye"), WORDS)._look()[0]
    np.testing.assert_allclose(points, np.broadcast_to(shown, (2, 2, 2)), atol=1e-6)


def test_words_are_displacements_and_add_up_in_registers():
    env = begun(made())
    before = env.unwrapped.data.mocap_pos[0].copy()
    observation, *_ = env.step(np.array([0.5, -0.25, 0.0]))
    moved = env.unwrapped.data.mocap_pos[0] - before
    np.testing.assert_allclose(moved, 15 * STEP * np.array([0.5, -0.25, 0]), atol=1e-6)
    assert env.unwrapped.count == 8  # of 15
    np.testing.assert_allclose(observation["observation"][4:], [0.5, -0.25, 0])
    observation, *_ = env.step(np.array([0.9, 0.0, 0.0]))
    np.testing.assert_allclose(observation["observation"][4:], [1, -0.25, 0])  # the register ends
    moved = env.unwrapped.data.mocap_pos[0] - before
    np.testing.assert_allclose(moved, 15 * STEP * np.array([1, -0.25, 0]), atol=1e-6)


def test_absolute_actions_go_to_registers_and_stay():
    box = gym.spaces.Box(np.array([-1.0, 0, 2]), np.array([1.0, 4, 4]), dtype=np.float64)
    words = Words((2, 0), steps=2, settle=1, absolute=True, rest=(0.0, 1.0, 3.0))
    actions = list(words.actions(box, np.array([0.0, 0.5]), np.array([-1.0, 0.25])))
    np.testing.assert_allclose(actions, [[0.625, 1, 2.5], [0.75, 1, 2], [0.75, 1, 2]])


def test_what_the_environment_knows_of_registers_is_told():
    env = begun(made(registers=lambda env: env.unwrapped.data.mocap_pos[0] / 0.3 - [0, 0, 2 / 3]))
    observation, *_ = env.step(np.array([0.5, 0.0, -0.1]))
    np.testing.assert_allclose(observation["observation"][4:], [0.5, 0, -0.1], atol=1e-6)


def test_a_lost_point_keeps_its_last_value_and_its_flag_falls():
    env = made(words=Words((0, 1, 2), steps=50))
    first, _ = env.reset(seed=0)
    observation, *_ = env.step(np.array([1.0, 0.0, 0.0]))  # 1 m to the right, out of both images
    assert observation["observation"][:4].tolist() == [0, 0, 1, 1]
    np.testing.assert_array_equal(observation["achieved_goal"], first["achieved_goal"])


def test_noise_has_its_size_and_comes_from_the_seed():
    found = []
    for seed in (*range(100), 0):
        observation, _ = made(noise_px=2.0).reset(seed=seed)
        found.append(observation["achieved_goal"] - by_hand([0, 0, 0.2]))
    np.testing.assert_array_equal(found[0], found[-1])
    assert np.std(found[:-1]) * 256 == pytest.approx(2.0, rel=0.15)


def test_an_episode_ends_at_the_rendezvous_and_where_the_environment_ends_it():
    check_env(made(), skip_render_check=True)
    for ends in (False, True):
        env = begun(made(TableTop(steps=20), terminate_on_success=ends), 1)
        hand, thing = env.unwrapped.data.mocap_pos
        *_, reward, terminated, truncated, info = env.step((thing - hand) / (15 * STEP))
        assert (reward, terminated, truncated, info["is_success"]) == (0.0, ends, False, True)
    env.reset(seed=1)
    env.step(-np.ones(3))
    *_, reward, terminated, truncated, info = env.step(np.ones(3))
    assert (reward, terminated, truncated, info["is_success"]) == (-1.0, False, True, False)
    assert env.unwrapped.count == 20


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"gripper": "tap"}, "a site is 'tap'"),
        ({"cameras": ("top", "frnt")}, r"a camera is 'frnt' \(did you mean front\?\); allowed: top, front"),
        ({"cameras": ("top",)}, "there must be two"),
        ({"cameras": ("top", FixedCamera([0, 0, 1], [1, 0, 0, 0], -60))}, "fovy is -60"),
        ({"cameras": ("top", FixedCamera([0, 0, 1], [0, 0, 0, 0], 60))}, "must be a unit quaternion"),
        ({"words": (0, 1, 2)}, r"words is \(0, 1, 2\); it must be Words"),
        ({"words": Words((0, 1), rest=(0, 0))}, r"rest is \(0, 0\); it must be 3 finite numbers"),
        ({"noise_px": -1}, "noise_px is -1; allowed: 0 to 512"),
        ({"noise_px": np.nan}, "noise_px is nan"),
        ({"tolerance_px": np.nan}, "tolerance_px is nan; it must be a number above 0"),
        ({"words": Words((0, 3))}, "an entry of words is 3; it must be a whole number from 0 to 2"),
    ],
)
def test_what_is_not_there_is_named(arguments, said):
    with pytest.raises(ValueError, match=said):
        made(**arguments)


def test_bad_actions_and_words_are_refused():
    env = TableTop()
    env.action_space = gym.spaces.Discrete(4)
    with pytest.raises(ValueError, match="words need a box"):
        made(env)
    for wrong in ({"steps": 0}, {"steps": -3}, {"settle": -9}, {"entries": (0, 0, 2)}, {"entries": ()}):
        with pytest.raises(ValueError, match=f"{next(iter(wrong))} is .*must be"):
            Words(**({"entries": (0, 1, 2)} | wrong))
    env = begun(made())
    for bad in (np.zeros(2), np.full(3, np.nan)):
        with pytest.raises(ValueError, match="3 finite numbers"):
            env.step(bad)


def test_a_knocked_camera_shows_points_elsewhere_until_it_is_undone():
    knock = {"type": "camera_aim", "camera": "top", "degrees": 3}
    schedule = [{"at": {"step": 2}, "do": knock}, {"at": {"step": 4}, "undo": 0}]
    seen = []
    for each in (TableTop(), Perturb(TableTop(), schedule, seed=0, images={"top": None})):
        env = made(each)
        first, _ = env.reset(seed=0)
        seen.append([first["achieved_goal"], *(env.step(np.zeros(3))[0]["achieved_goal"] for _ in range(6))])
    bare, knocked = np.array(seen).reshape(2, 7, 2, 2)
    differs = (bare != knocked).any(-1)
    assert differs[:, 0].tolist() == [False, False, False, True, True, False, False]
    assert not differs[:, 1].any()
