"""Where an agent expects the image points to be after its motion, if it has such expectations."""

from typing import Any

import numpy as np

from agents.base.observation import Array
from agents.body_schema.body_schema import BodySchema
from agents.servo.image_model.smooth_points import SmoothPoints
from agents.servo.safe.safe_start import SafeStart
from calfree_gym.image import IMAGE_UNIT

UNSURE_PX = 40.0
"""What an agent knows no better than this (standard deviation) is no prediction. Choice."""


class Predictions:
    """Asks an agent what it predicts, and changes nothing in it.

    Args:
        agent: Its findings in the present trial are kept at hand as it makes them.
    """

    def __init__(self, agent: Any) -> None:
        self._findings: Any = None
        other = isinstance(agent, BodySchema | SafeStart)  # a chain of joints; registers in other units
        if hasattr(agent, "new_findings") and not other:
            self._make = agent.new_findings
            agent.new_findings = self._new_findings

    def _new_findings(self) -> Any:
        self._findings = self._make()
        return self._findings

    def at(self, registers: Array) -> Array | None:
        """Image points (4, 2) at registers (m,), from all looks before; NaN where it is not sure.

        None where it predicts none.
        """
        points = getattr(self._findings, "estimator", None)
        if not isinstance(points, SmoothPoints):
            return None
        expected = points.at(registers)
        sure = np.sqrt(expected.variances) < UNSURE_PX * IMAGE_UNIT
        return np.where(sure[:, None], expected.points, np.nan)
