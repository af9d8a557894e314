"""Pinhole cameras with a lens: where they see points, where two see a point to be, and how that changes."""

import numpy as np

from ..base.observation import Array

_SMALL = 1e-2
"""Below such a square of an angle, power series are more exact than quotients (a guard)."""


def rotation(vector: Array) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3)."""
    return rotation_and_jacobian(vector)[0]


def rotation_and_jacobian(vector: Array) -> tuple[Array, Array]:
    """Rotation matrices R (..., 3, 3), and their left Jacobians V: with the vector, R x turns by V d(vector).

    Source: Solà, Deray & Atchuthan 2018, "A micro Lie theory", equations 134 and 145.
    """
    cross, (first, second, third) = cross_matrix(vector), _factors(vector)
    squared = cross @ cross
    unit = np.eye(3)
    return unit + first * cross + second * squared, unit + second * cross + third * squared


def jacobian_derivative(vector: Array, slide: Array) -> Array:
    """Of V u (..., 3, 3) by the rotation vectors (..., 3), for vectors u (..., 3)."""
    first, second, third = _factors(vector)
    squares = _squares(vector)
    small = squares < _SMALL
    some = np.where(small, 1.0, squares)
    second_slope = np.where(small, -1 / 12 + squares / 180 - squares**2 / 6720, (first - 2 * second) / some)
    third_slope = np.where(small, -1 / 60 + squares / 1260 - squares**2 / 60480, (second - 3 * third) / some)
    cross = cross_matrix(vector)
    once = turned(cross, slide)
    twice = turned(cross, once)
    along = (vector * slide).sum(-1)[..., None, None]
    of_twice = along * np.eye(3) + _outer(vector, slide) - 2 * _outer(slide, vector)
    growing = _outer(second_slope[..., 0] * once + third_slope[..., 0] * twice, vector)
    return np.asarray(growing - second * cross_matrix(slide) + third * of_twice)


def cross_matrix(vector: Array) -> Array:
    """The matrices (..., 3, 3) that make cross products with vectors (..., 3)."""
    matrix = np.zeros((*vector.shape, 3))
    for row, column, component in ((2, 1, 0), (0, 2, 1), (1, 0, 2)):
        matrix[..., row, column] = vector[..., component]
        matrix[..., column, row] = -vector[..., component]
    return matrix


def turned(matrices: Array, vectors: Array) -> Array:
    """Products (..., 3) of matrices (..., 3, 3) and vectors (..., 3)."""
    return np.asarray(matrices @ vectors[..., None])[..., 0]


def _outer(first: Array, second: Array) -> Array:
    return first[..., :, None] * second[..., None, :]


def _squares(vector: Array) -> Array:
    return np.asarray((vector * vector).sum(-1))[..., None, None]


def _factors(vector: Array) -> tuple[Array, Array, Array]:
    """Sin a / a, (1 - cos a) / a², (a - sin a) / a³ (..., 1, 1) for angles a."""
    squares = _squares(vector)
    small = squares < _SMALL
    some = np.where(small, 1.0, squares)
    angles = np.sqrt(some)
    first, second = np.sin(angles) / angles, (1 - np.cos(angles)) / some
    if not small.any():
        return first, second, (1 - first) / some
    return (
        np.where(small, 1 - squares / 6 * (1 - squares / 20 * (1 - squares / 42)), first),
        np.where(small, (1 - squares / 12 * (1 - squares / 30 * (1 - squares / 56))) / 2, second),
        np.where(small, (1 - squares / 20 * (1 - squares / 42 * (1 - squares / 72))) / 6, (1 - first) / some),
    )


CAMERA = 8
"""Numbers of a camera: the logarithm of its focal length in image units, a lens coefficient, the turn (3) of
the room about it that takes its axis to z, and where in the room it is (3)."""
TURN, PLACE = slice(2, 5), slice(5, 8)
"""Which of them are the turn and the place."""
NEAREST = 0.05
"""Points are taken to be at least so far before a camera (a guard: they are divided by it)."""
UNDISTORTIONS = 8
"""Passes that undo a lens (a guard: each leaves a fifth of the error or less)."""
PARALLEL = 1e-12
"""Added to the square of the sine between two rays (a guard: it is divided by)."""


def projected(cameras: Array, places: Array) -> Array:
    """Image points (..., 2) of places (..., 3) in the room, by cameras' numbers (..., 8)."""
    before = turned(rotation(cameras[..., TURN]), places - cameras[..., PLACE])
    flat = before[..., :2] / np.maximum(before[..., 2:], NEAREST)
    return np.asarray(np.exp(cameras[..., :1]) * flat * (1 + cameras[..., 1:2] * _squared(flat)))


def by_place(cameras: Array, places: Array) -> Array:
    """Derivatives of image points by places (..., 2, 3)."""
    turn = rotation(cameras[..., TURN])
    return np.asarray(_by_before(cameras, turned(turn, places - cameras[..., PLACE])) @ turn)


def by_camera(cameras: Array, places: Array) -> Array:
    """By cameras' numbers (..., 2, 8)."""
    turn, jacobian = rotation_and_jacobian(cameras[..., TURN])
    before = turned(turn, places - cameras[..., PLACE])
    flat = before[..., :2] / np.maximum(before[..., 2:], NEAREST)
    by_lens = np.exp(cameras[..., :1]) * flat * _squared(flat)
    by_focal = np.exp(cameras[..., :1]) * flat + cameras[..., 1:2] * by_lens
    by_before = _by_before(cameras, before)
    by_turn = -by_before @ cross_matrix(before) @ jacobian
    return np.concatenate([by_focal[..., None], by_lens[..., None], by_turn, -by_before @ turn], -1)


def _by_before(cameras: Array, before: Array) -> Array:
    """Derivatives of image points (..., 2, 3) by where points are before their cameras (..., 3)."""
    depths = np.maximum(before[..., 2:], NEAREST)
    flat = before[..., :2] / depths
    of_flat = np.zeros((*before.shape[:-1], 2, 3))
    of_flat[..., 0, 0] = of_flat[..., 1, 1] = 1 / depths[..., 0]
    of_flat[..., 2] = -flat / depths * (before[..., 2:] > NEAREST)
    return np.asarray(np.exp(cameras[..., :1, None]) * (_lens_derivatives(cameras, flat) @ of_flat))


class Triangulation:
    """Where two cameras see points: midway between the rays f of both, at least distances from them.

    So all Rᵀ (1 - f fᵀ / fᵀf) R (X - place) have a sum of 0.

    Attributes:
        places: X in the room (..., n, 3).

    Args:
        cameras: Of the left and the right camera (..., 2, 8).
        sensors: What they see (n, 4), in image units.
    """

    def __init__(self, cameras: Array, sensors: Array) -> None:
        numbers = np.moveaxis(cameras, -2, 0)[..., None, :]  # (2, ..., 1, 8)
        seen = np.moveaxis(sensors.reshape(-1, 2, 2), 1, 0)
        seen = seen.reshape(2, *[1] * (numbers.ndim - 3), -1, 2)
        self._cameras, self._places = numbers, numbers[..., PLACE]
        self._flat = _undistorted(numbers, seen * np.exp(-numbers[..., :1]))
        self._ahead = np.concatenate([self._flat, np.ones_like(self._flat[..., :1])], -1)
        self._lengths = _squared(self._ahead)[..., None]
        self._off_ray = np.eye(3) - self._ahead[..., :, None] * self._ahead[..., None, :] / self._lengths
        self._turns, self._jacobians = rotation_and_jacobian(numbers[..., TURN])
        self._backs = self._turns.swapaxes(-1, -2)
        curved = self._backs @ self._off_ray @ self._turns
        self._curved = curved.sum(0) + PARALLEL * np.eye(3)
        self.places = np.linalg.solve(self._curved, turned(curved, self._places).sum(0)[..., None])[..., 0]

    def derivatives(self) -> Array:
        """Of the places by all numbers of both cameras (..., n, 3, 16), as the sum stays 0."""
        ahead, unit = self._ahead[..., :, None], np.eye(3)
        before = turned(self._turns, self.places - self._places)[..., :, None]
        along = ahead.swapaxes(-1, -2) @ before / self._lengths
        left = (before - along * ahead)[..., 0]
        by_ahead = -along * unit - ahead @ before.swapaxes(-1, -2) / self._lengths
        by_ahead += 2 * along * ahead @ ahead.swapaxes(-1, -2) / self._lengths
        growth = _squared(self._flat)
        distorted = self._flat * (1 + self._cameras[..., 1:2] * growth)
        by_lens = -np.linalg.solve(
            _lens_derivatives(self._cameras, self._flat), np.stack([distorted, self._flat * growth], -1)
        )
        by_turn = (cross_matrix(left) - self._off_ray @ cross_matrix(before[..., 0])) @ self._jacobians
        by_numbers = np.concatenate([by_ahead[..., :2] @ by_lens, by_turn, -self._off_ray @ self._turns], -1)
        left_camera, right_camera = self._backs @ by_numbers
        return np.asarray(-np.linalg.solve(self._curved, np.concatenate([left_camera, right_camera], -1)))


def _undistorted(cameras: Array, distorted: Array) -> Array:
    flat = distorted
    for _ in range(UNDISTORTIONS):
        flat = distorted / (1 + cameras[..., 1:2] * _squared(flat))
    return flat


def _lens_derivatives(cameras: Array, flat: Array) -> Array:
    """Of what a lens makes of points (..., 2) at a focal length of one, by these (..., 2, 2)."""
    lens, unit = cameras[..., 1:2, None], np.eye(2)
    growth = 1 + lens * _squared(flat)[..., None]
    return np.asarray(growth * unit + 2 * lens * flat[..., :, None] * flat[..., None, :])


def _squared(vectors: Array) -> Array:
    """Squares of their lengths (..., 1)."""
    return np.asarray((vectors * vectors).sum(-1, keepdims=True))
