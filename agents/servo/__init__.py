"""Servos: procedures that seek the rendezvous, written to be read beside the paper."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .jacobian_servo import JacobianServo
from .paper import PaperServo
from .servo_agent import Servo
from .unified import UnifiedServo
from .work_plane import WorkPlaneServo

SERVOS: dict[str, type[PaperServo | JacobianServo | UnifiedServo | WorkPlaneServo]] = {
    "paper_servo": PaperServo,
    "jacobian_servo": JacobianServo,
    "unified_servo": UnifiedServo,
    "work_plane_servo": WorkPlaneServo,
}
"""The servos that knowledge can be laid over."""


def make_servo(name: str, settings: Mapping[str, Any]) -> Servo:
    """Makes a servo by its name in `SERVOS`.

    Raises:
        ValueError: A setting is not allowed.
    """
    return SERVOS[name](**settings)
