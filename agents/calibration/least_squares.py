"""Least squares with a weak pull and bounds, from several starts at once (Levenberg 1944, Marquardt 1963)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from agents.agent import Array

Residuals = Callable[[Array], tuple[Array, Array]]
"""Residuals (starts, r) and their derivatives (starts, r, p) at parameters (starts, p)."""

_DAMPING, _LESS, _MORE = 1e-3, 0.1, 5.0
_TOLERANCE = 1e-3


def least_squares(
    residuals: Residuals, start: Array, middle: Array, rule: Array, most: Array, steps: int
) -> tuple[Array, Array, Array]:
    """Minimises half of ‖residuals‖² + ‖(x - middle) / rule‖² where |x - middle| <= `most`.

    Marquardt's steps, projected to the bounds; all starts go their own ways in step. It ends when none of
    them gains more than 1/1000 of its cost by a step, or after so many steps.

    Args:
        residuals: Of the data, in units of their standard deviation.
        start: Where to begin (starts, p).
        middle: Where each parameter is (p,) without data.
        rule: How far off as a rule.
        most: How far off at most.
        steps: How many steps to make at most.

    Returns:
        Parameters (starts, p), their residuals (starts, r) and costs (starts,).
    """
    x = np.clip(start, middle - most, middle + most)
    off, slopes = residuals(x)
    cost = _cost(off, (x - middle) / rule)
    damping = np.full(len(x), _DAMPING)
    still = np.zeros(len(x), bool)
    for _ in range(steps):
        pulled = (x - middle) / rule**2
        gradient = pulled + (off[:, None] @ slopes)[:, 0]
        normal = slopes.swapaxes(1, 2) @ slopes
        diagonal = np.einsum("bii->bi", normal)
        diagonal += 1 / rule**2
        diagonal *= 1 + damping[:, None]
        step = np.linalg.solve(normal, gradient[..., None])[..., 0]
        further = np.clip(x - step, middle - most, middle + most)
        further_off, further_slopes = residuals(further)
        further_cost = _cost(further_off, (further - middle) / rule)
        better = further_cost < cost
        still = np.where(better, cost - further_cost < _TOLERANCE * cost, damping > 1e3)
        damping = np.where(better, np.maximum(_LESS * damping, 1e-9), _MORE * damping)
        x[better], off[better], slopes[better] = further[better], further_off[better], further_slopes[better]
        cost = np.minimum(cost, further_cost)
        if still.all():
            break
    return x, off, cost


def _cost(off: Array, pulled: Array) -> Array:
    return ((off * off).sum(-1) + (pulled * pulled).sum(-1)) / 2
