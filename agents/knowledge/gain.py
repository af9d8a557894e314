"""How far each of several records is corrected where their weighted sum missed: two rules, one code."""

from __future__ import annotations

from dataclasses import dataclass

from agents.base.checks import check_flag, check_number
from agents.base.observation import Array


@dataclass(frozen=True)
class Gain:
    """A constant gain, or a Kalman filter (open in the paper, section 5).

    Variances are those of where a record's registers lead, in px²: the registers' own scale cancels in the
    gain. What the rules expect of an error is the same; only the gain differs.

    Attributes:
        rate: Share of an error that one success corrects, where the gain is constant.
        kalman: Whether each record is corrected by how uncertain it is.
        seen: Variance of what corrects, in px².
        drift: What one success adds to all variances, in px².
    """

    rate: float
    kalman: bool
    seen: float
    drift: float

    def __post_init__(self) -> None:
        check_number("rate", self.rate, above=0, most=1)
        check_flag("kalman", self.kalman)

    def aged(self, variances: Array) -> Array:
        """Variances (n,) one success later; a constant gain knows of no drift."""
        return variances + self.drift if self.kalman else variances

    def each(self, weights: Array, variances: Array, more: float = 0.0) -> tuple[Array, Array]:
        """Shares (k,) of the sum's error by which records change, and their variances (k,) after that.

        Args:
            weights: Of the records in the sum (k,).
            variances: Of the records (k,), each with a filter of its own, in px².
            more: Variance of what corrects beyond `seen`, in px².
        """
        told = variances * weights
        expected = float(weights @ told) + self.seen + more
        gains = self.shares(weights, told, expected)
        return gains, variances - 2 * gains * told + gains**2 * expected

    def shares(self, weights: Array, told: Array, expected: float) -> Array:
        """Shares (n,) of the sum's error by which records change.

        Args:
            weights: Of the records in the sum (n,).
            told: Covariances (n,) of the records with the sum, in px².
            expected: Variance of the error, in px².
        """
        return told / expected if self.kalman else self.rate * weights / (weights @ weights)
