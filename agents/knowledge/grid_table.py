"""The paper's table: registers at the corners of a grid in sensor space (section 4.2; Xie et al. 1997)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calfree_gym.errors import check_flag
from calfree_gym.image import IMAGE_UNIT

from ..base.checks import check_number, checked_array
from ..base.observation import Array, camera_lengths_px
from ..base.prior_knowledge import PriorKnowledge
from .learning_servo import LearningServo, Recall, knowledge_base


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


PAPER = {"every_look": False, "servo": "paper_servo", "jump_px": math.inf}
"""Settings of the agent `grid_table`: with the paper's table only success teaches, what is recalled is always
tried, and the paper's servo corrects."""


@knowledge_base(
    "grid_table",
    "The paper's table: words that succeeded, interpolated over image points.",
    LearningServo,
    lambda given: PAPER,
)
class GridTable:
    """4-D sensor space in `cells`**4 hypercubes, with a record of registers at each of their corners.

    Or 6-D, where the object's direction in both images joins it (section 4.3). A cell met for the first time
    gets the registers that led to success at all of its corners without a record. A cell whose corners all
    have records recalls by multilinear interpolation; each success
    then corrects the corners by their interpolation weights, so that nearer corners change more. How
    Xie et al. weighted distance is not public; this is the smallest change of the corners that removes the
    share `rate` of the recall's error.

    Attributes:
        records: Registers (corners, m), in the order of `numpy.ndindex`; NaN where there is none.
        variances: Of where records lead (corners,), in px². One that is filled from elsewhere in its cell is
            off by the distance.
        successes: How many have corrected each record (corners,).

    Args:
        motors: Number of registers m.
        cells: Cells along each sensor dimension.
        rate: Share of a recall's error that one success corrects, where the gain is constant.
        kalman: Whether a Kalman filter for each record decides instead.
        dimensions: Of the keys.
    """

    prior_knowledge = frozenset({PriorKnowledge.IMAGE_SCALE})
    SUCCESS_VARIANCE = 8.0
    """Of a success, px². Derived: an end anywhere within 4 px of the object misses by 4 px / √2."""
    DRIFT_VARIANCE = 2.0
    """What one success adds to variances, px². Derived: a camera that pans by 0.2 px a trial has panned by
    10 px when a cell is met again after some 50 trials, and 10² = 50 · 2."""
    TRUSTED = 3
    """A cell is trusted once this many successes have corrected each of its records. Choice; pictures
    only."""

    def __init__(
        self, motors: int, cells: int = 8, rate: float = 0.7, kalman: bool = False, dimensions: int = 4
    ) -> None:
        self.cells = check_number("cells", cells, least=1, whole=True)
        self.gain = Gain(rate, kalman, self.SUCCESS_VARIANCE, self.DRIFT_VARIANCE)
        self.records = np.full(((cells + 1) ** dimensions, motors), np.nan)
        self.variances = np.zeros(len(self.records))
        self.successes = np.zeros(len(self.records))
        self._strides = (cells + 1) ** np.arange(dimensions)[::-1]
        self._corners = np.array(list(product((0, 1), repeat=dimensions)))
        axes = np.meshgrid(*[np.linspace(-1, 1, cells + 1)] * dimensions, indexing="ij")
        self._places = np.stack(axes, -1).reshape(-1, dimensions)

    def __repr__(self) -> str:
        return f"GridTable(cells={self.cells}, rate={self.gain.rate}, kalman={self.gain.kalman})"

    def recall(self, sensors: Array) -> Recall | None:
        """Registers interpolated from the corners of the cell; None where one of them has no record."""
        corners, weights = self._cell(sensors)
        records = self.records[corners]
        if np.isnan(records).any():
            return None
        return Recall(weights @ records, float(np.sqrt(weights**2 @ self.variances[corners])))

    def jacobian(self, registers: Array) -> None:
        """See `Knowledge`. None: as in the paper, test motions measure J."""

    def learn(self, sensors: Array, registers: Array) -> None:
        """A success: fills the empty corners of its cell, then corrects all, nearer ones more."""
        corners, weights = self._cell(sensors)
        self.variances = self.gain.aged(self.variances)
        records, variances = self.records[corners], self.variances[corners]
        empty = np.isnan(records).any(1)
        records[empty] = registers
        variances[empty] = squared_px(self._places[corners[empty]] - sensors)
        gains, self.variances[corners] = self.gain.correct(weights, variances)
        self.records[corners] = records + gains[:, None] * (registers - weights @ records)
        self.successes[corners] += 1

    def arrays(self) -> dict[str, NDArray[Any]]:
        return {name: getattr(self, name).copy() for name in ("records", "variances", "successes")}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        corners, motors = self.records.shape
        records = checked_array(arrays, "records", (corners, motors), allow_nan=True)
        variances = checked_array(arrays, "variances", (corners,))
        successes = checked_array(arrays, "successes", (corners,))
        self.records, self.variances, self.successes = records, variances, successes

    def known_cells(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which cells are filled, and which of them are trusted, each (cells, cells, ...)."""
        shape = [self.cells] * len(self._strides)
        cells = np.array(list(np.ndindex(*shape)))
        corners = (cells[:, None] + self._corners) @ self._strides
        filled = ~np.isnan(self.records[corners][..., 0]).any(1)
        trusted = filled & (self.successes[corners].min(1) >= self.TRUSTED)
        return filled.reshape(shape), trusted.reshape(shape)

    def _cell(self, sensors: Array) -> tuple[NDArray[np.intp], Array]:
        """The corners (..., k) around keys (..., dimensions), and their interpolation weights (..., k)."""
        place = np.round((np.clip(sensors, -1, 1) + 1) / 2 * self.cells, 9)
        cell = np.minimum(place.astype(np.intp), self.cells - 1)
        part = (place - cell)[..., None, :]
        weights = np.where(self._corners, part, 1 - part).prod(-1)
        return (cell[..., None, :] + self._corners) @ self._strides, weights
