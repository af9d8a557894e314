"""Observations that come from rendered images, and points that can be hidden."""

import subprocess
import sys
from contextlib import ExitStack, closing

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from calfree_gym import WorldDistribution
from calfree_gym.engine.sight import TOGETHER
from calfree_gym.image import IMAGE_SIZE
from calfree_gym.rendering.stereo_images import StereoImages
from calfree_gym.vision.image_formation import ImageFormation
from tests.calfree_gym.environments import kinematic

KINDS = {
    "vision": {"achieved_goal": (4,), "desired_goal": (4,), "observation": (7,)},
    "pixels": {"pixels": (48, 48, 6), "observation": (3,)},
    "rgb": {"left_image": (48, 48, 3), "right_image": (48, 48, 3), "observation": (3,)},
    "depth": {"left_depth": (48, 48), "right_depth": (48, 48), "observation": (3,)},
}


pytestmark = pytest.mark.usefixtures("opengl")


@pytest.fixture
def make():
    with ExitStack() as made:
        yield lambda observation, **arguments: made.enter_context(
            closing(kinematic(image_size=48, observation=observation, **arguments))
        )


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


@pytest.mark.parametrize("kind", ["vision", "pixels"])
def test_rows_of_which_some_are_developed_while_others_are_rendered_see_what_each_sees_alone(make, kind):
    rows, words = TOGETHER + 2, np.random.default_rng(0).uniform(-0.1, 0.1, (2, TOGETHER + 2, 3))
    single, batch = make(kind), make(kind, rows=rows)
    seen = [batch.reset(seed=3)[0], *(batch.step(each)[0] for each in words)]
    for row in (0, TOGETHER - 1, TOGETHER, rows - 1):
        alone = [single.reset(seed=3 + row)[0], *(single.step(each[row])[0] for each in words)]
        for batched, one in zip(seen, alone, strict=True):
            for key in one:
                np.testing.assert_array_equal(batched[key][row], one[key])


def test_what_goes_wrong_while_images_are_developed_is_raised_before_all_rows_are_rendered(make, monkeypatch):
    def fails(*_):
        raise ValueError("no image")

    def counted(images, *row):
        rendered.append(row)
        return exposed(images, *row)

    rows, rendered, exposed = 5 * TOGETHER, [], StereoImages.exposed
    batch = make("pixels", rows=rows)
    batch.reset(seed=0)
    monkeypatch.setattr(ImageFormation, "image", fails)
    monkeypatch.setattr(StereoImages, "exposed", counted)
    with pytest.raises(ValueError, match="no image"):
        batch.step(np.full((rows, 3), 0.1))
    assert len(rendered) <= 2 * TOGETHER


def test_rows_are_seen_also_while_the_interpreter_ends():
    lines = (
        "import atexit, gymnasium, numpy",
        f"rows, of = {TOGETHER + 1}, dict(observation='pixels', image_size=48, dynamics='kinematic')",
        "envs = gymnasium.make_vec('calfree_gym:CalFree/Reach-v0', num_envs=rows, **of)",
        "envs.reset(seed=0)",
        "atexit.register(lambda: print('seen', envs.step(numpy.full((rows, 3), 0.1))[0]['pixels'].shape))",
    )
    done = subprocess.run([sys.executable, "-c", "\n".join(lines)], capture_output=True, text=True)
    assert f"seen ({TOGETHER + 1}, 48, 48, 6)" in done.stdout, done.stderr


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


@pytest.mark.parametrize("mount", ["waist", "stand"])
def test_with_occlusion_all_is_seen_at_home_and_at_the_rendezvous(mount):
    arguments = {"tell": ("object_registers",), "terminate_on_success": False}
    env, hidden = kinematic(camera_mount=mount, occlusion=True, **arguments), 0
    rng = np.random.default_rng(0)
    for seed in range(15):
        observation, _ = env.reset(seed=seed)
        assert observation["observation"][:4].all()
        hidden += not env.step(rng.uniform(-0.4, 0.4, 3))[0]["observation"][:4].all()
        there = observation["object_registers"] - env.unwrapped.arms.registers[0]
        assert env.step(there)[0]["observation"][:4].all()
    assert hidden > 0


def test_a_world_in_which_something_hides_every_object_is_drawn_anew():
    env, other = (kinematic(camera_mount="stand", occlusion=True) for _ in range(2))
    hopeless = WorldDistribution("wild").sample(679)
    other.unwrapped.set_world(hopeless)
    with pytest.raises(ValueError, match="hidden by nothing"):
        other.reset(seed=679)
    observation, _ = env.reset(seed=679)
    assert observation["observation"][:4].all()
    assert env.unwrapped.world != hopeless
