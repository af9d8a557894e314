"""Small tables over one or two sensor coordinates each, whose sum are registers (section 4.3)."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import IMAGE_UNIT

from ..base.checks import check_number, checked_array
from ..base.observation import Array
from ..base.prior_knowledge import PriorKnowledge
from .grid_table import Gain
from .learning_servo import LearningServo, Recall, knowledge_base

PAIRS = ((0, 1), (2, 3), (0, 2), (1, 3), (4, 5))
"""Coordinates that share a 2-D table: those of an image, and those alike in both; of directions both."""


@knowledge_base(
    "factored_table", "The paper's first alternative: several small tables, added up.", LearningServo
)
class FactoredTable:
    """Registers as the sum of 1-D tables of each sensor coordinate and 2-D tables of pairs of them.

    Records lie at `cells` + 1 places of a coordinate, or of both; between them the tables interpolate. With 8
    cells they are 360 records where the paper's table has 6561: so few that one Kalman filter keeps all their
    covariances, and shares out what a success teaches among the tables. A priori tables are smooth, so that
    a few successes already tell about the whole image.

    Attributes:
        records: Parts of registers (records, m): the 1-D tables', then the 2-D tables'.
        covariance: Of where they lead (records, records), in px²: the registers' own scale cancels.

    Args:
        motors: Number of registers m.
        cells: Cells along each sensor dimension.
        rate: Share of a recall's error that one success corrects, where the gain is constant.
        kalman: Whether the Kalman filter decides instead.
        dimensions: Of the keys: 6 where the object's direction in both images joins them.
    """

    prior_knowledge = frozenset({PriorKnowledge.IMAGE_SCALE})
    SCALE_PX = 1 / IMAGE_UNIT
    """Prior standard deviation of where nothing but home is known to lead. Derived: half an image, as objects
    may lie anywhere in it."""
    DEPARTURE_VARIANCE = 0.05
    """Prior variance of what is not a quadratic, as a share of `SCALE_PX`². Tuned (wild worlds 3000-)."""
    DEPARTURE_LENGTH = 0.6
    """How far such a departure reaches in the images, in image units. Tuned, as above."""
    SUCCESS_VARIANCE = 8.0
    """Of a success, px². Derived: an end anywhere within 4 px of the object misses by 4 px / √2."""
    DRIFT_VARIANCE = 0.2
    """What one success adds to variances, px². Five times the square of 0.2 px, as a pan goes on one way and
    is seen anew in every trial. Tuned (wild worlds 3000-)."""
    UNKNOWN_PX = 128.0
    """Where more uncertain than that, nothing is known. Choice: a quarter of the image."""

    def __init__(
        self, motors: int, cells: int = 8, rate: float = 0.7, kalman: bool = True, dimensions: int = 4
    ) -> None:
        self._dimensions = dimensions
        self._pairs = np.array([pair for pair in PAIRS if max(pair) < dimensions])
        self.cells = check_number("cells", cells, least=1, whole=True)
        self.gain = Gain(rate, kalman, self.SUCCESS_VARIANCE, self.DRIFT_VARIANCE)
        self._prior = self._smooth()
        self.records: Array = np.zeros((len(self._prior), motors))
        self.covariance: Array = self._prior.copy()

    def __repr__(self) -> str:
        return f"FactoredTable(cells={self.cells}, rate={self.gain.rate}, kalman={self.gain.kalman})"

    def recall(self, sensors: Array) -> Recall | None:
        """See `Knowledge`. None where it leads is known to no better than `UNKNOWN_PX`."""
        which, weights = self._between(sensors)
        variance = weights @ self.covariance[np.ix_(which, which)] @ weights
        deviation = float(np.sqrt(variance))
        return Recall(weights @ self.records[which], deviation) if deviation <= self.UNKNOWN_PX else None

    def jacobian(self, registers: Array) -> None:
        """See `Knowledge`. A table implies none."""

    def learn(self, sensors: Array, registers: Array) -> None:
        if self.gain.kalman:
            self.covariance += self.gain.drift_variance / self.SCALE_PX**2 * self._prior
        which, near = self._between(sensors)
        weights = np.zeros(len(self.records))
        weights[which] = near
        covariances = self.covariance[:, which] @ near
        error_variance = float(near @ covariances[which]) + self.gain.success_variance
        gains = self.gain.shares(weights, covariances, error_variance)
        self.records += np.outer(gains, registers - near @ self.records[which])
        self.covariance += np.outer(gains * error_variance - covariances, gains) - np.outer(
            gains, covariances
        )

    def arrays(self) -> dict[str, NDArray[Any]]:
        return {name: getattr(self, name).copy() for name in ("records", "covariance")}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        records = checked_array(arrays, "records", self.records.shape)
        covariance = checked_array(arrays, "covariance", self.covariance.shape)
        self.records, self.covariance = records, covariance

    def _between(self, sensors: Array) -> tuple[NDArray[np.intp], Array]:
        """The records around a sensor vector: two in each 1-D, four in each 2-D table; and their weights."""
        count = self.cells + 1
        place = (np.clip(sensors, -1, 1) + 1) / 2 * self.cells
        cell = np.minimum(place.astype(np.intp), self.cells - 1)
        part = place - cell
        near = cell[:, None] + [0, 1]
        shares = np.stack([1 - part, part], 1)
        lines = near + count * np.arange(self._dimensions)[:, None]
        first, second = self._pairs.T
        planes = near[first][:, :, None] * count + near[second][:, None, :]
        planes += self._dimensions * count + count**2 * np.arange(len(self._pairs))[:, None, None]
        both = shares[first][:, :, None] * shares[second][:, None, :]
        return np.concatenate([lines.ravel(), planes.ravel()]), np.concatenate([shares.ravel(), both.ravel()])

    def _smooth(self) -> Array:
        """Prior covariance (records, records): quadratics of unknown coefficients, and smooth departures."""
        x = np.linspace(-1, 1, self.cells + 1)
        flat = np.stack(np.meshgrid(x, x, indexing="ij"), -1).reshape(-1, 2)
        lines, planes = np.outer(x, x), np.outer(flat.prod(1), flat.prod(1))
        apart = np.square(x[:, None] - x)
        apart_flat = np.square(flat[:, None] - flat).sum(-1)
        blocks = [1 / self._dimensions + lines + lines**2 / 2 + self._departing(apart)] * self._dimensions
        blocks += [planes + self._departing(apart_flat)] * len(self._pairs)
        prior = np.zeros((sum(map(len, blocks)),) * 2)
        start = 0
        for block in blocks:
            end = start + len(block)
            prior[start:end, start:end] = block
            start = end
        return self.SCALE_PX**2 * prior

    def _departing(self, squares: Array) -> Array:
        return np.asarray(self.DEPARTURE_VARIANCE * np.exp(squares / (-2 * self.DEPARTURE_LENGTH**2)))
