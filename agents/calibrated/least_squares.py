"""Robust least squares with a prior and bounds, by Levenberg-Marquardt, from several starts at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..base.observation import Array
from ..base.robust import cauchy_weights

Residuals = Callable[[Array], tuple[Array, Callable[[], Array]]]
"""Residuals (starts, r) at parameters (starts, p), and what computes their derivatives (starts, r, p) there:
these cost most, and are not wanted where the search ends."""

_DAMPING, _LESS, _MORE = 1e-3, 0.1, 5.0
"""Marquardt's damping at first, and its factors after steps that were accepted and rejected: usual values
(Press et al. 2007, section 15.5, has 10⁻³, 0.1 and 10)."""
_LEAST_DAMPING, _MOST_DAMPING = 1e-9, 1e3
"""Guards: less damping changes no step, and with more there is no step that helps."""
_TOLERANCE = 1e-3
"""A search ends where a step gains less than this share of its cost. Tuned on wild worlds 3000 and up."""


def least_squares(
    residuals: Residuals,
    start: Array,
    prior_mean: Array,
    prior_std: Array,
    bound: Array,
    steps: int,
    outlying: float,
) -> tuple[Array, Array, Array]:
    """Minimises half of ρ(residuals) + ‖(x - prior_mean) / prior_std‖² where |x - prior_mean| <= `bound`.

    Levenberg-Marquardt (Marquardt 1963), each step clipped to the bounds; all starts go their own ways at the
    same time. It ends where no start gains more than 1/1000 of its cost by a step, or after this many steps.
    ρ is Cauchy's function of the length of every two residuals, an image point's; iteratively reweighted, it
    weighs points by 1 / (1 + (length / outlying)²).

    Args:
        residuals: Of the data, in any unit.
        start: Where to begin (starts, p).
        prior_mean: Where each parameter is without data (p,).
        prior_std: Its standard deviation without data, divided by that of a residual (p,).
        bound: How far from the prior mean it can be (p,).
        steps: How many steps to make at most.
        outlying: Length of a point's residual beyond which it counts as an outlier rather than as noise.

    Returns:
        Parameters (starts, p), their residuals (starts, r) and costs (starts,).
    """
    x = np.clip(start, prior_mean - bound, prior_mean + bound)
    off, derivatives = residuals(x)
    jacobian = derivatives()
    weights, cost = _robust(off, (x - prior_mean) / prior_std, outlying)
    damping = np.full(len(x), _DAMPING)
    ended = np.zeros(len(x), bool)
    for _ in range(steps):
        step = _step(x - prior_mean, prior_std, off, jacobian, weights, damping)
        further = np.clip(x - step, prior_mean - bound, prior_mean + bound)
        further_off, derivatives = residuals(further)
        further_weights, further_cost = _robust(further_off, (further - prior_mean) / prior_std, outlying)
        better = further_cost < cost
        ended = np.where(better, cost - further_cost < _TOLERANCE * cost, damping > _MOST_DAMPING)
        damping = np.where(better, np.maximum(_LESS * damping, _LEAST_DAMPING), _MORE * damping)
        for kept, new in ((x, further), (off, further_off), (weights, further_weights)):
            kept[better] = new[better]
        cost = np.minimum(cost, further_cost)
        if ended.all():
            break
        if better.all():
            jacobian = derivatives()
        elif better.any():
            jacobian[better] = derivatives()[better]
    return x, off, cost


def _step(
    from_mean: Array, prior_std: Array, off: Array, jacobian: Array, weights: Array, damping: Array
) -> Array:
    """Marquardt's step (starts, p) along the gradient: x - step is where to go.

    JᵀWJ is a matrix by its own transpose, start by start: BLAS takes half the time for that.
    """
    roots = np.sqrt(weights)
    root_w_j = roots[..., None] * jacobian
    jt_w_off = np.array([j.T @ r for j, r in zip(root_w_j, roots * off, strict=True)])
    gradient = from_mean / prior_std**2 + jt_w_off
    normal = np.array([j.T @ j for j in root_w_j])
    diagonal = np.einsum("bii->bi", normal)
    diagonal += 1 / prior_std**2
    diagonal *= 1 + damping[:, None]
    return np.asarray(np.linalg.solve(normal, gradient[..., None])[..., 0])


def _robust(off: Array, from_mean: Array, outlying: float) -> tuple[Array, Array]:
    """Weights (starts, r) of the residuals, and costs (starts,).

    Args:
        off: Residuals (starts, r).
        from_mean: Distances from the prior mean in standard deviations (starts, p).
        outlying: See `least_squares`.
    """
    lengths = np.sqrt((off * off).reshape(len(off), -1, 2).sum(-1)) / outlying
    cost = outlying**2 * np.log1p(lengths * lengths).sum(-1) + (from_mean * from_mean).sum(-1)
    return np.repeat(cauchy_weights(lengths), 2, -1), cost / 2
