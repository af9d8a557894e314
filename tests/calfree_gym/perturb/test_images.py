"""Faults of lens and sensor in one image: whatever its shape, as strong as is said, where our cameras see."""

import numpy as np
import pytest

from calfree_gym import Perturb
from calfree_gym.image import IMAGE_SIZE
from calfree_gym.perturb.images import faulty
from calfree_gym.perturb.model import ModelParts, plain_world
from calfree_gym.vision.cameras import image_points
from tests.calfree_gym.perturb.workbench import Workbench

WORLD = plain_world(ModelParts(("top",), ()))
PLACE = np.zeros(2)


def world(**fields):
    return WORLD.replace(**{name: [value] for name, value in fields.items()})


@pytest.mark.parametrize("size", [(90, 120), (120, 90), (64, 64)])
def test_colours_may_be_first_or_last_and_images_rectangular(size):
    image = np.random.default_rng(0).integers(0, 255, (*size, 3), np.uint8)
    there = world(exposure=0.7, blur=6.0, image_noise=5.0, lens_k1=-0.1)
    found = faulty(image, there, 0, PLACE)
    assert found.shape == image.shape
    first = faulty(np.moveaxis(image, -1, 0), there, 0, PLACE)
    np.testing.assert_array_equal(np.moveaxis(first, 0, -1), found)


def test_noise_and_exposure_are_as_strong_as_is_said():
    grey = np.full((90, 120, 3), 100, np.uint8)
    assert faulty(grey, world(image_noise=8.0), 0, PLACE).std() == pytest.approx(8, rel=0.05)
    assert (faulty(grey, world(exposure=1.5), 0, PLACE) == 150).all()


@pytest.mark.parametrize("k1", [-0.15, 0.1])
def test_a_lens_puts_points_where_our_own_cameras_see_them(k1):
    height, width = 120, 160
    focal = WORLD.focal_length[0] * height / IMAGE_SIZE
    for pixel in ([60.0, 100.0], [90.0, 40.0], [30.0, 60.0]):
        image = np.zeros((height, width, 3), np.uint8)
        row, column = map(int, pixel)
        image[row - 1 : row + 2, column - 1 : column + 2] = 255
        middle = np.array([(width - 1) / 2, (height - 1) / 2])
        flat = (np.array([column, row]) - middle) / focal
        there, _ = image_points(flat, np.array([focal]), middle, k1, 0.0, np.inf)
        found = faulty(image, world(lens_k1=k1), 0, PLACE)[..., 0].astype(float)
        seen = [(found.sum(axis) @ np.arange(found.shape[1 - axis])) / found.sum() for axis in (0, 1)]
        np.testing.assert_allclose(seen, there, atol=0.3)


def test_a_lens_is_of_its_camera_whatever_else_is_in_the_schedule():
    lens = {"at": {"step": 0}, "do": {"type": "lens", "camera": "front", "k1": 0.1}}
    roll = {"at": {"step": 9}, "do": {"type": "camera_roll", "camera": "front"}}
    alone, beside = (Perturb(Workbench(["front"]), schedule).world for schedule in ([lens], [lens, roll]))
    np.testing.assert_array_equal(alone.focal_length, beside.focal_length)
