"""Settings that all servos share: their checks, and what they are built on."""

from __future__ import annotations

from typing import Any

from ..base.checks import check_number
from ..base.prior_knowledge import PriorKnowledge

SERVO_KNOWLEDGE = frozenset({PriorKnowledge.IMAGE_SCALE, PriorKnowledge.NOISE, PriorKnowledge.WORD_LIMIT})
"""What most servos are built on: lengths in pixels, the noise of a good marker, sizes of words."""
SMALLEST = 1e-6
"""Of settings that must be positive (a guard: some are divided by)."""


def check_motions(servo: Any) -> None:
    """Raises ValueError where a setting of test motions and steps is not allowed."""
    for name in ("test_px", "step_px", "border"):
        check_number(name, getattr(servo, name), least=SMALLEST)
    for name in ("first_word", "step_word"):
        check_number(name, getattr(servo, name), least=SMALLEST, most=1)
    check_number("damping", servo.damping, least=0)
