"""Perturbations of light and images against what rendered frames show."""

from dataclasses import replace

import numpy as np
import pytest

from calfree_gym import nominal
from calfree_gym.geometry import rotation_matrix
from calfree_gym.perturbations import Blur, Exposure, ImageNoise, Light
from calfree_gym.perturbations.schedule import undone
from calfree_gym.vision.image_formation import MAX_NOISE
from tests.calfree_gym.environments import kinematic

STILL = replace(nominal(), image_noise=np.zeros(2))
OBJECT = (0.42, 0.05, 0.12)


@pytest.fixture(scope="module")
def look(opengl):
    env = kinematic(world=STILL, camera_mount="stand", observation="rgb", image_size=512).unwrapped

    def images(world):
        env.set_world(world)
        observation, info = env.reset(seed=0, options={"object": OBJECT})
        places = (info["truth"]["points"].reshape(2, 2, 2)[1] + 1) * 256 - 0.5
        return observation["left_image"].astype(float), observation["right_image"].astype(float), places

    yield images
    env.close()


@pytest.mark.parametrize("factor", [0.5, 0.8, 1.3])
def test_exposure_scales_every_grey_level_up_to_white(look, factor):
    before, right, _ = look(STILL)
    after, same, _ = look(Exposure("left", factor).change(STILL))
    assert np.abs(after - np.minimum(factor * before, 255)).max() <= 1
    assert abs(after.mean() / before.mean() - factor) < 0.1
    np.testing.assert_array_equal(same, right)


@pytest.mark.parametrize("px", [1.5, 3.0])
def test_blur_widens_edges_by_its_standard_deviation(look, px):
    left, before, _ = look(STILL)
    same, after, _ = look(Blur("right", px).change(STILL))
    edge = np.abs(np.diff(before, axis=1)).max()
    assert np.abs(np.diff(after, axis=1)).max() == pytest.approx(edge / (px * np.sqrt(2 * np.pi)), rel=0.15)
    assert after.mean() == pytest.approx(before.mean(), abs=0.5)
    np.testing.assert_array_equal(same, left)


@pytest.mark.parametrize("levels", [2.0, 10.0, MAX_NOISE])
def test_noise_has_its_standard_deviation_and_no_mean(look, levels):
    dim = replace(STILL, exposure=np.full(2, 0.7))
    before, right, _ = look(dim)
    after, same, _ = look(ImageNoise("left", levels).change(dim))
    grey = (before > 4 * MAX_NOISE) & (before < 255 - 4 * MAX_NOISE)  # nothing is clipped
    assert grey.sum() > 10_000
    noise = (after - before)[grey]
    assert noise.std() == pytest.approx(levels, rel=0.05)
    assert abs(noise.mean()) < 0.05 * levels
    np.testing.assert_array_equal(same, right)


def test_the_bright_side_of_the_object_turns_with_the_light(look):
    to_the_right = rotation_matrix(STILL.camera_orientation[0])[:, 0]
    azimuth = float(np.degrees(np.arctan2(to_the_right[1], to_the_right[0])))
    shifts = []
    for turn in (0.0, 180.0):
        image, _, places = look(Light(azimuth + turn, 10.0, 0.8, 0.3).change(STILL))
        column, row = places[0].round().astype(int)
        ball = image[row - 3 : row + 4, column - 3 : column + 4, 1]
        shifts.append((ball * np.arange(-3, 4)).sum() / ball.sum())
    assert shifts[0] > 0.1
    assert shifts[1] < -0.1


def test_the_lamp_stands_where_it_is_said_to():
    above = Light(0.0, 90.0, 0.5, 0.4).change(STILL)
    np.testing.assert_allclose(above.light_direction, [0, 0, -1], atol=1e-12)
    along_y = Light(90.0, 30.0, 0.5, 0.4).change(STILL)
    np.testing.assert_allclose(along_y.light_direction, [0, -np.sqrt(3) / 2, -0.5], atol=1e-12)
    assert (along_y.light_strength, along_y.light_ambient) == (0.5, 0.4)


def test_a_light_that_drifts_gets_there_and_stays_a_light():
    light = Light(120.0, 50.0, 0.3, 0.6)
    world = STILL
    for _ in range(100):
        world = light.drift(world)
    there = light.change(STILL)
    angles = [np.arccos(w.light_direction @ there.light_direction) for w in (STILL, world)]
    assert angles[1] == pytest.approx(0.99**100 * angles[0])
    for _ in range(2000):
        world = light.drift(world)
    for name in ("light_direction", "light_strength", "light_ambient"):
        np.testing.assert_allclose(getattr(world, name), getattr(there, name), atol=1e-6)


def test_faults_add_up_in_a_drift_and_end_with_their_range():
    world = ImageNoise("left", 10.0).drift(ImageNoise("left", 15.0).change(STILL))
    assert world.image_noise.tolist() == [25, 0]
    with pytest.raises(ValueError, match=r"image_noise.levels is 35.0; it must be a number from 0 to 30"):
        ImageNoise("left", 10.0).drift(world)
    with pytest.raises(ValueError, match=r"blur.px is -1.0"):
        Blur("right", 1.0).drift(STILL, back=True)


def test_undoing_a_light_brings_the_whole_lamp_back():
    """Two lamps at one height differ in two of three numbers; a third has all of them else."""
    first = Light(0.0, 50.0, 0.5, 0.4).change(STILL)
    second, third = (Light(*at, 0.5, 0.4).change(first) for at in ((90.0, 50.0), (10.0, 70.0)))
    assert undone(third, first, second) == first
