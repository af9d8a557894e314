"""How far each of several records is corrected where their weighted sum missed: two rules, one code."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from agents.agent import Array


@dataclass(frozen=True)
class Gain:
    """A constant gain, or a Kalman filter for each record (open in the paper, section 5).

    Variances are those of where a record's registers lead, in px²: the registers' own scale cancels in the
    gain. What the rules expect of an error is the same; only the gain differs.

    Attributes:
        rate: Share of an error that one success corrects, where the gain is constant.
        kalman: Whether each record is corrected by how uncertain it is.
        seen: Variance of what corrects, in px².
    """

    rate: float
    kalman: bool
    seen: float

    DRIFT: ClassVar[float] = 2.0
    """What one success adds to all variances, px²: a camera that pans by 0.2 px a trial has panned by 10 px
    when a record is met again after 50 trials, and 10² = 50 · 2."""

    def __post_init__(self) -> None:
        rate = self.rate
        if isinstance(rate, bool) or not isinstance(rate, int | float) or not 0 < rate <= 1:
            raise ValueError(f"rate is {rate!r}; it must be a number above 0, at most 1")
        if not isinstance(self.kalman, bool):
            raise ValueError(f"kalman is {self.kalman!r}; allowed: True, False")

    @property
    def drift(self) -> float:
        """What is added to all variances, in px²; a constant gain knows of no drift."""
        return self.DRIFT if self.kalman else 0.0

    def __call__(self, weights: Array, variances: Array, more: float = 0.0) -> tuple[Array, Array]:
        """Shares (k,) of the sum's error by which records change, and their variances (k,) after that.

        Args:
            weights: Of the records in the sum (k,).
            variances: Of the records (k,), in px².
            more: Variance that what is seen there has of its own, in px².
        """
        expected = weights**2 @ variances + self.seen + more
        gains = variances * weights / expected if self.kalman else self.rate * weights / (weights @ weights)
        return gains, variances - 2 * gains * weights * variances + gains**2 * expected
