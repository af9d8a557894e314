"""Robust least squares with a weak pull and bounds, by Marquardt's steps, from several starts at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from agents.base.observation import Array

Residuals = Callable[[Array], tuple[Array, Array]]
"""Residuals (starts, r) and their derivatives (starts, r, p) at parameters (starts, p)."""

_DAMPING, _LESS, _MORE = 1e-3, 0.1, 5.0
_TOLERANCE = 1e-3


def least_squares(
    residuals: Residuals,
    start: Array,
    middle: Array,
    rule: Array,
    most: Array,
    steps: int,
    outlying: float,
) -> tuple[Array, Array, Array]:
    """Minimises half of ρ(residuals) + ‖(x - middle) / rule‖² where |x - middle| <= `most`.

    Marquardt's steps, projected to the bounds; all starts go their own ways in step. It ends when none of
    them gains more than 1/1000 of its cost by a step, or after so many steps. ρ is Cauchy's function of the
    length of each two residuals, an image point's: it weighs points by 1 / (1 + (length / outlying)²).

    Args:
        residuals: Of the data, in units of their standard deviation.
        start: Where to begin (starts, p).
        middle: Where each parameter is (p,) without data.
        rule: How far off as a rule.
        most: How far off at most.
        steps: How many steps to make at most.
        outlying: Length beyond which a point counts as an outlier rather than as noise.

    Returns:
        Parameters (starts, p), their residuals (starts, r) and costs (starts,).
    """
    x = np.clip(start, middle - most, middle + most)
    off, slopes = residuals(x)
    weights, cost = _robust(off, (x - middle) / rule, outlying)
    damping = np.full(len(x), _DAMPING)
    still = np.zeros(len(x), bool)
    for _ in range(steps):
        pulled = (x - middle) / rule**2
        weighted = (weights[..., None] * slopes).swapaxes(1, 2)
        gradient = pulled + (weighted @ off[..., None])[..., 0]
        normal = weighted @ slopes
        diagonal = np.einsum("bii->bi", normal)
        diagonal += 1 / rule**2
        diagonal *= 1 + damping[:, None]
        step = np.linalg.solve(normal, gradient[..., None])[..., 0]
        further = np.clip(x - step, middle - most, middle + most)
        further_off, further_slopes = residuals(further)
        further_weights, further_cost = _robust(further_off, (further - middle) / rule, outlying)
        better = further_cost < cost
        still = np.where(better, cost - further_cost < _TOLERANCE * cost, damping > 1e3)
        damping = np.where(better, np.maximum(_LESS * damping, 1e-9), _MORE * damping)
        x[better], off[better], slopes[better] = further[better], further_off[better], further_slopes[better]
        weights[better] = further_weights[better]
        cost = np.minimum(cost, further_cost)
        if still.all():
            break
    return x, off, cost


def _robust(off: Array, pulled: Array, outlying: float) -> tuple[Array, Array]:
    """Weights (starts, r) of the residuals, and costs (starts,)."""
    squares = (off * off).reshape(len(off), -1, 2).sum(-1) / outlying**2
    cost = outlying**2 * np.log1p(squares).sum(-1) + (pulled * pulled).sum(-1)
    return np.repeat(1 / (1 + squares), 2, -1), cost / 2
