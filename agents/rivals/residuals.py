"""What a regression leaves of its latest looks, as a Gaussian process (Rasmussen & Williams 2006, ch. 2)."""

import numpy as np

from ..base.observation import Array


class ResidualProcess:
    """The mean of residuals at other places, given those of n looks.

    Args:
        places: Where they were seen (n, v).
        residuals: Of outputs that are independent (n, o).
        variances: Of their noise (n,).
        deviation: Standard deviation of residuals beforehand.
        length: Over such a distance they are much alike.
    """

    def __init__(
        self, places: Array, residuals: Array, variances: Array, deviation: float, length: float
    ) -> None:
        self._places, self._deviation, self._length = places, deviation, length
        self._weights = np.linalg.solve(self._kernel(places) + np.diag(variances), residuals)

    def mean(self, places: Array) -> Array:
        """Residuals (n, o) that are expected at places (n, v)."""
        return np.asarray(self._kernel(places) @ self._weights)

    def _kernel(self, places: Array) -> Array:
        squares = np.square(places).sum(1)[:, None] + np.square(self._places).sum(1)
        distances = (squares - 2 * places @ self._places.T).clip(0)
        return np.asarray(self._deviation**2 * np.exp(-distances / (2 * self._length**2)))
