"""What has become of the arm, where both cameras show it at once: registers that now mean other places."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calfree_gym.image import IMAGE_UNIT

from ..base.observation import Array
from ..base.robust import huber_weights
from ..servo.smooth_function import SmoothFunction
from .pairs import Pairs
from .robust import HUBER, coordinate_variance

PRIOR_STD = 0.5
"""Prior deviation of a scale, about 1 or -1, and of an offset, about 0. Choice: gains of wild worlds differ
by up to a factor of 4, joint zeros by some tenths of a register."""
ITERATIONS = 8
"""Gauss-Newton steps. Choice."""
LEAST_SCALE = 0.1
"""Guard: a motor's scale is no smaller, so that it can be undone."""


@dataclass(frozen=True)
class ArmChange:
    """Where registers r led, r * scale + offset now leads.

    A motor of another gain, or reversed, changes its scale; a joint's other zero shifts its offset. A link of
    another length does neither, and fits badly.

    Attributes:
        scale: Of each motor (m,).
        offset: Of each motor (m,).
        deviation_px: How far off that is in each camera (2,), in pixels; larger where there were hardly more
            pairs than motors.
    """

    scale: Array
    offset: Array
    deviation_px: Array

    kind = "arm changed"

    def sensors(self, sensors: Array) -> Array:
        """What has become of sensor vectors (n, 4): they stay."""
        return sensors

    def registers(self, registers: Array) -> Array:
        """Registers (n, m) that now lead where these led."""
        return registers * self.scale + self.offset

    def old_home(self, motors: int) -> Array:
        """Registers (m,) that led where home is now."""
        assert motors == len(self.scale)
        return -self.offset / self.scale


def fit_arm(before: SmoothFunction, since: Pairs) -> ArmChange:
    """Fits what has become of the arm; no motor has changed its sign, or one has.

    Args:
        before: The gripper's points by registers, from before the change; not empty.
        since: What was seen since.
    """
    motors = since.registers.shape[1]
    signs = [np.ones(motors), *(np.ones(motors) - 2 * np.eye(motors))]
    fits = [_fit(before, since, each) for each in signs]
    scale, offset, _ = min(fits, key=lambda fit: fit[2])
    errors, *_ = _errors(before, since, scale, offset)
    correction = len(since) / max(len(since) - motors, 1)
    deviation_px = np.sqrt([coordinate_variance(camera) * correction for camera in errors.swapaxes(0, 1)])
    return ArmChange(scale, offset, deviation_px / IMAGE_UNIT)


def _fit(before: SmoothFunction, since: Pairs, signs: Array) -> tuple[Array, Array, float]:
    """Scales (m,) of these signs, offsets (m,), and how badly they fit: robust Gauss-Newton steps."""
    motors, prior = len(signs), np.concatenate([signs, np.zeros(len(signs))])
    parameters, best = prior, (signs, np.zeros(motors), np.inf)
    for _ in range(ITERATIONS):
        scale, offset = parameters[:motors], parameters[motors:]
        scale = signs * np.maximum(signs * scale, LEAST_SCALE)
        errors, variances, slopes = _errors(before, since, scale, offset)
        sizes = np.hypot(errors[..., 0], errors[..., 1]) / np.sqrt(variances)
        weights = huber_weights(sizes, HUBER) / variances
        apart = parameters - prior
        misfit = np.minimum(sizes, HUBER) * sizes + np.log(variances)
        badness = float(misfit.sum() + apart @ apart / PRIOR_STD**2)
        if badness < best[2]:
            best = scale, offset, badness
        old = (since.registers - offset) / scale
        moved = np.concatenate([slopes * -(old / scale)[:, None, None], slopes * -(1 / scale)], 3)
        weighed = moved * weights[..., None, None]
        normal = np.einsum("kpci,kpcj->ij", weighed, moved) + np.eye(2 * motors) / PRIOR_STD**2
        step = np.linalg.solve(normal, np.einsum("kpci,kpc->i", weighed, errors) - apart / PRIOR_STD**2)
        parameters = np.concatenate([scale, offset]) + step
    return best


def _errors(before: SmoothFunction, since: Pairs, scale: Array, offset: Array) -> tuple[Array, Array, Array]:
    """How far what was seen is from what should be (k, 2, 2), variances (k, 2), and slopes (k, 2, 2, m)."""
    points, variances, slopes = before.at_all((since.registers - offset) / scale)
    noise = np.square(since.noise_px * IMAGE_UNIT)
    return since.sensors.reshape(-1, 2, 2) - points, variances + noise[:, None], slopes
