"""Pixels and image units."""

import numpy as np

from calfree_gym.image import IMAGE_SIZE, IMAGE_UNIT, PIXELS_PER_UNIT, inside, lengths, lengths_px


def test_an_image_is_two_units_wide():
    assert IMAGE_SIZE * IMAGE_UNIT == 2
    assert PIXELS_PER_UNIT * IMAGE_UNIT == 1


def test_lengths_in_units_and_in_pixels():
    vectors = IMAGE_UNIT * np.array([[[3.0, 4.0], [0.0, -2.0]], [[0.0, 0.0], [8.0, 6.0]]])
    np.testing.assert_allclose(lengths_px(vectors), [[5, 2], [0, 10]])
    np.testing.assert_allclose(lengths(vectors), IMAGE_UNIT * np.array([[5, 2], [0, 10]]))
    assert lengths_px(vectors.astype(np.float32)).dtype == np.float32


def test_what_is_inside_lies_within_both_borders_and_their_margin():
    points = np.array([[1.0, -1.0], [0.0, 1.001], [-1.001, 0.0], [1 - 16 * IMAGE_UNIT, 0.0]])
    assert inside(points).tolist() == [True, False, False, True]
    assert inside(points, 16).tolist() == [False, False, False, True]
    assert inside(points, 17).tolist() == [False] * 4
