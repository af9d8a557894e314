"""What has become of the arm, where both cameras show it at once: registers that now mean other places."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from calfree_gym.image import IMAGE_UNIT, rounded

from ..base.observation import Array
from ..base.weights import huber_weights
from .camera_change import HUBER, coordinate_variance
from .pairs import Pairs

if TYPE_CHECKING:
    from .remembered import Remembered

PRIOR_STD = 0.5
"""Prior deviation of a scale, about 1 or -1, and of an offset, about 0. Choice: gains of wild worlds differ
by up to a factor of 4, joint zeros by some tenths of a register."""
ITERATIONS = 8
"""Gauss-Newton steps (a guard: more change nothing)."""
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

    @property
    def parameters(self) -> int:
        """How many numbers it is made of."""
        return 2 * len(self.scale)

    @property
    def log_prior(self) -> float:
        """The logarithm of how probable it is beforehand, but for a constant."""
        apart = np.concatenate([np.abs(self.scale) - 1, self.offset])
        return -float(apart @ apart) / (2 * PRIOR_STD**2)

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


def fit_arm(before: Remembered, since: Pairs) -> ArmChange:
    """Fits what has become of the arm; no motor has changed its sign, or one has.

    Args:
        before: What was known before the change.
        since: What was seen since.
    """
    motors = before.motors
    signs = [np.ones(motors), *(np.ones(motors) - 2 * np.eye(motors))]
    fits = [_fit(before, since, each) for each in signs]
    scale, offset, _ = min(fits, key=lambda fit: rounded(fit[2]))
    errors, *_ = _errors(before, since, scale, offset)
    correction = len(errors) / max(len(errors) - motors, 1)
    deviation_px = np.sqrt([coordinate_variance(camera) * correction for camera in errors.swapaxes(0, 1)])
    return ArmChange(scale, offset, deviation_px / IMAGE_UNIT)


def _fit(before: Remembered, since: Pairs, signs: Array) -> tuple[Array, Array, float]:
    """Scales (m,) of these signs, offsets (m,), and how badly they fit: robust Gauss-Newton steps."""
    motors, prior = len(signs), np.concatenate([signs, np.zeros(len(signs))])
    parameters, best = prior, (signs, np.zeros(len(signs)), np.inf)
    for _ in range(ITERATIONS):
        scale, offset = parameters[:motors], parameters[motors:]
        scale = signs * np.maximum(signs * scale, LEAST_SCALE)
        errors, variances, slopes = _errors(before, since, scale, offset)
        sizes = np.hypot(errors[..., 0], errors[..., 1]) / np.sqrt(variances)
        weights = huber_weights(sizes, HUBER) / variances
        apart = parameters - prior
        misfit = (np.minimum(sizes, HUBER) * sizes + np.log(variances)).sum()
        badness = float(misfit + apart @ apart / PRIOR_STD**2)
        if badness < best[2]:
            best = scale, offset, badness
        weighed = slopes * weights[..., None, None]
        normal = np.einsum("kpci,kpcj->ij", weighed, slopes) + np.eye(2 * motors) / PRIOR_STD**2
        step = np.linalg.solve(normal, np.einsum("kpci,kpc->i", weighed, errors) - apart / PRIOR_STD**2)
        parameters = np.concatenate([scale, offset]) + step
    return best


def _errors(before: Remembered, since: Pairs, scale: Array, offset: Array) -> tuple[Array, Array, Array]:
    """How far gripper and object are seen from where they should be (k, 2, 2).

    The object's home view was another one from where home was before.

    Returns:
        Those errors, their variances (k, 2), and how points change with scales and offsets (k, 2, 2, 2 m).
    """
    old, home = (since.registers - offset) / scale, -offset / scale
    errors, variances, slopes = before.gripper_errors(since, old)
    moved = _by_parameters(slopes, old, scale)
    shown = since.with_object
    seen, at_home = since.only(shown), replace(since.only(shown), objects=since.homes[shown])
    off, off_variances, slopes = before.object_errors(seen, old[shown])
    homes, _, home_slopes = before.object_errors(at_home, np.tile(home, (len(seen), 1)))
    off_moved = _by_parameters(slopes, old[shown], scale) - _by_parameters(home_slopes, home, scale)
    return (
        np.concatenate([errors, off - homes]),
        np.concatenate([variances, off_variances]),
        np.concatenate([moved, off_moved]),
    )


def _by_parameters(slopes: Array, old: Array, scale: Array) -> Array:
    """Derivatives by scales and offsets (k, 2, 2, 2 m), from those by the old registers (k, 2, 2, m)."""
    return np.concatenate([slopes * -(np.atleast_2d(old) / scale)[:, None, None], slopes * -(1 / scale)], 3)
