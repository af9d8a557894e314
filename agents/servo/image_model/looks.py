"""What was seen of one point in both images, and where."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ...base.observation import Array

NOISIER = 2.0
"""Where looks turn out to have this times the variance that was known of earlier ones, those had it, too.
Choice: noise is known to a fifth."""


class Looks(NamedTuple):
    """Looks at one point.

    Attributes:
        places: Where (n, d): registers, and what else a point depends on.
        points: What was seen in both images (n, 2, 2), in image units.
        variances: Of the noise of a coordinate, in each image (n, 2); infinite where it was not seen.
        doubts: How far off the points may be by now (n, 2): a standard deviation in each image, of an error
            that is as smooth as the points.
    """

    places: Array
    points: Array
    variances: Array
    doubts: Array

    @classmethod
    def none(cls, dimensions: int) -> Self:
        """No looks, at places of that many components."""
        nothing = np.empty((0, 2))
        return cls(np.empty((0, dimensions)), np.empty((0, 2, 2)), nothing, nothing)

    def plus(self, place: Array, points: Array, variances: Array) -> Self:
        """With one more look, which nobody doubts: at (d,), points (2, 2), variances (2,)."""
        look = (place, points, variances, np.zeros(2))
        return type(self)(*(np.concatenate([old, [new]]) for old, new in zip(self, look, strict=True)))

    def only(self, chosen: NDArray[np.bool_] | slice) -> Self:
        """Those that are chosen (n,)."""
        return type(self)(*(each[chosen] for each in self))
