"""Checks of the settings that all servos share."""

from __future__ import annotations

from typing import Any

from agents.base.checks import check_number

SMALLEST = 1e-6
"""Of settings that must be positive (a guard: some are divided by)."""


def check_motions(servo: Any) -> None:
    """Raises ValueError where a setting of test motions and steps is not allowed."""
    for name in ("test_px", "step_px", "border"):
        check_number(name, getattr(servo, name), least=SMALLEST)
    for name in ("first_word", "step_word"):
        check_number(name, getattr(servo, name), least=SMALLEST, most=1)
    check_number("damping", servo.damping, least=0)
