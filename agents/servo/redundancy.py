"""Four equations for three words: solving -d = J c, and what the redundancy is used for (section 3.2).

The paper says that an equation was left out [Graefe, Maryniak 1998], that the four were transformed into
three [Maryniak, Graefe 1998], and that the redundancy was later used [Maryniak, Graefe 1999]; its formulas
are not public, and these are reconstructions. Each takes J (4, m), d (4,) and the noise of an image
coordinate, as far as known, and gives the equations that damped least squares then solves.
"""

from collections.abc import Callable
from itertools import combinations

import numpy as np

from calfree_gym.image import IMAGE_UNIT, rounded

from ..base.observation import Array
from ..base.weights import cauchy_weights

Equations = tuple[Array, Array]
ROBUST_PX, ROBUST_NOISES = 8.0, 3.0
"""A contradiction is large beyond this, and beyond this many times the noise of an image coordinate: tuned on
wild worlds 3000 and up."""
REWEIGHTINGS = 3
"""So often equations are weighed, by Cauchy's weights. Source: a few passes of IRLS are usual (Holland &
Welsch 1977)."""


def omit(jacobian: Array, distance: Array, noise_px: float = 0.0) -> Equations:
    """Leaves out the equation without which the others are best conditioned."""
    rows = max(
        (list(kept) for kept in combinations(range(4), 3)),
        key=lambda kept: rounded(np.linalg.svd(jacobian[kept], compute_uv=False)[-1]),
    )
    return jacobian[rows], distance[rows]


def transform(jacobian: Array, distance: Array, noise_px: float = 0.0) -> Equations:
    """Turns the four into the three that words can do something about: J's left singular vectors.

    The fixed choice (xa, xb, ya + yb) of an upright stereo pair fails where cameras are rolled at will.
    """
    turn = np.linalg.svd(jacobian, full_matrices=False)[0].T
    return turn @ jacobian, turn @ distance


def weighted(jacobian: Array, distance: Array, noise_px: float = 0.0) -> Equations:
    """All four, less of those that contradict the others (iteratively reweighted least squares).

    No words change the part of d in J's left null space, so the weighted residuals follow from it alone. One
    spare equation tells that some coordinate contradicts, not which: it is taken to be the one that weighs
    most there.
    """
    left, lengths, _ = np.linalg.svd(jacobian)
    null = left[:, np.count_nonzero(lengths > 1e-9 * lengths[0]) :]
    spare = null @ (distance @ null) + 1e-12
    usual = IMAGE_UNIT * max(ROBUST_PX, ROBUST_NOISES * noise_px)
    squares, direction = spare * spare, spare * ((spare @ distance) / usual)
    weights = np.ones(len(distance))
    for _ in range(REWEIGHTINGS):
        slack = 1 / weights
        weights = cauchy_weights(slack * direction / (slack @ squares))
    roots = np.sqrt(weights)
    return jacobian * roots[:, None], distance * roots


REDUNDANCIES: dict[str, Callable[[Array, Array, float], Equations]] = {
    "omit": omit,
    "transform": transform,
    "weighted": weighted,
}


def solve(jacobian: Array, distance: Array, damping: float) -> Array:
    """Control words c (m,) that would make the image distance vanish if the world were linear.

    Columns are scaled to equal length before they are damped: a word has no natural unit.

    Args:
        jacobian: Image distance by words (n, m); zero columns give zero words.
        distance: Image distance d (n,).
        damping: Relative to the columns' length.
    """
    lengths = np.sqrt((jacobian * jacobian).sum(0))
    scale = np.where(lengths > 0, lengths, 1.0)
    scaled = jacobian / scale
    normal = scaled.T @ scaled
    normal.flat[:: len(lengths) + 1] += damping**2 + 1e-12
    return np.asarray(-np.linalg.solve(normal, scaled.T @ distance) / scale)


def solve_within(jacobian: Array, distance: Array, damping: float, lowest: Array, highest: Array) -> Array:
    """As `solve`, but with words (m,) within bounds: a motor held back leaves its part to the others.

    Where holding motors back one after the other would end no nearer, all words are shortened alike: that
    always does.

    Args:
        jacobian: As for `solve`.
        distance: As for `solve`.
        damping: As for `solve`.
        lowest: Not above zero (m,).
        highest: Not below zero (m,).
    """
    words = wanted = solve(jacobian, distance, damping)
    free = np.ones(len(words), bool)
    while (beyond := free & ((words < lowest) | (words > highest))).any():
        free &= ~beyond
        words = np.minimum(np.maximum(words, lowest), highest)
        rest = distance + jacobian[:, ~free] @ words[~free]
        words[free] = solve(jacobian[:, free], rest, damping) if free.any() else 0.0
    if free.all():
        return words
    words = np.minimum(np.maximum(words, lowest), highest)
    bounds = np.where(wanted > 0, highest, lowest)
    moving = wanted != 0
    shortened = wanted * np.min(bounds[moving] / wanted[moving], initial=1.0)
    left, left_shortened = (np.linalg.norm(distance + jacobian @ each) for each in (words, shortened))
    return words if left <= left_shortened else shortened
