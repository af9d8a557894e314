"""The looks of many trials at one point: a smooth function of the place that is kept small."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import rounded

from ..base.checks import checked_array
from ..base.observation import Array
from ..servo.image_model.looks import NOISIER, Looks
from ..servo.image_model.mistaken import price, right_looks, solved, without
from ..servo.image_model.smooth_function import SmoothFunction


class KeptLooks:
    """A smooth function that looks are added to.

    Over what distances the point is smooth is chosen anew as more is seen. Looks that add little to the
    others are dropped (the paper asks for support points "in an irregular pattern where they are actually
    needed", section 4.3).

    Attributes:
        function: What was seen where.

    Args:
        dimensions: Components of a place.
        motors: m; the first components of a place are registers.
        most: So many looks are kept.
    """

    FIRST = 8
    """Distances are first chosen by this many looks. Choice."""
    MORE = 1.4
    """They are chosen anew each time that this times as many looks were seen (a guard: it takes time)."""
    SPARE = 30
    """This many more looks are kept before some are dropped (a guard: that takes time)."""
    TOLD = 0.5
    """A look is not kept where the others tell to this share of its noise what it should be. Choice."""

    def __init__(self, dimensions: int, motors: int, most: int) -> None:
        self.function = SmoothFunction.unknown(dimensions, motors)
        self._unknown = self.function
        self._most = most
        self._settled = 0
        self._seen, self._next_refit = 0, float(self.FIRST)

    def __len__(self) -> int:
        return len(self.function.looks.places)

    def add(self, places: Array, points: Array, variances: Array) -> None:
        """Takes in looks at places (n, d): points (n, 2, 2), and variances (n,), in image units."""
        for look in zip(places, points, variances, strict=True):
            if not self._is_told(look[0], look[2]):
                self.function = self.function.with_look(*look, np.ones(2, bool))
        self._seen += len(places)
        noisier = len(places) and (self.function.looks.variances < variances[-1] / NOISIER).any()
        refit = noisier or self._seen >= self._next_refit
        if refit:
            self._refit(float(variances[-1]))
        if refit or len(self) > self._settled + self.SPARE:
            self._drop()

    def add_and_refit(self, places: Array, points: Array, variances: Array) -> float:
        """As `add`, and chooses distances anew; how probable these looks were then, as a logarithm."""
        if not len(places):
            return 0.0
        least = float(variances[-1])
        before = self._no_less_noisy(least).evidence.max()
        self.function = self._with(places, points, variances)
        self._seen += len(places)
        mistaken = self._refit(least)
        return float(self.function.evidence.max() - before + mistaken * price())

    def _is_told(self, place: Array, variance: float) -> bool:
        """Whether the others tell to the share `TOLD` of its noise what a look would be."""
        return bool(self._settled and self.function.variance(place) <= self.TOLD**2 * variance)

    def _refit(self, least: float) -> int:
        """Chooses distances anew, where no look has less than this variance; leaves out mistaken ones.

        Returns:
            How many points of looks it took for mistaken.
        """
        self.function = self._no_less_noisy(least).refitted()
        looks, motors, mistaken = self.function.looks, self.function.motors, 0
        lengths = np.full(looks.places.shape[1], self.function.USUAL)
        right = right_looks(self.function.of(looks, motors, lengths))
        if not right.all():
            other = self.function.of(looks.only(np.asarray(right.all(1))), motors, lengths).refitted()
            if other.evidence[0] + np.count_nonzero(~right) * price() > self.function.evidence[0]:
                self.function, mistaken = other, int(np.count_nonzero(~right))
        self._settled, self._next_refit = len(self), self.MORE * self._seen
        return mistaken

    def _no_less_noisy(self, least: float) -> SmoothFunction:
        """What was seen, where no look has less than this variance."""
        function, looks = self.function, self.function.looks
        if not len(self) or looks.variances.min() >= least:
            return function
        looks = looks._replace(variances=np.maximum(looks.variances, least))
        return function.of(looks, function.motors, function.lengths[function.best])

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
        looks = self.function.looks
        self._keep(Looks(places, points, looks.variances, np.hypot(looks.doubts, deviations)))

    def doubt(self, deviations: Array) -> None:
        """What is stored may be off by that in each image (2,), in image units, besides."""
        looks = self.function.looks
        if len(self):
            self._keep(looks._replace(doubts=np.hypot(looks.doubts, deviations)))

    def _keep(self, looks: Looks) -> None:
        function = self.function
        self.function = function.of(looks, function.motors, function.lengths[function.best])
        self._settled = len(self)

    def _drop(self) -> None:
        """Drops, one after the other, the looks that add least to the others."""
        inverses, sums = solved(self.function)
        kept = np.ones(len(self), bool)
        while True:
            noise_shares = self.function.looks.variances.T * np.einsum("pii->pi", inverses)
            shares = np.where(kept, noise_shares.mean(0), 0.0)
            index = int(rounded(shares).argmax())
            if shares[index] < 1 / (1 + self.TOLD**2) and np.count_nonzero(kept) <= self._most:
                break
            inverses, sums = without(index, inverses, sums)
            kept[index] = False
        self._keep(self.function.looks.only(kept))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All looks, and what was chosen by them, as named arrays."""
        function = self.function
        lengths = function.lengths if self._settled else np.empty((0, function.lengths.shape[1]))
        counts = np.array([self._settled, self._seen, self._next_refit])
        return function.looks._asdict() | {"lengths": lengths, "counts": counts}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Takes over what `arrays` returned; raises ValueError where it does not fit."""
        dimensions = self._unknown.lengths.shape[1]
        places = checked_array(arrays, "places", (None, dimensions))
        points = checked_array(arrays, "points", (len(places), 2, 2))
        noise = (checked_array(arrays, name, (len(places), 2)) for name in ("variances", "doubts"))
        looks = Looks(places, points, *noise)
        lengths = checked_array(arrays, "lengths", (None, dimensions))
        settled, seen, next_refit = checked_array(arrays, "counts", (3,))
        settled = int(settled)
        function = self._unknown
        if settled:
            function = function.of(looks.only(slice(settled)), function.motors, lengths[0])
        for place, point, variances, _ in zip(*looks.only(slice(settled, None)), strict=True):
            function = function.with_look(place, point, variances, np.ones(2, bool))
        self.function, self._settled = function, settled
        self._seen, self._next_refit = int(seen), float(next_refit)
