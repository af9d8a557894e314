"""How far each of several records is corrected where their weighted sum missed: two rules, one code."""

from dataclasses import dataclass

import numpy as np

from calfree_gym.errors import check_flag
from calfree_gym.image import IMAGE_UNIT

from ..base.checks import check_number
from ..base.observation import Array, camera_lengths_px


def squared_px(differences: Array) -> Array:
    """Square of the longer of the two image distances (...,), in px², of sensor differences (..., 4).

    Where there are six, the last two are of directions in both images: a quarter turn is like half an image.
    """
    squares = np.square(camera_lengths_px(differences[..., :4]))
    if differences.shape[-1] > 4:
        squares = squares + np.square(differences[..., 4:] / IMAGE_UNIT)
    return np.asarray(squares.max(-1))


@dataclass(frozen=True)
class Gain:
    """A constant gain, or a Kalman filter (open in the paper, section 5).

    Variances are those of where a record's registers lead, in px²: the registers' own scale cancels in the
    gain. What the rules expect of an error is the same; only the gain differs.

    Attributes:
        rate: Share of an error that one success corrects, where the gain is constant.
        kalman: Whether each record is corrected by how uncertain it is.
        success_variance: Of what corrects, in px².
        drift_variance: What one success adds to all variances, in px².
    """

    rate: float
    kalman: bool
    success_variance: float
    drift_variance: float

    def __post_init__(self) -> None:
        check_number("rate", self.rate, above=0, most=1)
        check_flag("kalman", self.kalman)

    def aged(self, variances: Array) -> Array:
        """Variances (n,) one success later; a constant gain knows of no drift."""
        return variances + self.drift_variance if self.kalman else variances

    def correct(self, weights: Array, variances: Array, more: float = 0.0) -> tuple[Array, Array]:
        """Shares (k,) of the sum's error by which records change, and their variances (k,) after that.

        Args:
            weights: Of the records in the sum (k,).
            variances: Of the records (k,), each with a filter of its own, in px².
            more: Variance of what corrects beyond `success_variance`, in px².
        """
        covariances = variances * weights
        error_variance = float(weights @ covariances) + self.success_variance + more
        gains = self.shares(weights, covariances, error_variance)
        return gains, variances - 2 * gains * covariances + gains**2 * error_variance

    def shares(self, weights: Array, covariances: Array, error_variance: float) -> Array:
        """Shares (n,) of the sum's error by which records change.

        Args:
            weights: Of the records in the sum (n,).
            covariances: Of the records with the sum (n,), in px².
            error_variance: Variance of the error that is expected, in px².
        """
        return covariances / error_variance if self.kalman else self.rate * weights / (weights @ weights)
