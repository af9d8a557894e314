"""Looks that are rather mistaken, and so anywhere in the image, than where the others say."""

from __future__ import annotations

import numpy as np

from calfree_gym.image import IMAGE_SIZE, IMAGE_UNIT

from ..base.observation import Array, Flags
from ..perception.gating import Gating
from .smooth_function import SmoothFunction

IMAGE_AREA = (IMAGE_SIZE * IMAGE_UNIT) ** 2
"""In square image units."""
PRICE = float(np.log(Gating.MISTAKEN / Gating.OF / IMAGE_AREA))
"""The logarithm of how probable it is beforehand that a look is mistaken, and just there."""


def right_looks(function: SmoothFunction) -> Flags:
    """Which looks (n, 2), in each image, are not more likely mistaken than right.

    The worst is left out first, and each of the rest judged by what remains, up to half of them.
    """
    inverses, sums = solved(function)
    right = np.ones((len(function.looks.places), 2), bool)
    seen = np.isfinite(function.looks.variances)
    for _ in range(np.count_nonzero(seen) // 2):
        certain = np.maximum(np.einsum("pii->ip", inverses), 1e-12)
        odds = np.square(sums).sum(2).T / (2 * certain) + np.log(2 * np.pi / certain) + PRICE
        worst, image = np.unravel_index(np.where(seen & right, odds, -np.inf).argmax(), odds.shape)
        if odds[worst, image] < 0:
            break
        inverses[image], sums[image] = (
            each[0] for each in without(int(worst), inverses[[image]], sums[[image]])
        )
        right[worst, image] = False
    return right


def without_mistaken(function: SmoothFunction, before: SmoothFunction) -> SmoothFunction:
    """The same, where mistaken looks are not seen; or itself, if those explain better what was seen.

    Args:
        function: What was seen.
        before: The same, as it was before the first look.
    """
    right = right_looks(function)
    if right.all():
        return function
    places, points, variances, _ = function.looks
    looks = list(zip(places, points, variances, right & np.isfinite(variances), strict=True))
    other = before
    for look in looks[len(before.looks.places) :]:
        other = other.with_look(*look)
    better = other.evidence.max() + np.count_nonzero(~right) * PRICE > function.evidence.max()
    return other if better else function


def solved(function: SmoothFunction) -> tuple[Array, Array]:
    """Inverse covariances (2, n, n) of what was seen, and their product with it (2, n, 2)."""
    whitening, white = function.whitening[function.best], function.white[function.best]
    return whitening.swapaxes(1, 2) @ whitening, whitening.swapaxes(1, 2) @ white


def without(index: int, inverses: Array, sums: Array) -> tuple[Array, Array]:
    """The same without one look."""
    column = inverses[:, index]
    share = column / column[:, [index]]
    return inverses - column[:, :, None] * share[:, None], sums - share[:, :, None] * sums[:, [index]]
