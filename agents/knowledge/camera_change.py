"""What has become of one camera's image points, fitted to points seen before and after (paper, section 5).

A rotation about the optical centre, a roll and a zoom move all points of a camera by one homography, whatever
their depth. A camera that was moved shows parallax besides: a part that follows the depth, of which the other
camera tells. A camera that was replaced follows neither.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from agents.agent import Array
from agents.knowledge.gaussian_process import GaussianProcess
from calfree_gym.world import IMAGE_UNIT


@dataclass(frozen=True)
class CameraChange:
    """p' = (A p + t) / (1 + g·p) + B q, with q the other camera's point as far as p does not tell it.

    Attributes:
        camera: 0, left, or 1, right.
        turn: Of the rotation in A, in rad.
        scale: Of A.
        shift: t (2,), in image units.
        parallax: How much of the change follows the depth, in pixels, root mean square over the points.
        deviation_px: How far the fit is off where it was not fitted (leaving one out), in pixels.
        distance_px: How far points were displaced, root mean square.
    """

    camera: int
    parameters: Array
    plane: Array
    deviation_px: Array

    @property
    def turn(self) -> float:
        return float(np.arctan2(self.parameters[1], self.parameters[0]))

    @property
    def scale(self) -> float:
        return float(np.hypot(*self.parameters[:2]))

    def __call__(self, sensors: Array, registers: Array) -> tuple[Array, Array]:
        """What has become of sensor vectors (n, 4), and their registers (n, m), which stay."""
        own, depth = _split(sensors, self.camera, self.plane)
        changed = sensors.copy()
        changed[:, 2 * self.camera : 2 * self.camera + 2] = _image(self.parameters, own, depth)[0]
        return changed, registers


_SURE = np.array([0.0, 0.0, 0.03, 0.03, 0.0, 0.0, 0.0, 0.0, 0.1, 0.1, 0.1, 0.1])
FOCUS = 0.6
"""1 / f², in square image units: perspective that goes with a shift t where a camera of focal length f turns."""
ROBUST = 3.0


def fit_camera(knowledge: GaussianProcess, camera: int, sensors: Array, registers: Array) -> CameraChange:
    """Fits what has become of one camera.

    Args:
        knowledge: From before the change.
        camera: 0, left, or 1, right.
        sensors: Sensor vectors (n, 4) seen since.
        registers: Where (n, m).
    """
    views = [knowledge.view(each) for each in registers]
    before, after = np.array([view for view, _ in views]), sensors
    variances = np.array([variance[camera] for _, variance in views]) + knowledge.noise
    plane = _plane(knowledge.sensors, camera)
    own, depth = _split(before, camera, plane)
    seen = after[:, 2 * camera : 2 * camera + 2]
    parameters = _similarity(own, seen, variances)
    extra = 0.0
    for _ in range(12):
        image, derivative = _image(parameters, own, depth)
        missed = seen - image
        off = (missed * missed).sum(1) / (variances + extra)
        weights = 1 / (variances + extra) / np.maximum(1, np.sqrt(off) / ROBUST)
        sure, expected = _prior(parameters)
        jac = derivative.reshape(-1, len(parameters))
        heavy = np.repeat(weights, 2)
        information = (jac.T * heavy) @ jac + np.diag(sure)
        pulled = jac.T @ (heavy * missed.ravel()) + sure * (expected - parameters)
        inverse = np.linalg.inv(information)
        parameters = parameters + inverse @ pulled
        leverage = np.einsum("ij,jk,ik->i", jac, inverse, jac) * heavy
        left_out = missed.ravel() / np.maximum(1 - leverage, 0.05)
        squares = (left_out * left_out).reshape(-1, 2).sum(1) / 2
        extra = max(0.0, float(np.average(squares, weights=np.sqrt(weights)) - variances.mean())) * 0.5
    used = 1 / np.maximum(1, np.sqrt(off) / ROBUST)
    deviation = np.zeros(2)
    deviation[camera] = np.sqrt(np.average(squares, weights=used)) / IMAGE_UNIT
    return CameraChange(camera, parameters, plane, deviation)


def _plane(sensors: Array, camera: int) -> Array:
    """How the other camera's points follow from this one's: (3, 2), affine least squares over (n, 4)."""
    own = sensors[:, 2 * camera : 2 * camera + 2]
    other = sensors[:, 2 - 2 * camera : 4 - 2 * camera]
    known = np.column_stack([np.ones(len(own)), own])
    normal = known.T @ known + 1e-4 * np.eye(3)
    return np.asarray(np.linalg.solve(normal, known.T @ other))


def _split(sensors: Array, camera: int, plane: Array) -> tuple[Array, Array]:
    own = sensors[:, 2 * camera : 2 * camera + 2]
    other = sensors[:, 2 - 2 * camera : 4 - 2 * camera]
    return own, other - np.column_stack([np.ones(len(own)), own]) @ plane


def _image(parameters: Array, own: Array, depth: Array) -> tuple[Array, Array]:
    a, b, s1, s2, tx, ty, gx, gy = parameters[:8]
    x, y = own.T
    linear = np.array([[a + s1, s2 - b], [b + s2, a - s1]])
    below = np.maximum(1 + own @ [gx, gy], 0.2)
    flat = (own @ linear.T + [tx, ty]) / below[:, None]
    derivative = np.zeros((len(own), 2, 12))
    zero, one = np.zeros_like(x), np.ones_like(x)
    derivative[:, 0, :6] = np.column_stack([x, -y, x, y, one, zero]) / below[:, None]
    derivative[:, 1, :6] = np.column_stack([y, x, -y, x, zero, one]) / below[:, None]
    derivative[:, :, 6:8] = -flat[:, :, None] * own[:, None] / below[:, None, None]
    derivative[:, 0, 8:10] = depth
    derivative[:, 1, 10:12] = depth
    return flat + depth @ parameters[8:].reshape(2, 2).T, derivative


def _prior(parameters: Array) -> tuple[Array, Array]:
    a, b, _, _, tx, ty = parameters[:6]
    expected = np.zeros(12)
    expected[0] = 1.0
    expected[6:8] = -FOCUS * np.array([a * tx + b * ty, a * ty - b * tx]) / max(a * a + b * b, 0.05)
    deviation = np.array([1.0, 1.0, 0.03, 0.03, 1.0, 1.0, 0, 0, 0.1, 0.1, 0.1, 0.1])
    deviation[6:8] = 0.02 + 0.4 * np.hypot(tx, ty)
    return 1 / deviation**2, expected


def _similarity(own: Array, seen: Array, variances: Array) -> Array:
    """Parameters of the similarity that fits best, by least absolute deviations from few restarts."""
    parameters = np.zeros(12)
    weights = 1 / variances
    for _ in range(8):
        mean, there = np.average(own, 0, weights), np.average(seen, 0, weights)
        p, q = own - mean, seen - there
        length = weights @ (p * p).sum(1) + 1e-9 / variances.min()
        a = (weights @ (p * q).sum(1) + 1e-9 / variances.min()) / length
        b = weights @ (p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]) / length
        shift = there - np.array([a * mean[0] - b * mean[1], b * mean[0] + a * mean[1]])
        parameters[[0, 1, 4, 5]] = a, b, *shift
        off = np.hypot(*(seen - _image(parameters, own, np.zeros_like(own))[0]).T)
        weights = 1 / variances / np.maximum(1.0, off / np.sqrt(variances) / ROBUST)
    return parameters
