"""What has become of one camera's image points.

A rotation about the optical centre, a roll and a zoom move all points of a camera by one homography, whatever
their depth. A camera that was moved shows parallax besides: a part that follows the depth, of which the other
camera tells. One that was replaced may follow neither.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from agents.adaptation.robust import coordinate_variance, huber_weights
from agents.base.agent import Array
from agents.knowledge.gaussian_process import GaussianProcess
from calfree_gym.image import IMAGE_UNIT

FOCUS = 0.6
"""1 / f² in square image units: the perspective that goes with a shift where a camera is turned."""
ITERATIONS = 12
TURNED, ZOOMED = np.radians(3), 0.04
"""Rotation, and logarithm of the scale, of a camera that was rolled, zoomed; replaced, if it was both."""
MOVED_PX, PARALLAX_PX = 1.0, 1.5
"""Deviation of the fit, and part that follows the depth, of a camera that was moved."""


@dataclass(frozen=True)
class CameraChange:
    """A camera's image point p becomes (A p + t) / (1 + g·p) + B q.

    A is a rotation and scale (a, b) with a little shear, t a shift, g perspective, and q what of the other
    camera's point does not follow from p: its depth.

    Attributes:
        camera: 0, left, or 1, right.
        parameters: (12,): a, b, shear (2), t (2), g (2), B (4).
        plane: How the other camera's points follow from p (3, 2), as far as they do.
        deviation_px: How far off the fit is in each camera (2,), in pixels, at points left out of it.
        parallax_px: How large the part B q is, root mean square over the points.
    """

    camera: int
    parameters: Array
    plane: Array
    deviation_px: Array
    parallax_px: float

    def __call__(self, sensors: Array, registers: Array) -> tuple[Array, Array]:
        """What has become of sensor vectors (n, 4); and their registers (n, m), which stay."""
        changed = sensors.copy()
        own, depth = _split(sensors, self.camera, self.plane)
        changed[:, 2 * self.camera : 2 * self.camera + 2] = _image(self.parameters, own, depth)[0]
        return changed, registers

    @property
    def kind(self) -> str:
        """What has been done to the camera."""
        a, b = self.parameters[:2]
        turned, zoomed = abs(np.arctan2(b, a)) > TURNED, abs(np.log(np.hypot(a, b))) > ZOOMED
        if turned:
            return "replaced" if zoomed else "rolled"
        if zoomed:
            return "moved" if self.parallax_px > PARALLAX_PX else "zoomed"
        return "moved" if self.deviation_px.max() > MOVED_PX else "re-aimed"


def fit_camera(before: GaussianProcess, camera: int, sensors: Array, registers: Array) -> CameraChange:
    """Fits what has become of one camera: robust Gauss-Newton steps, with a prior towards a turned camera.

    Args:
        before: Views from before the change; not empty.
        camera: 0, left, or 1, right.
        sensors: Sensor vectors (n, 4) seen since.
        registers: Where (n, m).
    """
    views, unsure = before.views(registers)
    plane = _plane(before.sensors, camera)
    own, depth = _split(views, camera, plane)
    seen = sensors[:, 2 * camera : 2 * camera + 2]
    sure = unsure[:, camera] + before.noise
    variances = sure
    parameters = _similarity(own, seen, variances)
    for _ in range(ITERATIONS):
        image, derivative = _image(parameters, own, depth)
        missed = (seen - image).ravel()
        weights = huber_weights(np.hypot(*(seen - image).T) / np.sqrt(variances)) / variances
        expected, deviation = _prior(parameters)
        heavy = derivative.T * weights.repeat(2)
        covariance = np.linalg.inv(heavy @ derivative + np.diag(deviation**-2))
        parameters = parameters + covariance @ (heavy @ missed + (expected - parameters) / deviation**2)
        leverage = np.einsum("ij,ji->i", derivative @ covariance, heavy)
        left_out = coordinate_variance((missed / np.maximum(1 - leverage, 0.05)).reshape(-1, 2))
        variances = sure + max(0.0, left_out - np.median(sure)) / 2
    deviation_px = np.zeros(2)
    deviation_px[camera] = np.sqrt(left_out) / IMAGE_UNIT
    parallax = depth @ parameters[8:].reshape(2, 2).T
    parallax_px = float(np.sqrt(np.square(parallax).sum(1).mean())) / IMAGE_UNIT
    return CameraChange(camera, parameters, plane, deviation_px, parallax_px)


def _plane(sensors: Array, camera: int) -> Array:
    """How the other camera's points follow from this one's (3, 2): affine least squares over (n, 4)."""
    own, other = _both(sensors, camera)
    known = np.column_stack([np.ones(len(own)), own])
    return np.asarray(np.linalg.solve(known.T @ known + 1e-4 * np.eye(3), known.T @ other))


def _split(sensors: Array, camera: int, plane: Array) -> tuple[Array, Array]:
    """A camera's points p (n, 2), and q (n, 2)."""
    own, other = _both(sensors, camera)
    return own, other - np.column_stack([np.ones(len(own)), own]) @ plane


def _both(sensors: Array, camera: int) -> tuple[Array, Array]:
    """A camera's points (n, 2), and the other's."""
    points = sensors.reshape(-1, 2, 2)
    return points[:, camera], points[:, 1 - camera]


def _image(parameters: Array, own: Array, depth: Array) -> tuple[Array, Array]:
    """What points become (n, 2), and its derivative (2n, 12) by the parameters."""
    a, b, stretch, skew, *shift_and_perspective = parameters[:8]
    shift, perspective = np.reshape(shift_and_perspective, (2, 2))
    x, y = own.T
    linear = np.array([[a + stretch, skew - b], [b + skew, a - stretch]])
    below = np.maximum(1 + own @ perspective, 0.2)[:, None]
    flat = (own @ linear.T + shift) / below
    zero, one = np.zeros_like(x), np.ones_like(x)
    derivative = np.zeros((len(own), 2, len(parameters)))
    derivative[:, 0, :6] = np.column_stack([x, -y, x, y, one, zero]) / below
    derivative[:, 1, :6] = np.column_stack([y, x, -y, x, zero, one]) / below
    derivative[:, :, 6:8] = -flat[:, :, None] * (own / below)[:, None]
    derivative[:, 0, 8:10] = derivative[:, 1, 10:] = depth
    image = flat + depth @ parameters[8:].reshape(2, 2).T
    return image, derivative.reshape(-1, len(parameters))


def _prior(parameters: Array) -> tuple[Array, Array]:
    """Expected parameters (12,), and their standard deviations.

    Where a camera with square pixels turns, g follows from t; how exactly depends on a focal length that
    nobody knows.
    """
    a, b = parameters[:2]
    x, y = parameters[4:6]
    expected = np.zeros(12)
    expected[0] = 1.0
    expected[6:8] = -FOCUS * np.array([a * x + b * y, a * y - b * x]) / max(a * a + b * b, 0.05)
    unsure = 0.02 + 0.4 * np.hypot(x, y)
    return expected, np.array([1, 1, 0.03, 0.03, 1, 1, unsure, unsure, 0.1, 0.1, 0.1, 0.1])


def _similarity(own: Array, seen: Array, variances: Array) -> Array:
    """Parameters (12,) of the similarity that fits best; of a shift alone where there is but one point."""
    parameters = np.zeros(12)
    weights = 1 / variances
    for _ in range(8):
        centre, there = np.average(own, 0, weights), np.average(seen, 0, weights)
        (x, y), (u, v) = (own - centre).T, (seen - there).T
        little = 1e-9 * weights.max()
        length = weights @ (x * x + y * y) + little
        a = (weights @ (x * u + y * v) + little) / length
        b = weights @ (x * v - y * u) / length
        parameters[:2] = a, b
        parameters[4:6] = there - [a * centre[0] - b * centre[1], b * centre[0] + a * centre[1]]
        off = np.hypot(*(seen - _image(parameters, own, np.zeros_like(own))[0]).T)
        weights = huber_weights(off / np.sqrt(variances)) / variances
    return parameters
