"""Geometry against pixels: where rendered marks are, and where the environment says they are."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import calfree_gym
from calfree_gym.image import IMAGE_SIZE


@pytest.fixture(scope="module")
def renderer():
    try:
        made = Renderer()
    except gym.error.DependencyNotInstalled as error:
        pytest.skip(str(error))
    yield made
    made.close()


def centroid(image: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    """Centre of the pixels that are rather this mark's hue than the sky's, in image units."""
    pixels = image.astype(float)
    red, green, blue = np.moveaxis(pixels, -1, 0)
    is_magenta = colour is GRIPPER_COLOUR
    chroma = np.minimum(red, blue) - green if is_magenta else green - np.maximum(red, blue)
    weight = np.clip(chroma - 10, 0, 90)
    ys, xs = np.indices(weight.shape)
    center = np.array([(weight * xs).sum(), (weight * ys).sum()]) / weight.sum()
    return (center + 0.5) * 2 / IMAGE_SIZE - 1


@pytest.mark.parametrize("mount", calfree_gym.MOUNTS)
def test_image_points_are_where_the_rendered_marks_are(renderer, mount):
    env = gym.make("CalFree/Reach-v0", camera_mount=mount).unwrapped
    compared, worst = 0, 0.0
    for seed in range(50):
        env.reset(seed=seed)
        off_center = np.random.default_rng(seed).uniform(-10, 10, (2, 2))
        env.set_world(replace(env.world, principal_point=off_center))
        env.reset()
        model, data = env.arms.simulation.snapshot(0)
        points = env.arms.true_points[0].reshape(2, 2, 2)
        for camera in range(2):
            image = camera_image(renderer, model, data, env.world, camera, marks_only=True)
            gripper, object_ = points[:, camera]
            if np.linalg.norm(gripper - object_) * IMAGE_SIZE / 2 < 30:
                continue  # one mark may hide the other
            for point, colour in ((gripper, GRIPPER_COLOUR), (object_, OBJECT_COLOUR)):
                error = np.linalg.norm(centroid(image, colour) - point) * IMAGE_SIZE / 2
                worst, compared = max(worst, error), compared + 1
    assert compared > 150
    assert worst < 0.5, f"{worst:.2f} px over {compared} marks"


def test_frame_shows_the_scene_and_both_images(renderer):
    env = gym.make("CalFree/Reach-v0", world="nominal", render_mode="rgb_array")
    env.reset(seed=0)
    frame = env.render()
    assert frame.shape == (720, 1080, 3)
    assert frame.dtype == np.uint8
    for panel in (frame[:, :720], frame[:360, 720:], frame[360:, 720:]):
        assert panel.std() > 20
    env.close()
