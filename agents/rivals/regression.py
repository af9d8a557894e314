"""Bayesian linear regression (Bishop 2006, section 3.3), updated by every look: recursive least squares."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.checks import checked_array
from ..base.observation import Array


class BayesianRegression:
    """Weights (k, o) of k features for o outputs that share their covariance.

    Attributes:
        mean: Of the weights (k, o).
        covariance: Of the weights of each output (k, k).

    Args:
        deviations: Of the weights (k,), by a prior whose mean is zero.
        outputs: o.
    """

    BLOCK = 64
    """So many looks are taken in at once (a guard: the time for one grows with their square)."""

    def __init__(self, deviations: Array, outputs: int) -> None:
        self.mean = np.zeros((len(deviations), outputs))
        self.covariance = np.diag(np.square(deviations))

    def learn(self, features: Array, targets: Array, variances: Array) -> None:
        """Learns from targets (n, o), known but for these variances (n,), at features (n, k)."""
        for start in range(0, len(features), self.BLOCK):
            block = slice(start, start + self.BLOCK)
            self._learn(features[block], targets[block], variances[block])

    def _learn(self, features: Array, targets: Array, variances: Array) -> None:
        seen = features @ self.covariance
        root = np.linalg.cholesky(seen @ features.T + np.diag(variances))
        whitened = np.linalg.solve(root, np.hstack([seen, targets - features @ self.mean]))
        gains, innovations = np.split(whitened, [len(self.mean)], axis=1)
        self.mean = self.mean + gains.T @ innovations
        self.covariance = self.covariance - gains.T @ gains

    def variances(self, features: Array) -> Array:
        """Variances (n,) of an output at features (n, k), noise apart."""
        return np.asarray((features @ self.covariance * features).sum(1).clip(0))

    def copy(self) -> BayesianRegression:
        """One that learns on for itself: no array is ever changed in place."""
        return copy(self)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Mean and covariance, by their names."""
        return dict(vars(self))

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Takes over what `arrays` returned; raises ValueError where it does not fit."""
        self.mean, self.covariance = (
            checked_array(arrays, name, each.shape) for name, each in self.arrays().items()
        )
