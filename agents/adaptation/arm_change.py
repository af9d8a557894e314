"""What has become of the arm, where both cameras show it at once: registers that now mean other places."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from agents.adaptation.robust import coordinate_variance, huber_weights
from agents.base.agent import Array
from agents.knowledge.gaussian_process import GaussianProcess
from calfree_gym.image import IMAGE_UNIT

UNSURE = 0.5
"""Prior standard deviation of a scale, about 1 or -1, and of an offset, about 0."""
SCATTER = 0.01
"""Standard deviation of a register that is recalled."""


@dataclass(frozen=True)
class ArmChange:
    """Where registers r led, r * scale + offset now leads.

    A motor of another gain, or reversed, changes its scale; a joint's other zero shifts its offset. A link of
    another length does neither, and fits badly.

    Attributes:
        scale: Of each motor (m,).
        offset: Of each motor (m,).
        deviation_px: How far off that is in each camera (2,), in pixels, for as many numbers as it took.
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
        sensors: Sensor vectors (n, 4) seen since.
        registers: Where (n, m).
    """
    recalls = [recall for each in sensors if (recall := before.recall(each))]
    once = np.array([recall.registers for recall in recalls])
    trust = 1 / np.square([1 + recall.deviation_px for recall in recalls])
    lines = [_line(*both, trust) for both in zip(once.T, registers.T, strict=True)]
    scale, offset = np.array(lines).T
    views, _ = before.views((registers - offset) / scale)
    missed = (sensors - views).reshape(-1, 2, 2).swapaxes(0, 1)
    spent = len(sensors) / max(len(sensors) - registers.shape[1], 1)
    deviation_px = np.sqrt([coordinate_variance(camera) * spent for camera in missed]) / IMAGE_UNIT
    return ArmChange(scale, offset, deviation_px)


def _line(once: Array, now: Array, trust: Array) -> tuple[float, float]:
    """Scale and offset of now (n,) over once (n,): robust least squares, and a prior that nothing changed."""
    known = np.column_stack([once, np.ones_like(once)])
    nothing = np.array([1.0 if trust @ (once * now) >= 0 else -1.0, 0.0])
    line = nothing
    for _ in range(8):
        weights = trust * huber_weights((now - known @ line) / SCATTER) / SCATTER**2
        normal = (known.T * weights) @ known + np.eye(2) / UNSURE**2
        line = np.linalg.solve(normal, (known.T * weights) @ now + nothing / UNSURE**2)
    scale = np.sign(nothing[0]) * max(abs(line[0]), 0.1)
    return float(scale), float(line[1])
