"""Observations that come from rendered images, and points that can be hidden."""

import copy
import json
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env

from calfree_gym.engine.spaces import image_distances
from calfree_gym.image import IMAGE_SIZE
from calfree_gym.tasks.reach import rendezvous

KINDS = {
    "vision": {"achieved_goal": (4,), "desired_goal": (4,), "observation": (7,)},
    "pixels": {"pixels": (48, 48, 6), "observation": (3,)},
    "rgb": {"left_image": (48, 48, 3), "right_image": (48, 48, 3), "observation": (3,)},
    "depth": {"left_depth": (48, 48), "right_depth": (48, 48), "observation": (3,)},
}


pytestmark = pytest.mark.usefixtures("opengl")


@pytest.fixture
def make():
    """Makes environments of 48 pixels, kinematic, and closes them."""
    made = []

    def make_env(observation, rows=None, **arguments):
        arguments = {"dynamics": "kinematic", "image_size": 48, "observation": observation} | arguments
        if rows is None:
            made.append(gym.make("CalFree/Reach-v0", **arguments))
        else:
            made.append(gym.make_vec("CalFree/Reach-v0", num_envs=rows, **arguments))
        return made[-1]

    yield make_env
    for env in made:
        env.close()


@pytest.mark.parametrize("kind", KINDS)
def test_observations_have_these_keys_and_lie_in_their_space(make, kind):
    env = make(kind)
    check_env(env.unwrapped, skip_render_check=True)
    observation, _ = env.reset(seed=1)
    assert {key: value.shape for key, value in observation.items()} == KINDS[kind]
    assert env.observation_space.contains(observation)
    assert hasattr(env.unwrapped, "compute_reward") == (kind == "vision")
    moved = env.step(np.array([0.3, 0.1, -0.1], np.float32))[0]
    for key in KINDS[kind]:
        if key != "desired_goal":
            assert (moved[key] != observation[key]).any(), key


@pytest.mark.parametrize("kind", KINDS)
def test_rows_are_single_environments(make, kind):
    rows = make(kind, rows=3, camera_mount="stand", threads=2)
    batched, _ = rows.reset(seed=20)
    words = np.random.default_rng(0).uniform(-0.2, 0.2, (2, 3, 3)).astype(np.float32)
    steps = [batched] + [rows.step(each)[0] for each in words]
    for row in range(3):
        env = make(kind, camera_mount="stand")
        alone = [env.reset(seed=20 + row)[0]] + [env.step(each[row])[0] for each in words]
        for one, many in zip(alone, steps, strict=True):
            for key, value in one.items():
                np.testing.assert_array_equal(many[key][row], value, err_msg=key)


def test_vision_sees_the_points_that_projection_has(make):
    env, errors, seen = make("vision"), [], []
    rng = np.random.default_rng(1)
    for seed in range(12):
        observation, info = env.reset(seed=seed)
        for _ in range(2):
            points = np.concatenate([observation["achieved_goal"], observation["desired_goal"]]).reshape(4, 2)
            visible = observation["observation"][:4] > 0
            true = info["truth"]["points"].reshape(4, 2)
            errors += (np.linalg.norm(points - true, axis=1) * IMAGE_SIZE / 2)[visible].tolist()
            seen.append(visible)
            observation, *_, info = env.step(rng.uniform(-0.15, 0.15, 3))
    assert np.mean(seen[::2]) > 0.97, "at home all is seen"
    assert np.median(errors) < 0.25
    assert np.quantile(errors, 0.95) < 1.2


def test_points_are_not_noisy_twice(make):
    """The noise of points belongs to `"points"`; a rendered image has noise of its own."""
    env = make("vision")
    env.reset(seed=3)
    env.unwrapped.set_world(replace(env.unwrapped.world, point_noise=20.0, point_dropout=0.9))
    observation, info = env.reset()
    assert observation["observation"][:4].all()
    points = np.concatenate([observation["achieved_goal"], observation["desired_goal"]])
    assert np.abs(points - info["truth"]["points"]).max() * IMAGE_SIZE / 2 < 3


@pytest.mark.parametrize("kind", ["vision", "pixels"])
def test_the_rendezvous_is_reached_where_it_is(make, kind):
    env = make(kind, tell=("object_registers",), tolerance_px=5.0)
    for seed in range(4):
        observation, _ = env.reset(seed=seed)
        words = observation["object_registers"] - observation["observation"][-3:]
        observation, reward, terminated, _, info = env.step(words)
        assert terminated
        assert info["is_success"]
        assert reward == 0
        if kind == "vision":
            goals = observation["achieved_goal"], observation["desired_goal"]
            assert env.unwrapped.compute_reward(*goals, {}) == 0
            assert env.unwrapped.compute_terminated(*goals, {})


def test_images_come_as_late_as_points_do(make):
    late = [{"at": {"motion": 0}, "do": {"type": "latency", "motions": 1}}]
    env, delayed = make("rgb"), make("rgb", perturbations=late)
    words = np.random.default_rng(0).uniform(-0.2, 0.2, (4, 3)).astype(np.float32)
    now = [env.reset(seed=4)[0]] + [env.step(each)[0] for each in words]
    then = [delayed.reset(seed=4)[0]] + [delayed.step(each)[0] for each in words]
    for one, other in zip(now[1:-1], then[2:], strict=True):
        np.testing.assert_array_equal(one["left_image"], other["left_image"])
    assert (then[-1]["observation"] == now[-1]["observation"]).all()


@pytest.mark.parametrize("kind", ["vision", "rgb"])
def test_copies_and_states_see_the_same(make, kind):
    env = make(kind)
    env.reset(seed=2)
    env.step(np.array([0.1, 0.0, 0.1]))
    state, twin = env.unwrapped.get_state(), copy.deepcopy(env.unwrapped)
    words = np.array([0.1, 0.2, -0.1], np.float32)
    expected = env.step(words)[0]
    env.reset()
    env.unwrapped.set_state(state)
    for found in (twin.step(words)[0], env.unwrapped.step(words)[0]):
        for key, value in expected.items():
            np.testing.assert_array_equal(found[key], value)
    twin.close()


def test_specs_with_images_go_through_json(make):
    env = make("rgb", occlusion=True, width=400, height=300)
    text = env.spec.to_json()
    assert json.loads(text)["kwargs"]["image_size"] == 48
    again = gym.make(EnvSpec.from_json(text))
    np.testing.assert_array_equal(again.reset(seed=1)[0]["left_image"], env.reset(seed=1)[0]["left_image"])
    again.close()


@pytest.mark.parametrize("mount", ["waist", "stand"])
def test_with_occlusion_all_is_seen_at_home_and_at_the_rendezvous(mount):
    env = gym.make(
        "CalFree/Reach-v0",
        camera_mount=mount,
        dynamics="kinematic",
        occlusion=True,
        tell=("object_registers",),
        terminate_on_success=False,
    )
    hidden = 0
    rng = np.random.default_rng(0)
    for seed in range(15):
        observation, _ = env.reset(seed=seed)
        assert observation["observation"][:4].all()
        hidden += not env.step(rng.uniform(-0.4, 0.4, 3))[0]["observation"][:4].all()
        there = observation["object_registers"] - env.unwrapped.arms.registers[0]
        assert env.step(there)[0]["observation"][:4].all()
    assert hidden > 0


def test_without_occlusion_nothing_is_drawn_otherwise():
    """A world and its objects are those of an environment that knows of no occlusion."""
    env = gym.make("CalFree/Reach-v0", dynamics="kinematic")
    env.reset(seed=7)
    assert env.unwrapped.arms._lines is None
    assert env.unwrapped.arms.simulation.positions()[1][0] == pytest.approx(
        [0.31666, 0.28085, 0.13917], abs=1e-4
    )


def test_hidden_points_show_no_rendezvous():
    env = gym.make(
        "CalFree/Reach-v0", camera_mount="stand", dynamics="kinematic", occlusion=True, tolerance_px=60.0
    )
    coincident = 0
    rng = np.random.default_rng(0)
    for seed in range(40):
        observation, _ = env.reset(seed=seed)
        for _ in range(6):
            observation, _, terminated, _, info = env.step(rng.uniform(-0.5, 0.5, 3))
            arms = env.unwrapped.arms
            distances = image_distances(observation["achieved_goal"], observation["desired_goal"])
            assert terminated == bool(rendezvous(distances, arms.tolerance)) == info["is_success"]
            if not observation["observation"][:4].all():
                assert not terminated
                last = arms.points.reshape(1, 8)
                coincident += bool(rendezvous(image_distances(last[:, :4], last[:, 4:]), arms.tolerance)[0])
            if terminated:
                break
    assert coincident > 0, "some would show one by where they were seen last"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"observation": "pixel"}, r"observation is 'pixel' \(did you mean pixels\?\)"),
        ({"image_size": 8}, "image_size is 8; it must be a whole number from 16 to 1024"),
        ({"image_size": "big"}, "image_size is 'big'; it must be a whole number"),
        ({"occlusion": 1}, "occlusion is 1; allowed: True, False"),
    ],
)
def test_wrong_arguments_are_named(arguments, said):
    with pytest.raises(ValueError, match=said):
        gym.make("CalFree/Reach-v0", **arguments)
