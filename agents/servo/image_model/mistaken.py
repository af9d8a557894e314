"""Looks that are rather mistaken, and so anywhere in the image, than where the others say."""

from __future__ import annotations

import numpy as np

from calfree_gym.image import IMAGE_SIZE, IMAGE_UNIT, rounded

from ...base.observation import Array, Flags
from ...perception.gating import Gating
from .smooth_function import SmoothFunction

IMAGE_AREA = (IMAGE_SIZE * IMAGE_UNIT) ** 2
"""In square image units."""


def price() -> float:
    """The logarithm of how probable it is beforehand that a look is mistaken, and just there."""
    return float(np.log(Gating.MISTAKEN / Gating.OF / IMAGE_AREA))


def right_looks(function: SmoothFunction) -> Flags:
    """Which looks (n, 2), in each image, are not more likely mistaken than right."""
    seen = np.isfinite(function.looks.variances)
    right = np.ones_like(seen)
    inverses, sums = solved(function)
    for image in range(2):
        known = inverses[image % len(inverses)], sums[image]
        right[_mistaken(*known, seen[:, image]), image] = False
    return right


def _mistaken(inverse: Array, sums: Array, seen: Flags) -> list[int]:
    """Which of the looks at an image that were seen (n,) are mistaken, at most half of them.

    The worst is left out first, and each of the rest judged by what remains; in the end each of those by the
    ones that stay: what was mistaken may have made it look so.
    """
    left_out: list[int] = []
    staying = inverse, sums
    for _ in range(np.count_nonzero(seen) // 2):
        odds = np.where(seen, _odds(np.diagonal(staying[0]), staying[1]), -np.inf)
        odds[left_out] = -np.inf
        worst = int(rounded(odds).argmax())
        if odds[worst] < 0:
            break
        left_out.append(worst)
        staying = without(worst, *staying)
    odds = odds_by_the_rest(left_out, inverse, sums)
    return [look for look, each in zip(left_out, odds, strict=True) if each > 0]


def odds_by_the_rest(left_out: list[int], inverse: Array, sums: Array) -> Array:
    """The logarithms of the odds (k,) of looks to be mistaken, each by those that are not left out."""
    among = np.linalg.inv(inverse[np.ix_(left_out, left_out)])
    certain = 1 / np.diagonal(among)
    return _odds(certain, certain[:, None] * (among @ sums[left_out]))


def _odds(certain: Array, sums: Array) -> Array:
    """The logarithms of the odds (n,) of each look to be mistaken, by the others.

    Args:
        certain: Inverse variances (n,) of looks, as the others tell them.
        sums: Those times how far off they are (n, 2).
    """
    certain = np.maximum(certain, 1e-12)
    odds = np.square(sums).sum(1) / (2 * certain) + np.log(2 * np.pi / certain) + price()
    return np.asarray(odds)


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
    better = other.evidence.max() + np.count_nonzero(~right) * price() > function.evidence.max()
    return other if better else function


def solved(function: SmoothFunction) -> tuple[Array, Array]:
    """Inverse covariances (p, n, n) of what was seen, and their product with it (2, n, 2)."""
    whitening, white = function.whitening[function.best], function.white[function.best]
    return whitening.swapaxes(1, 2) @ whitening, whitening.swapaxes(1, 2) @ white


def without(index: int, inverses: Array, sums: Array) -> tuple[Array, Array]:
    """The same, in one image (n, n), (n, 2) or both, without one look."""
    column = inverses[..., index]
    share = column / column[..., [index]]
    return (
        inverses - column[..., :, None] * share[..., None, :],
        sums - share[..., :, None] * sums[..., [index], :],
    )
