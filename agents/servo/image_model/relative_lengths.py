"""Along which motors points are smooth over many registers, and along which over few: for the next trial."""

from __future__ import annotations

import numpy as np

from ...base.observation import Array
from ...jacobian.slopes import ALIKE_LOOKS
from .smooth_function import SmoothFunction

LATEST = 100
"""So many looks tell (a guard: it takes time)."""


def relative_lengths(function: SmoothFunction, since: int) -> tuple[Array, int]:
    """Over how many registers a point is smooth along each motor, by the looks from the index `since` on.

    Returns:
        Factors (m,) beside the other motors, whose product is one, and how many looks tell that: those at
        both images; where they are fewer than `ALIKE_LOOKS`, none.
    """
    looks = function.looks.only(slice(since, None))
    looks = looks.only(np.asarray(np.isfinite(looks.variances).all(1))).only(slice(-LATEST, None))
    if len(looks.places) < ALIKE_LOOKS:
        return np.ones(function.motors), 0
    fitted = function.of(looks, function.motors, function.lengths[function.best]).refitted()
    logarithms = np.log(fitted.lengths[0, : function.motors])
    return np.exp(logarithms - logarithms.mean()), len(looks.places)
