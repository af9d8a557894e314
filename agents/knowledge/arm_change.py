"""What has become of the arm, where both cameras show it at once: registers that now mean other places."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from agents.agent import Array
from agents.knowledge.gaussian_process import GaussianProcess
from agents.knowledge.robust import robust_weights
from calfree_gym.world import IMAGE_UNIT


@dataclass(frozen=True)
class ArmChange:
    """Registers that once led to a place times `scale` (m,), plus `offset` (m,), now lead there.

    A motor of another gain, or reversed, changes its scale; a joint's zero shifts its offset. A link of another
    length is neither, and fits badly.

    Attributes:
        deviation_px: How far the fit is off, in each camera (2,), in pixels, for the parameters it spent.
    """

    scale: Array
    offset: Array
    deviation_px: Array

    def __call__(self, sensors: Array, registers: Array) -> tuple[Array, Array]:
        """Sensor vectors (n, 4) and the registers (n, m) that now belong to them."""
        return sensors, registers * self.scale + self.offset


UNSURE = 0.5
"""Prior standard deviation of scale, about 1 or -1, and of offset, about 0."""


def fit_arm(before: GaussianProcess, sensors: Array, registers: Array) -> ArmChange | None:
    """Fits what has become of the arm; None where the old knowledge sees no sense in what is seen.

    Args:
        before: Knowledge from before the change.
        sensors: Sensor vectors (n, 4) seen since.
        registers: Where (n, m).
    """
    recalls = [before.recall(each) for each in sensors]
    once = np.array([each.registers for each in recalls if each is not None])
    trust = np.array([1 / (1 + each.deviation_px) for each in recalls if each is not None])
    if len(once) < len(sensors):
        return None
    scale, offset = np.empty_like(once[0]), np.empty_like(once[0])
    for motor in range(once.shape[1]):
        scale[motor], offset[motor] = _line(once[:, motor], registers[:, motor], trust)
    views = np.array([before.view(each)[0] for each in (registers - offset) / scale])
    missed = (sensors - views).reshape(-1, 2, 2)
    spent = len(missed) / max(len(missed) - once.shape[1], 1)
    return ArmChange(scale, offset, np.sqrt(np.square(missed).sum(2).mean(0) * spent / 2) / IMAGE_UNIT)


def _line(once: Array, now: Array, trust: Array) -> tuple[float, float]:
    """Scale and offset of a line, by robust least squares with a prior."""
    weights = trust / IMAGE_UNIT**2
    sign = 1.0 if weights @ (once * now) >= 0 else -1.0
    known = np.column_stack([once, np.ones_like(once)])
    line = np.array([sign, 0.0])
    heavy = weights
    for _ in range(8):
        normal = (known.T * heavy) @ known + np.eye(2) / UNSURE**2
        line = np.linalg.solve(normal, (known.T * heavy) @ now + np.array([sign, 0]) / UNSURE**2)
        heavy = weights * robust_weights((now - known @ line) / 0.01)
    return float(line[0] if abs(line[0]) > 0.1 else sign), float(line[1])
