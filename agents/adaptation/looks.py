"""The looks of many trials at one point: a smooth function of the place that is kept small."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.checks import checked_array
from ..base.observation import Array
from ..servo.smooth_function import SmoothFunction


class Looks:
    """A smooth function that looks are added to.

    Over what distances the point is smooth is chosen anew each time that their number has doubled. Where there
    are too many, those that add least to the others are dropped (the paper asks for support points "in an
    irregular pattern where they are actually needed", section 4.3).

    Attributes:
        function: What was seen where.

    Args:
        dimensions: Components of a place.
        motors: m; the first components of a place are registers.
        most: So many looks are kept.
    """

    FIRST = 8
    """Distances are first chosen by this many looks. Choice."""
    SPARE = 30
    """This many more looks are kept before some are dropped. Choice: that takes time."""

    def __init__(self, dimensions: int, motors: int, most: int) -> None:
        self.function = SmoothFunction.unknown(dimensions, motors)
        self._unknown = self.function
        self._most = most
        self._settled = 0

    def __len__(self) -> int:
        return len(self.function.places)

    def add(self, places: Array, points: Array, noise_px: Array) -> None:
        """Takes in looks at places (n, d): points (n, 2, 2), in image units, and their noise (n,)."""
        seen = np.ones(2, bool)
        for place, point, variance in zip(places, points, noise_px, strict=True):
            self.function = self.function.with_look(place, point, variance, seen)
        if len(self) > self._most + self.SPARE:
            self._drop()
        elif len(self) >= max(2 * self._settled, self.FIRST):
            self.function, self._settled = self.function.refitted(), len(self)

    def replace(self, places: Array, points: Array, variances: Array) -> None:
        """Puts other places (n, d), points (n, 2, 2) and variances (n, 2) in place of those that are stored."""
        function = self.function
        lengths = function.lengths[function.evidence.argmax()]
        self.function = function.of(places, function.motors, lengths, points, variances)
        self._settled = len(self)

    def _drop(self) -> None:
        """Drops, one after the other, the looks that add least to the others."""
        function = self.function
        whitening = function.whitening[function.evidence.argmax()]
        inverses = whitening.swapaxes(1, 2) @ whitening
        kept = np.ones(len(self), bool)
        for _ in range(len(self) - self._most):
            redundant = np.einsum("pii,ip->i", inverses, function.variances)
            index = int(np.where(kept, redundant, -np.inf).argmax())
            column = inverses[:, index]
            inverses = inverses - column[:, :, None] * (column / column[:, [index]])[:, None]
            kept[index] = False
        self.replace(function.places[kept], function.points[kept], function.variances[kept])

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All looks, and what was chosen by them, as named arrays."""
        function = self.function
        lengths = function.lengths if self._settled else np.empty((0, function.lengths.shape[1]))
        return {
            "places": function.places,
            "points": function.points,
            "variances": function.variances,
            "lengths": lengths,
            "settled": np.array([self._settled]),
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Takes over what `arrays` returned; raises ValueError where it does not fit."""
        dimensions = self._unknown.places.shape[1]
        places = checked_array(arrays, "places", (None, dimensions))
        points = checked_array(arrays, "points", (len(places), 2, 2))
        variances = checked_array(arrays, "variances", (len(places), 2))
        lengths = checked_array(arrays, "lengths", (None, dimensions))
        (settled,) = checked_array(arrays, "settled", (1,)).astype(int)
        function, motors = self._unknown, self._unknown.motors
        if settled:
            before = slice(0, settled)
            function = function.of(places[before], motors, lengths[0], points[before], variances[before])
        for look in zip(places[settled:], points[settled:], variances[settled:], strict=True):
            function = function.with_look(*look, np.ones(2, bool))
        self.function, self._settled = function, int(settled)
