"""What has become of the arm, where both cameras show it at once: registers that now mean other places."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calfree_gym.image import IMAGE_UNIT

from ..base.observation import Array
from ..base.robust import huber_weights
from ..knowledge.gaussian_process import GaussianProcess
from .robust import HUBER, coordinate_variance

PRIOR_STD = 0.5
"""Prior deviation of a scale, about 1 or -1, and of an offset, about 0. Choice: gains of wild worlds differ
by up to a factor of 4, joint zeros by some tenths of a register."""
REGISTER_STD = 0.01
"""Standard deviation of a register that is recalled. Derived: an error of some 2.5 px, where a register moves
a point by half an image, 256 px."""
ITERATIONS = 8
"""Reweightings of a line. Choice."""
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

    def __call__(self, sensors: Array, registers: Array) -> tuple[Array, Array]:
        """Sensor vectors (n, 4), and the registers (n, m) that now belong to them."""
        return sensors, registers * self.scale + self.offset


def fit_arm(before: GaussianProcess, sensors: Array, registers: Array) -> ArmChange:
    """Fits what has become of the arm.

    Args:
        before: Views from before the change; not empty.
        sensors: Sensor vectors (n, 4) seen since, in image units.
        registers: Where (n, m).
    """
    recalls = [recall for each in sensors if (recall := before.recall(each))]
    recalled = np.array([recall.registers for recall in recalls])
    weights = 1 / np.square([1 + recall.deviation_px for recall in recalls])
    lines = [_line(*motor, weights) for motor in zip(recalled.T, registers.T, strict=True)]
    scale, offset = np.array(lines).T
    views, _ = before.views((registers - offset) / scale)
    errors = (sensors - views).reshape(-1, 2, 2).swapaxes(0, 1)
    correction = len(sensors) / max(len(sensors) - registers.shape[1], 1)
    deviation_px = np.sqrt([coordinate_variance(camera) * correction for camera in errors]) / IMAGE_UNIT
    return ArmChange(scale, offset, deviation_px)


def _line(recalled: Array, now: Array, known: Array) -> tuple[float, float]:
    """Scale and offset of one motor's registers now (n,) over those recalled (n,).

    Robust least squares with weights `known` (n,); the prior is that nothing changed, but for the sign.
    """
    columns = np.column_stack([recalled, np.ones_like(recalled)])
    prior_mean = np.array([1.0 if known @ (recalled * now) >= 0 else -1.0, 0.0])
    line = prior_mean
    for _ in range(ITERATIONS):
        weights = known * huber_weights((now - columns @ line) / REGISTER_STD, HUBER) / REGISTER_STD**2
        jt_w = columns.T * weights
        normal = jt_w @ columns + np.eye(2) / PRIOR_STD**2
        line = np.linalg.solve(normal, jt_w @ now + prior_mean / PRIOR_STD**2)
    scale = np.sign(prior_mean[0]) * max(abs(line[0]), LEAST_SCALE)
    return float(scale), float(line[1])
