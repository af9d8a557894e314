"""Stereo cameras of several worlds against single points through single cameras."""

import numpy as np

from calfree_gym import WorldDistribution
from calfree_gym.geometry import rotation_matrix
from calfree_gym.vision.cameras import StereoCameras

ROWS = 5


def made():
    worlds = [WorldDistribution("wilder" if seed % 2 else "wild").sample(seed) for seed in range(ROWS)]
    cameras = StereoCameras(ROWS)
    for row, world in enumerate(worlds):
        cameras.set_world(row, world)
    return cameras, worlds


def one_point(point, world, camera):
    """Image point, whether it is shown, and the pinhole pixels of a square camera without offset and lens.

    From the formulas of the fields of `World`.
    """
    rotation = rotation_matrix(world.camera_orientation[camera])
    x, y, z = rotation.T @ (point - world.camera_position[camera])
    flat, focal = np.array([x, -y]) / -z, world.focal_length[camera]
    k1, k2, square = world.lens_k1[camera], world.lens_k2[camera], flat @ flat
    along = flat * (1 + k1 * square + k2 * square**2) * focal * [1, world.pixel_aspect[camera]]
    folds = [root.real for root in np.roots([5 * k2, 3 * k1, 1]) if root.imag == 0 and root.real > 0]
    shown = square < min(folds, default=np.inf)
    return (along + world.principal_point[camera]) / 256, shown and z < 0, flat * focal + 256


def test_every_row_projects_through_its_own_two_cameras():
    cameras, worlds = made()
    points = np.random.default_rng(1).uniform([-1.5, -0.4, 0.0], [0.6, 0.4, 0.6], (40, 3))
    rows = np.arange(40) % ROWS
    images, shown = cameras.project(points[:, None], rows)
    for i, row in enumerate(rows):
        for camera in range(2):
            image, seen, _ = one_point(points[i], worlds[row], camera)
            np.testing.assert_allclose(images[i, camera], image, rtol=1e-9)
            assert shown[i, camera] == seen
    assert 0.2 < shown.mean() < 0.8


def test_pinhole_pixels_come_through_the_lens_where_the_points_project_to():
    cameras, worlds = made()
    pairs = np.random.default_rng(2).uniform([0.3, -0.2, 0.0], [0.5, 0.2, 0.3], (ROWS, 2, 3))
    pixels = np.empty((ROWS, 4, 2))
    for row, world in enumerate(worlds):
        pixels[row] = [one_point(point, world, camera)[2] for point in pairs[row] for camera in range(2)]
    images, shown = cameras.through_lens(pixels)
    for of, pair in enumerate(pairs.transpose(1, 0, 2)):
        expected, expected_shown = cameras.project(pair[:, None], np.arange(ROWS))
        np.testing.assert_allclose(images[:, 2 * of : 2 * of + 2], expected, rtol=1e-9)
        np.testing.assert_array_equal(shown[:, 2 * of : 2 * of + 2], expected_shown)
