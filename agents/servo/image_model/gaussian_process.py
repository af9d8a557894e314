"""Image points as smooth random functions of a place: what was seen tells what will be."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calfree_gym.image import IMAGE_SIZE, IMAGE_UNIT, rounded

from ...base.observation import Array, Flags
from ..perception import Gating
from ..slopes import ALIKE_LOOKS

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

    def doubted(self, deviations: Array) -> Self:
        """The same, which may be off by that in each image (2,), in image units, besides."""
        return self._replace(doubts=np.hypot(self.doubts, deviations))

    def only(self, chosen: NDArray[np.bool_] | slice) -> Self:
        """Those that are chosen (n,)."""
        return type(self)(*(each[chosen] for each in self))


_IMAGES = {1: np.array([0, 0]), 2: np.array([0, 1])}
"""Which whitening is of which image, where there are so many."""


class Expected(NamedTuple):
    """What should be seen of some points at one place, or at several, where these have more axes.

    Attributes:
        values: Image coordinates of the points, in image units, and their slopes by registers
            (..., p, 2, 1 + m).
        covariances: Of a coordinate and its slopes (..., p, 1 + m, 1 + m).
    """

    values: Array
    covariances: Array

    def __sub__(self, other: Self) -> Self:
        """These points less others that are known independently of them."""
        return type(self)(self.values - other.values, self.covariances + other.covariances)

    @property
    def points(self) -> Array:
        """Image points (..., p, 2), in image units."""
        return self.values[..., 0]

    @property
    def slopes(self) -> Array:
        """Of the points by registers (..., p, 2, m)."""
        return self.values[..., 1:]

    @property
    def variances(self) -> Array:
        """Of their coordinates (..., p)."""
        return np.maximum(self.covariances[..., 0, 0], 0.0)

    @property
    def slope_variances(self) -> Array:
        """Covariances of such slopes (..., p, m, m)."""
        return self.covariances[..., 1:, 1:]


@dataclass(frozen=True)
class GaussianProcess:
    """One point in both images as Gaussian processes over places: registers, and what else it depends on.

    Nothing is said of how many motors there are, and only what earlier trials showed tells one from another
    (`relative_lengths`). Over what distance points are smooth is what explains the looks best (the evidence,
    Rasmussen & Williams 2006, section 5.4.1): so points that hardly move, and robots whose words do much or
    little, need no setting. Slopes that are known from before are looks at the derivative; where they do not
    explain what is seen, they do not count.

    A look makes a new function of an old one: the inverse Cholesky factors grow by a row.

    Attributes:
        looks: What was seen (n); slopes from before stand first, as looks of which nothing was seen.
        motors: m; the first components of a place are registers.
        lengths: Over which points may be smooth, for each component of a place: hypotheses (h, d).
        evidence: For each of them (h,): the logarithm of its odds.
        whitening: Inverses of the Cholesky factors of the covariances of what was seen (h, p, n, n); zero
            rows for what was not. One for both images (p = 1) as long as each look was as good in both.
        white: What was seen, whitened by them (h, 2, n, 2).
        known_slopes: How many of them are slopes from before.
        earlier: How many of them are of earlier trials.
        shared: Variance of an error that the others share, and what should be seen next.
    """

    looks: Looks
    motors: int
    lengths: Array
    evidence: Array
    whitening: Array
    white: Array
    known_slopes: int = 0
    earlier: int = 0
    shared: float = 0.0

    SPREAD = 2.0
    """Standard deviation of where points may be, in image units. Derived: the width of an image."""
    OFFSET = 10.0
    """Standard deviation of what is added to that everywhere, in image units (a guard: far beyond)."""
    LENGTHS = 2.0 ** np.arange(-3, 4)
    """Registers over which points may be smooth. Choice: from an eighth to eight times what a motor has to
    its farther stop."""
    SHORTEST = 2.0**-8
    """No shorter length is tried (a guard: below, looks that contradict each other would be of different
    places, and rounding would decide)."""
    USUAL, UNUSUAL = 2.0, 1.0
    """Beforehand these lengths are log-normal, with that median and deviation of the logarithm. Choice: a
    handful of looks outweighs it."""
    CHANGED = 0.05
    """Beforehand slopes from before do not hold in this share of trials. Choice, as above."""
    HOPELESS = 15.0
    """Hypotheses of so much less evidence are given up. A guard: one in three millions."""

    @classmethod
    def unknown(cls, dimensions: int, motors: int, relative: Array | None = None) -> Self:
        """One of which nothing was seen, over places of that many components.

        Args:
            dimensions: Components of a place.
            motors: m; the first components of a place are registers.
            relative: Over how many registers it is smooth along each motor (m,), beside the others; alike
                unless given.
        """
        hypotheses = len(cls.LENGTHS)
        lengths = np.tile(cls.LENGTHS[:, None], dimensions)
        lengths[:, :motors] *= 1.0 if relative is None else relative
        return cls(
            looks=Looks.none(dimensions),
            motors=motors,
            lengths=lengths,
            evidence=-(np.log(cls.LENGTHS / cls.USUAL) ** 2) / (2 * cls.UNUSUAL**2),
            whitening=np.empty((hypotheses, 1, 0, 0)),
            white=np.empty((hypotheses, 2, 0, 2)),
        )

    @classmethod
    def of(cls, looks: Looks, motors: int, lengths: Array) -> Self:
        """One of which all was seen at once, for lengths (d,)."""
        places, points, variances, doubts = looks
        scaled = places / lengths
        norms = np.einsum("nd,nd->n", scaled, scaled)
        near = np.exp(scaled @ scaled.T - (norms[:, None] + norms) / 2)
        alike = bool((variances[:, 0] == variances[:, 1]).all() and (doubts[:, 0] == doubts[:, 1]).all())
        noises, errors = variances.T[: 1 if alike else 2], doubts.T[: 1 if alike else 2]
        covariances = (cls.SPREAD**2 + errors[:, :, None] * errors[:, None]) * near + cls.OFFSET**2
        factors = np.linalg.cholesky(covariances + noises[:, :, None] * np.eye(len(places)))
        whitening = inverse(factors)
        white = whitening @ points.swapaxes(0, 1)
        evidence = -2 * np.log(np.einsum("pii->pi", factors)).sum() * (2 if alike else 1)
        evidence -= np.square(white).sum() / 2
        evidence -= (np.log(lengths / cls.USUAL) ** 2).sum() / (2 * cls.UNUSUAL**2)
        return cls(
            looks=looks,
            motors=motors,
            lengths=lengths[None],
            evidence=np.array([evidence]),
            whitening=whitening[None],
            white=white[None],
        )

    def doubted(self, deviations: Array) -> Self:
        """The same, where what was seen may be off by one of several deviations; later looks tell by which.

        Args:
            deviations: Of smooth errors in each image (h, 2), in image units.
        """
        lengths = self.lengths[self.best]
        each = [self.of(self.looks.doubted(one), self.motors, lengths) for one in deviations]
        return replace(
            self,
            lengths=np.concatenate([one.lengths for one in each]),
            evidence=np.zeros(len(each)),
            whitening=np.concatenate([one._of_each_image for one in each]),
            white=np.concatenate([one.white for one in each]),
        )

    @cached_property
    def best(self) -> int:
        """Which of the hypotheses explains best what was seen."""
        return int(self.evidence.argmax())

    def refitted(self) -> Self:
        """The same over lengths that explain better what was seen: halved or doubled while that helps."""
        best = self.of(self.looks, self.motors, self.lengths[self.best])
        improves = True
        while improves:
            improves = False
            for component in range(len(best.lengths[0])):
                for factor in (0.5, 2.0):
                    lengths = best.lengths[0].copy()
                    lengths[component] = max(factor * lengths[component], self.SHORTEST)
                    other = self.of(self.looks, self.motors, lengths)
                    if other.evidence[0] > best.evidence[0]:
                        best, improves = other, True
                        break
        return best

    @cached_property
    def _best(self) -> tuple[Array, Array, Array, Array]:
        """Of the best hypothesis: lengths, `whitening`, `white` (2, 2, n), and prior covariances at a place.

        These are of a coordinate and its slopes (1 + m, 1 + m).
        """
        lengths = self.lengths[self.best]
        prior = np.diag([self._most, *(self.SPREAD / lengths[: self.motors]) ** 2])
        return lengths, self.whitening[self.best], self.white[self.best].swapaxes(1, 2), prior

    @property
    def slopes_hold(self) -> bool:
        """Whether slopes from before explain best what was seen; also where none are among it."""
        return not self.known_slopes or bool(self.whitening[self.best, :, : self.known_slopes].any())

    def with_slopes(self, slopes: Array, covariances: Array, place: Array) -> Self:
        """The same, where slopes at one place are known from before, unless they no longer hold.

        Args:
            slopes: By registers (2, 2, m).
            covariances: As far as their errors are known (2, m, m).
            place: Where (d,).
        """
        motors, unit = self.motors, np.eye(self.motors)
        steep = (self.SPREAD / self.lengths[:, :motors]) ** 2
        factors = np.linalg.cholesky(covariances.mean(0) + unit * steep[:, None, None])
        whitening = np.linalg.inv(factors)
        white = whitening @ slopes.swapaxes(1, 2)
        return replace(
            self,
            looks=Looks(
                places=np.tile(place, (motors, 1)),
                points=np.zeros((motors, 2, 2)),
                variances=np.full((motors, 2), np.inf),
                doubts=np.zeros((motors, 2)),
            ),
            lengths=np.tile(self.lengths, (2, 1)),
            evidence=np.concatenate(
                [self.evidence + np.log(odds) for odds in (self.CHANGED, 1 - self.CHANGED)]
            ),
            whitening=np.concatenate([np.zeros_like(whitening), whitening]),
            white=np.concatenate([np.zeros_like(white), white]),
            known_slopes=motors,
        )

    def with_look(self, place: Array, points: Array, variances: ArrayLike, seen: Flags) -> Self:
        """The same after one more look.

        Args:
            place: Where (d,).
            points: What was seen in both images (2, 2).
            variances: Of a coordinate in each image (2,).
            seen: Which of them were seen (2,).
        """
        variances = np.where(seen, variances, np.inf)
        known = self.whitening if variances[0] == variances[1] else self._of_each_image
        images, looks = known.shape[1:3]
        cross = known @ self._covariances(place)[:, None, :, None]
        unexplained = np.maximum(self._most - np.square(cross).sum((2, 3)), 0.0)
        deviations = np.sqrt(unexplained + variances[:images])[..., None]
        rows = cross.swapaxes(2, 3)
        errors = (points - (rows @ self.white)[:, :, 0]) / deviations
        odds = -2 * np.log(deviations[..., 0]) - np.square(errors).sum(2) / 2
        evidence = self.evidence + np.where(seen, odds, 0.0).sum(1)
        kept = evidence > evidence.max() - self.HOPELESS
        whitening = np.zeros((np.count_nonzero(kept), images, looks + 1, looks + 1))
        whitening[..., :-1, :-1] = known if kept.all() else known[kept]
        whitening[..., -1, :-1] = ((-rows @ known)[:, :, 0] / deviations)[kept]
        whitening[..., -1, -1] = 1 / deviations[kept, :, 0]
        white = np.where(seen[:, None], errors, 0.0)[:, :, None]
        return replace(
            self,
            looks=self.looks.plus(place, points, variances),
            lengths=self.lengths[kept],
            evidence=evidence[kept],
            whitening=whitening,
            white=np.concatenate([self.white, white], 2)[kept],
        )

    @property
    def _of_each_image(self) -> Array:
        """`whitening` with p = 2."""
        return self.whitening.repeat(2 // self.whitening.shape[1], 1)

    def in_new_trial(self, shared: float) -> Self:
        """The same in a new trial, whose looks share an error of that variance."""
        return replace(self, earlier=len(self.looks.places), shared=shared)

    @property
    def _most(self) -> float:
        """Variance of where a point may be, as long as nothing was seen."""
        return self.SPREAD**2 + self.OFFSET**2 + self.shared

    @cached_property
    def _everywhere(self) -> Array:
        """Covariances with looks (n,) of what is added everywhere."""
        return np.asarray(self.OFFSET**2 + self.shared * (np.arange(len(self.looks.places)) >= self.earlier))

    def at(self, places: Array) -> Expected:
        """What should be seen at places (..., d): one, or several at once."""
        motors, before = self.motors, self.known_slopes
        lengths, whitening, white_seen, prior = self._best
        towards = (places[..., None, :] - self.looks.places) / lengths
        near = np.exp(np.einsum("...nd,...nd->...n", towards, towards) / -2) * self.SPREAD**2
        slants = towards[..., :motors] / lengths[:motors]
        cross = np.empty((*near.shape, 1 + motors))
        cross[..., 0] = near + self._everywhere
        np.multiply(slants, -near[..., None], out=cross[..., 1:])
        if before:
            first, moved = near[..., :before], slants[..., 0, :]
            cross[..., :before, 0] = first * moved
            bent = prior[1:, 1:] / self.SPREAD**2 - moved[..., :, None] * moved[..., None, :]
            cross[..., :before, 1:] = first[..., None] * bent
        white = whitening @ cross[..., None, :, :]
        told = (white.swapaxes(-1, -2) @ white)[..., _IMAGES[len(whitening)], :, :]
        return Expected(white_seen @ white, prior - told)

    def variance(self, place: Array) -> float:
        """Of a coordinate at a place (d,), without slopes from before: the mean of both images."""
        _, whitening, _, _ = self._best
        white = whitening @ (self.SPREAD**2 * self.alike(place, self.looks.places) + self._everywhere)
        return max(self._most - float(np.square(white).sum()) / len(white), 0.0)

    def unsure(self, place: Array) -> Array:
        """Variances (2,) of a coordinate at a place (d,) in each image, over all lengths that may be.

        As long as looks tell little of the lengths, that is far more than at the best of them.
        """
        known = (self.whitening @ self._covariances(place)[:, None, :, None]).swapaxes(2, 3)
        points = (known @ self.white)[:, :, 0]
        within = np.maximum(self._most - np.square(known[:, :, 0]).sum(2), 0.0)
        odds = (
            np.exp(self.evidence - self.evidence.max())[:, None]
            / np.exp(self.evidence - self.evidence.max()).sum()
        )
        mean = (odds[..., None] * points).sum(0)
        between = np.square(points - mean).mean(2)
        return np.asarray((odds * (within + between)).sum(0))

    def at_all(self, places: Array) -> tuple[Array, Array, Array]:
        """The same at places (k, d), of a function without slopes from before.

        Returns:
            Points (k, 2, 2), variances (k, 2), and slopes by registers (k, 2, 2, m).
        """
        lengths, whitening, white, _ = self._best
        towards = (places[:, None] - self.looks.places) / lengths
        near = self.SPREAD**2 * np.exp(-np.square(towards).sum(2) / 2)
        known = whitening @ (near + self.OFFSET**2).T
        sums = (white @ whitening).swapaxes(1, 2)
        steep = -near[:, :, None] * (towards / lengths)[:, :, : self.motors]
        variances = np.maximum(self.SPREAD**2 + self.OFFSET**2 - np.square(known).sum(1), 0.0).T
        return (
            (white @ known).transpose(2, 0, 1),
            np.broadcast_to(variances, (len(places), 2)),
            np.einsum("pnc,knm->kpcm", sums, steep),
        )

    def alike(self, place: Array, places: Array) -> Array:
        """How the point at a place (d,) correlates with it at others (k, d), but for what is added."""
        towards = (places - place) / self.lengths[self.best]
        return np.asarray(np.exp(np.einsum("kd,kd->k", towards, towards) / -2))

    def _covariances(self, place: Array) -> Array:
        """Prior covariances (h, n) of a place (d,) and those looked at, and with slopes from before."""
        towards = place - self.looks.places
        squares = np.square(towards / self.lengths[:, None]).sum(2)
        near = self.SPREAD**2 * np.exp(-squares / 2)
        cross, known = near + self._everywhere, self.known_slopes
        if known:
            squares = self.lengths[:, : self.motors] ** 2
            cross[:, :known] = near[:, :known] * towards[0, : self.motors] / squares
        return cross


def inverse(factors: Array) -> Array:
    """Inverses of lower triangular matrices (..., n, n): by halves, as most of one is zeros or products."""
    half = factors.shape[-1] // 2
    if half < 16:
        return np.asarray(np.linalg.inv(factors))
    first, last = inverse(factors[..., :half, :half]), inverse(factors[..., half:, half:])
    inverses = np.zeros_like(factors)
    inverses[..., :half, :half], inverses[..., half:, half:] = first, last
    inverses[..., half:, :half] = -last @ factors[..., half:, :half] @ first
    return inverses


IMAGE_AREA = (IMAGE_SIZE * IMAGE_UNIT) ** 2
"""In square image units."""


def price() -> float:
    """The logarithm of how probable it is beforehand that a look is mistaken, and just there."""
    return float(np.log(Gating.MISTAKEN / Gating.OF / IMAGE_AREA))


def right_looks(function: GaussianProcess) -> Flags:
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


def without_mistaken(function: GaussianProcess, before: GaussianProcess) -> GaussianProcess:
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


def solved(function: GaussianProcess) -> tuple[Array, Array]:
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


LATEST = 100
"""So many looks tell (a guard: it takes time)."""


def relative_lengths(function: GaussianProcess, since: int) -> tuple[Array, int]:
    """Over how many registers a point is smooth along each motor, by the looks from the index `since` on.

    Returns:
        Factors (m,) beside the other motors, whose product is one, and how many looks tell that: those at
        both images; where they are fewer than `ALIKE_LOOKS`, none.
    """
    looks = function.looks.only(slice(since, None))
    looks = looks.only(np.asarray(np.isfinite(looks.variances).all(1))).only(slice(-LATEST, None))
    if len(looks.places) < ALIKE_LOOKS:
        return np.ones(function.motors), 0
    fitted = function.of(looks, function.motors, function.lengths[function.best]).refitted()
    logarithms = np.log(fitted.lengths[0, : function.motors])
    return np.exp(logarithms - logarithms.mean()), len(looks.places)
