"""The looks of many trials at one point: a smooth function of the place that is kept small."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.checks import checked_array
from ..base.observation import Array
from ..perception.gating import Gating
from ..servo.smooth_function import SmoothFunction

IMAGE_AREA = 4.0
"""In square image units."""


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
    NOISIER = 2.0
    """Where looks turn out to have this times the variance that was known of earlier ones, those had it, too.
    Choice: noise is known to a fifth."""
    MISTAKEN = Gating.MISTAKEN / Gating.OF
    """So many looks are mistaken, beforehand. As there."""
    SPARE = 30
    """This many more looks are kept before some are dropped. Choice: that takes time."""

    def __init__(self, dimensions: int, motors: int, most: int) -> None:
        self.function = SmoothFunction.unknown(dimensions, motors)
        self._unknown = self.function
        self._most = most
        self._settled = 0

    def __len__(self) -> int:
        return len(self.function.places)

    def add(self, places: Array, points: Array, variances: Array) -> None:
        """Takes in looks at places (n, d): points (n, 2, 2), and variances (n,), in image units."""
        self.function = self._with(places, points, variances)
        if len(variances) and (self.function.variances < variances[-1] / self.NOISIER).any():
            self._refit()
        elif len(self) > self._most + self.SPARE:
            self._drop()
        elif len(self) >= max(2 * self._settled, self.FIRST):
            self._refit()

    def _refit(self) -> None:
        """Chooses distances anew, where no look is less noisy than the latest, and leaves out mistaken ones."""
        variances = np.maximum(self.function.variances, self.function.variances[-1])
        function = replace(self.function, variances=variances)
        all_, without = function.refitted(), self._without_mistaken(function)
        left_out = len(all_.places) - len(without.places)
        if left_out:
            without = without.refitted()
            price = left_out * np.log(self.MISTAKEN / IMAGE_AREA)
        better = left_out and without.evidence[0] + price > all_.evidence[0]
        self.function = without if better else all_
        self._settled = len(self)

    def _without_mistaken(self, function: SmoothFunction) -> SmoothFunction:
        """Without looks that are more likely mistaken, and so anywhere in the image, than where the others say."""
        lengths = np.full(function.places.shape[1], function.USUAL)
        looks = function.points, function.variances, function.doubts
        usual = function.of(function.places, function.motors, lengths, *looks)
        whitening, white = usual.whitening[0], usual.white[0]
        inverses, sums = whitening.swapaxes(1, 2) @ whitening, whitening.swapaxes(1, 2) @ white
        kept = np.ones(len(self), bool)
        for _ in range(len(self) // 2):
            certain = np.maximum(np.einsum("pii->ip", inverses), 1e-12)
            odds = np.square(sums).sum(2).T / (2 * certain) - np.log(
                IMAGE_AREA * certain / (2 * np.pi * self.MISTAKEN)
            )
            index = int(np.where(kept, odds.max(1), -np.inf).argmax())
            if odds[index].max() < 0:
                break
            column = inverses[:, index]
            share = column / column[:, [index]]
            inverses = inverses - column[:, :, None] * share[:, None]
            sums = sums - share[:, :, None] * sums[:, [index]]
            kept[index] = False
        looks = (each[kept] for each in looks)
        return function.of(function.places[kept], function.motors, lengths, *looks)

    def evidence(self, places: Array, points: Array, variances: Array) -> float:
        """The logarithm of how probable such looks are, given those before."""
        after = self._with(places, points, variances)
        return float(after.evidence.max() - self.function.evidence.max())

    def _with(self, places: Array, points: Array, variances: Array) -> SmoothFunction:
        function = self.function
        for look in zip(places, points, variances, strict=True):
            function = function.with_look(*look, np.ones(2, bool))
        return function

    def map(self, places: Array, points: Array, deviations: Array) -> None:
        """What is stored is seen elsewhere now: at places (n, d) as points (n, 2, 2).

        Args:
            places: Where.
            points: What is seen there, in image units.
            deviations: How far off that may be in each image (2,), in image units.
        """
        function = self.function
        self._keep(places, points, function.variances, np.hypot(function.doubts, deviations))

    def _keep(self, places: Array, points: Array, variances: Array, doubts: Array) -> None:
        function = self.function
        lengths = function.lengths[function.evidence.argmax()]
        self.function = function.of(places, function.motors, lengths, points, variances, doubts)
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
        looks = function.places, function.points, function.variances, function.doubts
        self._keep(*(each[kept] for each in looks))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All looks, and what was chosen by them, as named arrays."""
        function = self.function
        lengths = function.lengths if self._settled else np.empty((0, function.lengths.shape[1]))
        return {
            "places": function.places,
            "points": function.points,
            "variances": function.variances,
            "doubts": function.doubts,
            "lengths": lengths,
            "settled": np.array([self._settled]),
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Takes over what `arrays` returned; raises ValueError where it does not fit."""
        dimensions = self._unknown.places.shape[1]
        places = checked_array(arrays, "places", (None, dimensions))
        points = checked_array(arrays, "points", (len(places), 2, 2))
        variances, doubts = (
            checked_array(arrays, name, (len(places), 2)) for name in ("variances", "doubts")
        )
        lengths = checked_array(arrays, "lengths", (None, dimensions))
        (settled,) = checked_array(arrays, "settled", (1,)).astype(int)
        function, motors = self._unknown, self._unknown.motors
        if settled:
            looks = (each[:settled] for each in (points, variances, doubts))
            function = function.of(places[:settled], motors, lengths[0], *looks)
        for look in zip(places[settled:], points[settled:], variances[settled:], strict=True):
            function = function.with_look(*look, np.ones(2, bool))
        self.function, self._settled = function, int(settled)
