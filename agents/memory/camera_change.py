"""What has become of one camera's image points.

A rotation about the optical centre, a roll and a zoom move all points of a camera by one homography, whatever
their depth. A camera that was moved shows parallax besides: a part that follows the depth, of which the other
camera tells. One that was replaced may follow neither.
"""

from dataclasses import dataclass

import numpy as np

from calfree_gym.image import IMAGE_UNIT

from ..base.observation import Array
from ..base.weights import huber_weights
from ..servo.image_model.gaussian_process import GaussianProcess
from .pairs import Pairs

HUBER = 3.0
"""Residuals of more standard deviations count less. Choice: looser than the usual 1.345 (Huber 1981, 95 %
efficiency), as standard deviations here are themselves estimates."""
MEAN_SQUARE_MEDIAN = float(np.log(2))
"""Median of (x² + y²) / 2 for standard normal x, y. Derived: that mean is exponential with mean 1."""


def coordinate_variance(residuals: Array) -> float:
    """Variance of one coordinate of residual points (n, 2), by their median."""
    return float(np.median(np.square(residuals).mean(1)) / MEAN_SQUARE_MEDIAN)


INVERSE_FOCAL_SQUARE = 0.6
"""1 / f², f in image units: how much perspective goes with a shift where a camera is turned. Derived for
a field of view of 76° across (the built robot has 80°, wild worlds 58° to 103°); `PERSPECTIVE_SHARE` covers
the others."""
PERSPECTIVE_STD, PERSPECTIVE_SHARE = 0.02, 0.4
"""Prior deviation of the perspective: so much, and such a share of the shift. Tuned (wild worlds 3000-)."""
SHEAR_STD = 0.03
"""Prior deviation of the shear, which square pixels and a plain lens do not show. Choice."""
PARALLAX_STD = 0.1
"""Prior deviation of the parallax. Tuned (wild worlds 3000-)."""
WIDE_STD = 1.0
"""Prior deviation of similarity and shift: half an image, that is unknown. Choice."""
ITERATIONS = 12
"""Gauss-Newton steps (a guard: more change nothing)."""
SIMILARITY_ITERATIONS = 8
"""Reweightings of the similarity that they begin with (a guard)."""
TURNED = float(np.radians(3))
"""A camera that has rolled further, in rad, counts as rolled. Tuned (wild worlds 3000-)."""
ZOOMED = 0.04
"""A camera whose scale has changed by a larger logarithm counts as zoomed. Tuned (wild worlds 3000-)."""
MOVED_PX = 1.0
"""A camera whose change fits no better counts as moved. Tuned (wild worlds 3000-)."""
PARALLAX_PX = 1.5
"""A camera whose scale has changed counts as moved where the parallax is larger. Tuned (wild worlds
3000-)."""
LEAST_LEFT, LEAST_BELOW, LEAST_SCALE_SQUARE = 0.05, 0.2, 0.05
"""Guards: 1 - leverage, the divisor of the perspective, and the square of the scale are no less."""

SIMILARITY, SHEAR, SHIFT, PERSPECTIVE = (slice(i, i + 2) for i in (0, 2, 4, 6))
PARALLAX = slice(8, 12)
PARAMETERS = 12
"""Where the parts of `CameraMap` lie in one vector."""


@dataclass(frozen=True)
class CameraMap:
    """An image point p becomes (A p + shift) / (1 + perspective·p) + parallax q.

    A is a rotation and scale with a little shear; q is what of the other camera's point does not follow from
    p: its depth.

    Attributes:
        parameters: All parts as one vector (12,).
    """

    parameters: Array

    @property
    def similarity(self) -> Array:
        """Scale times cosine and sine of the rotation (2,)."""
        return self.parameters[SIMILARITY]

    @property
    def shear(self) -> Array:
        """Stretch along x against y, and skew (2,)."""
        return self.parameters[SHEAR]

    @property
    def shift(self) -> Array:
        """In image units (2,)."""
        return self.parameters[SHIFT]

    @property
    def perspective(self) -> Array:
        """Per image unit (2,)."""
        return self.parameters[PERSPECTIVE]

    @property
    def parallax(self) -> Array:
        """What the depth adds (2, 2)."""
        return self.parameters[PARALLAX].reshape(2, 2)

    @property
    def rotation(self) -> float:
        """In rad."""
        cos, sin = self.similarity
        return float(np.arctan2(sin, cos))

    @property
    def scale(self) -> float:
        """1 where nothing has zoomed."""
        return float(np.hypot(*self.similarity))

    def __call__(self, own: Array, depth: Array) -> Array:
        """What points (n, 2) of depth (n, 2) become (n, 2)."""
        return self._flat(own)[0] + depth @ self.parallax.T

    def derivative(self, own: Array, depth: Array) -> Array:
        """Derivative (2n, 12) of that by the parameters."""
        flat, below = self._flat(own)
        (x, y), zero, one = own.T, np.zeros(len(own)), np.ones(len(own))
        derivative = np.zeros((len(own), 2, PARAMETERS))
        derivative[:, 0, SIMILARITY] = np.column_stack([x, -y]) / below
        derivative[:, 1, SIMILARITY] = np.column_stack([y, x]) / below
        derivative[:, 0, SHEAR] = np.column_stack([x, y]) / below
        derivative[:, 1, SHEAR] = np.column_stack([-y, x]) / below
        derivative[:, 0, SHIFT] = np.column_stack([one, zero]) / below
        derivative[:, 1, SHIFT] = np.column_stack([zero, one]) / below
        derivative[:, :, PERSPECTIVE] = -flat[:, :, None] * (own / below)[:, None]
        along_x, along_y = np.split(np.arange(PARAMETERS)[PARALLAX], 2)
        derivative[:, 0, along_x] = derivative[:, 1, along_y] = depth
        return derivative.reshape(-1, PARAMETERS)

    def _flat(self, own: Array) -> tuple[Array, Array]:
        """What points (n, 2) become without parallax, and by what they were divided (n, 1)."""
        (a, b), (stretch, skew) = self.similarity, self.shear
        linear = np.array([[a + stretch, skew - b], [b + skew, a - stretch]])
        below = np.maximum(1 + own @ self.perspective, LEAST_BELOW)[:, None]
        return (own @ linear.T + self.shift) / below, below


@dataclass(frozen=True)
class CameraChange:
    """What has become of one camera.

    Attributes:
        camera: 0, left, or 1, right.
        map: What its image points become.
        plane: How the other camera's points follow from this one's (3, 2), as far as they do.
        deviation_px: How far off the fit is in each camera (2,), in pixels, at points left out of it.
        parallax_px: How large the parallax is, root mean square over the points.
    """

    camera: int
    map: CameraMap
    plane: Array
    deviation_px: Array
    parallax_px: float

    def sensors(self, sensors: Array) -> Array:
        """What has become of sensor vectors (n, 4)."""
        changed = sensors.copy()
        changed[:, 2 * self.camera : 2 * self.camera + 2] = self.map(
            *_point_and_depth(sensors, self.camera, self.plane)
        )
        return changed

    def registers(self, registers: Array) -> Array:
        """What has become of registers (n, m): they stay."""
        return registers

    def old_home(self, motors: int) -> Array:
        """Registers (m,) that led where home is now: home."""
        return np.zeros(motors)

    log_prior = 0.0
    parameters = 4
    """How many numbers it is made of that nothing is known of beforehand: similarity and shift."""

    @property
    def kind(self) -> str:
        """What has been done to the camera."""
        turned, zoomed = abs(self.map.rotation) > TURNED, abs(np.log(self.map.scale)) > ZOOMED
        if turned:
            return "replaced" if zoomed else "rolled"
        if zoomed:
            return "moved" if self.parallax_px > PARALLAX_PX else "zoomed"
        return "moved" if self.deviation_px.max() > MOVED_PX else "re-aimed"


def turned(camera: int, before: Array, now: Array) -> CameraChange:
    """A camera that has turned, not rolled, so that what was at one image point (2,) is now at another."""
    parameters = np.zeros(PARAMETERS)
    parameters[SIMILARITY] = 1.0, 0.0
    shift = np.linalg.solve(np.eye(2) + INVERSE_FOCAL_SQUARE * np.outer(now, before), now - before)
    parameters[SHIFT], parameters[PERSPECTIVE] = shift, -INVERSE_FOCAL_SQUARE * shift
    return CameraChange(camera, CameraMap(parameters), np.zeros((3, 2)), np.zeros(2), 0.0)


def fit_camera(before: GaussianProcess, camera: int, since: Pairs) -> CameraChange:
    """Fits what has become of one camera: robust Gauss-Newton steps, with a prior towards a turned camera.

    Args:
        before: The gripper's points by registers, from before the change; not empty.
        camera: 0, left, or 1, right.
        since: What was seen since.
    """
    views, view_variances, _ = before.at_all(since.registers)
    plane = _plane(before.looks.points.reshape(-1, 4), camera)
    own, depth = _point_and_depth(views.reshape(-1, 4), camera, plane)
    seen, _ = _both(since.sensors, camera)
    known_variances = view_variances[:, camera] + np.square(since.noise_px * IMAGE_UNIT)
    variances = known_variances
    parameters = _similarity(own, seen, variances)
    for _ in range(ITERATIONS):
        fitted = CameraMap(parameters)
        errors, jacobian = seen - fitted(own, depth), fitted.derivative(own, depth)
        weights = huber_weights(np.hypot(*errors.T) / np.sqrt(variances), HUBER) / variances
        prior_mean, prior_std = _prior(fitted)
        jt_w = jacobian.T * weights.repeat(2)
        covariance = np.linalg.inv(jt_w @ jacobian + np.diag(prior_std**-2))
        gradient = jt_w @ errors.ravel() + (prior_mean - parameters) / prior_std**2
        parameters = parameters + covariance @ gradient
        leverage = np.einsum("ij,ji->i", jacobian @ covariance, jt_w)
        left_out = errors.ravel() / np.maximum(1 - leverage, LEAST_LEFT)
        left_out_variance = coordinate_variance(left_out.reshape(-1, 2))
        variances = known_variances + max(0.0, left_out_variance - np.median(known_variances)) / 2
    deviation_px = np.zeros(2)
    deviation_px[camera] = np.sqrt(left_out_variance) / IMAGE_UNIT
    fitted = CameraMap(parameters)
    parallax_px = float(np.sqrt(np.square(depth @ fitted.parallax.T).sum(1).mean())) / IMAGE_UNIT
    return CameraChange(camera, fitted, plane, deviation_px, parallax_px)


def _plane(sensors: Array, camera: int) -> Array:
    """How the other camera's points follow from this one's (3, 2): affine least squares over (n, 4).

    The ridge of 1e-4 is a guard for fewer than three points.
    """
    own, other = _both(sensors, camera)
    known = np.column_stack([np.ones(len(own)), own])
    return np.asarray(np.linalg.solve(known.T @ known + 1e-4 * np.eye(3), known.T @ other))


def _point_and_depth(sensors: Array, camera: int, plane: Array) -> tuple[Array, Array]:
    """A camera's points p (n, 2), and their depth q (n, 2)."""
    own, other = _both(sensors, camera)
    return own, other - np.column_stack([np.ones(len(own)), own]) @ plane


def _both(sensors: Array, camera: int) -> tuple[Array, Array]:
    """A camera's points (n, 2), and the other's."""
    points = sensors.reshape(-1, 2, 2)
    return points[:, camera], points[:, 1 - camera]


def _prior(fitted: CameraMap) -> tuple[Array, Array]:
    """Mean (12,) and standard deviations (12,) of the parameters.

    Where a camera with square pixels turns, the perspective follows from the shift; how exactly depends on a
    focal length that nobody knows.
    """
    (a, b), (x, y) = fitted.similarity, fitted.shift
    mean, std = np.zeros(PARAMETERS), np.full(PARAMETERS, WIDE_STD)
    mean[SIMILARITY] = 1.0, 0.0
    turned_back = np.array([a * x + b * y, a * y - b * x])
    mean[PERSPECTIVE] = -INVERSE_FOCAL_SQUARE * turned_back / max(a * a + b * b, LEAST_SCALE_SQUARE)
    std[SHEAR] = SHEAR_STD
    std[PERSPECTIVE] = PERSPECTIVE_STD + PERSPECTIVE_SHARE * np.hypot(x, y)
    std[PARALLAX] = PARALLAX_STD
    return mean, std


def _similarity(own: Array, seen: Array, variances: Array) -> Array:
    """Parameters (12,) of the similarity that fits best; of a shift alone where there is but one point."""
    parameters = np.zeros(PARAMETERS)
    weights = 1 / variances
    for _ in range(SIMILARITY_ITERATIONS):
        centre, there = np.average(own, 0, weights), np.average(seen, 0, weights)
        (x, y), (u, v) = (own - centre).T, (seen - there).T
        guard = 1e-9 * weights.max()
        length = weights @ (x * x + y * y) + guard
        a = (weights @ (x * u + y * v) + guard) / length
        b = weights @ (x * v - y * u) / length
        parameters[SIMILARITY] = a, b
        parameters[SHIFT] = there - [a * centre[0] - b * centre[1], b * centre[0] + a * centre[1]]
        errors = np.hypot(*(seen - CameraMap(parameters)(own, np.zeros_like(own))).T)
        weights = huber_weights(errors / np.sqrt(variances), HUBER) / variances
    return parameters
