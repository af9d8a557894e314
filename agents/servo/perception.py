"""Observations that can be trusted, from image points that may be noisy, mistaken, missing or late.

One mechanism for all servos. An observation that comes out as predicted is taken at once. Where a point is
not seen, or is not where it is predicted, or where nothing moved at all, the robot observes again (zero
words: a motion, and counted) until observations agree. From observations at one place it also learns how
noisy, how gappy and how late they are; no setting says so.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from copy import copy
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import IMAGE_SIZE, IMAGE_UNIT, lengths_px, rounded

from ..base.checks import checked_array
from ..base.observation import POINTS, Array, Flags, Observation

MARKER_NOISE_PX = 0.7
"""Noise of an image coordinate before any is known. Derived: the 0.5 px of a good marker, as in coarse
and wild worlds, and a margin of √2."""


class NoiseEstimate:
    """Standard deviation of an image coordinate, by differences between two observations of one place.

    It is the likeliest one (maximum likelihood), where a share of the points is mistaken, and so anywhere in
    the image.

    Every trial shows the gripper at home, which costs no motion. But from one trial to the next cameras can
    be moved, and then the difference is no noise. So it is by homes only as long as few places were observed
    twice in a row.

    Attributes:
        px: The estimate; that of a good marker until there are `ENOUGH` differences.
    """

    ENOUGH = 12
    """Differences of a coordinate. Derived: the estimate is then within 20 % (1 / √(2 · 12))."""
    LATEST = 320
    """This many differences are kept: forty re-observations of all four points (a guard)."""
    LEAST_PX, MOST_PX = 0.5, 40.0
    """Bounds (guards): no marker is known better than half a pixel, and beyond 40 px nothing is reached."""
    TRIED_PX = np.geomspace(LEAST_PX, MOST_PX, 46)
    """Of these the likeliest is taken: steps of a tenth, as it is known to no better than a twentieth."""
    TRIED_SHARES = np.array([0.01, 0.1, 0.3, 0.6])
    """Of differences that tell nothing, as one of two points is mistaken. Choice: two in three are where 40 %
    of the points are."""
    NOISY_PX = 3.0
    """Noise that is worth knowing well: tuned on wild worlds 3000 and up, at 20 px noise."""

    def __init__(self) -> None:
        self.px = MARKER_NOISE_PX
        self._at_once, self._of_homes = np.empty(0), np.empty(0)

    @property
    def measured(self) -> bool:
        """Whether enough points were seen twice in a row at one place."""
        return len(self._at_once) >= self.ENOUGH

    def add(self, difference: Array) -> None:
        """Learns from the difference (k, 2), in image units, of points seen twice in a row at one place."""
        self.restore(self._with(self._at_once, difference), self._of_homes)

    def add_homes(self, difference: Array) -> None:
        """Learns from the difference (k, 2), in image units, of points at home in two trials."""
        self.restore(self._at_once, self._with(self._of_homes, difference))

    def _with(self, differences: Array, new: Array) -> Array:
        return np.concatenate([differences, np.abs(new).ravel() / IMAGE_UNIT])[-self.LATEST :]

    def arrays(self) -> tuple[Array, Array]:
        """The differences (n,) that it is known by, in pixels: of observations in a row, and of homes."""
        return self._at_once, self._of_homes

    def restore(self, at_once: Array, of_homes: Array) -> None:
        """Estimates it by differences (n,) that are known."""
        self._at_once, self._of_homes = at_once, of_homes
        self.px = MARKER_NOISE_PX
        pool = (at_once if self.measured else of_homes) / np.sqrt(2)
        if len(pool) < self.ENOUGH:
            return
        noises, shares = self.TRIED_PX[:, None], self.TRIED_SHARES[:, None, None]
        right = np.sqrt(2 / np.pi) / noises * np.exp(-np.square(pool / noises) / 2)
        mistaken = np.sqrt(2) / IMAGE_SIZE
        likelihoods = np.log((1 - shares) * right + shares * mistaken).sum(2).max(0)
        self.px = float(self.TRIED_PX[rounded(likelihoods).argmax()])


class LatencyEstimate:
    """By how many motions observations come late.

    Attributes:
        motions: The estimate.
        confirmed: Whether a motion has been seen to come in time.
    """

    STILL = 4.0
    """Points have moved whose squared displacements are so many standard deviations above those of noise.
    Derived: that is noise once in some 500 cases (chi square)."""

    def __init__(self) -> None:
        self.motions = 0
        self.confirmed = False

    def wait(
        self, observation: Observation, before: Array, surely_px: Array, noise_px: float
    ) -> Generator[Array, Observation, list[Observation]]:
        """Observes again (zero words) until the points can show the motion.

        Args:
            observation: The first one after the motion.
            before: Points before it (4, 2).
            surely_px: How far each point (4,) must have moved at least.
            noise_px: Standard deviation of an image coordinate.

        Returns:
            One observation, or two at the same place.
        """
        still = np.zeros_like(observation.registers)
        for _ in range(self.motions):
            observation = yield still
        if not observation.visible.any():
            return [observation]
        before_px = lengths_px(observation.points - before)[observation.visible]
        if self._moved(before_px, noise_px):
            self.confirmed = True
        elif not self.confirmed or surely_px.max() > 0:
            later = yield still
            both = observation.visible & later.visible
            since_px = lengths_px(later.points - observation.points)[both]
            if sum(self._moved(each, noise_px) for each in since_px[:, None]) > 1:
                self.motions += 1
                return [later]
            return [observation, later]
        return [observation]

    def _moved(self, displacements_px: Array, noise_px: float) -> bool:
        """Whether points (n,) moved by more than noise would have it, all together."""
        squares = np.square(displacements_px) / (2 * noise_px**2)
        freedom = 2 * len(squares)
        return bool(squares.sum() > freedom + self.STILL * np.sqrt(2 * freedom))


class Visibility:
    """For how long points have not been seen.

    Attributes:
        gaps: Whether a point has come or gone without a motion: points are missing at times.
        returns: How many points that were not seen were seen in one more observation of the same place, and
            how many were not (2,).
        ever: Which points (4,) have been seen at all.
    """

    PATIENCE = 4
    """Where points are missing at times, one that was not seen in more observations is lost. Derived: with
    30 % missing that is a mistake in 0.3⁵ = 0.2 % of the cases."""

    WORTH = 0.3
    """One more observation of the same place is worth a motion where it shows a missing point so often.
    Choice: it costs one motion, and a wrong belief that a point is hidden costs about three."""

    def __init__(self) -> None:
        self.gaps = False
        self.returns = np.zeros(2)
        self.ever = np.zeros(POINTS, bool)
        self._unseen = np.zeros(POINTS, int)

    def add(self, visible: Flags, again: bool) -> None:
        """Takes in which points (4,) are seen now, and whether nothing has moved since the last time."""
        missing = self._unseen > 0
        if again:
            self.returns = self.returns + np.array([(missing & visible).sum(), (missing & ~visible).sum()])
            self.gaps |= bool((missing == visible).any())
        self.ever = self.ever | visible
        self._unseen = np.where(visible, 0, self._unseen + 1)

    @property
    def may_return(self) -> bool:
        """Whether one more observation may well show a missing point, by Laplace's rule of succession."""
        back, out = self.returns
        return bool((1 + back) / (2 + back + out) > self.WORTH)

    @property
    def lost(self) -> Flags:
        """Which points (4,) have not been seen for so long that they must be hidden, or out of view."""
        return self._unseen > (self.PATIENCE if self.gaps else int(self.may_return))


class PointEstimate(NamedTuple):
    """Points as they are estimated.

    Attributes:
        points: (4, 2); where nothing can be trusted, as expected.
        found: Which of them (4,) were seen and trusted.
        inconsistent: Which of them (4,) were trusted although they are not where they were expected.
    """

    points: Array
    found: Flags
    inconsistent: Flags


class Gating:
    """Gates around expected points; where too little is inside them, agreement of several observations.

    A gate ends where a point is as likely to be mistaken, and so anywhere in the image, as to be seen right.

    Attributes:
        counts: How many points were mistaken, of how many (2,), with what is taken for granted beforehand.
    """

    TAILS = 4.0
    """Degrees of freedom of Student's t distribution, in two coordinates, of what is expected: derived, of a
    servo's expectations 5 % miss by more than 4 deviations and 1 % by more than 6 to 9."""
    AGREE = 4.0
    """Points of two observations agree within this many standard deviations of their difference. Derived:
    noise in two coordinates is longer once in exp(4² / 2), some 3,000 cases."""
    MISTAKEN, OF = 1.0, 100.0
    """Beforehand so many of so many points are mistaken. Choice: a hundred looks outweigh it."""

    def __init__(self) -> None:
        self.counts = np.array([self.MISTAKEN, self.OF])

    @property
    def mistaken(self) -> float:
        """The share of points that are mistaken, as far as known."""
        return float(self.counts[0] / self.counts[1])

    def radii(self, deviations_px: Array, noise_px: float) -> Array:
        """Radii (4,) in pixels of the gates around expected points.

        Args:
            deviations_px: Of the coordinates of the points that are expected (4,).
            noise_px: Standard deviation of an image coordinate.
        """
        squares = np.square(deviations_px) + noise_px**2
        odds = self.mistaken / (1 - self.mistaken)
        highest = IMAGE_SIZE**2 / (2 * np.pi * squares * odds)
        power = 2 / (self.TAILS + 2)
        return np.sqrt(self.TAILS * squares * np.maximum(highest**power - 1, 0))

    def estimate(
        self, observations: Sequence[Observation], expected: Array, radii: Array, noise_px: float
    ) -> PointEstimate:
        """The points (4, 2) that observations at one place, one or several, give reason to believe."""
        if len(observations) == 1:
            seen = observations[0].points
            found = observations[0].visible & (lengths_px(seen - expected) <= radii)
            return PointEstimate(np.where(found[:, None], seen, expected), found, np.zeros(POINTS, bool))
        estimate = PointEstimate(expected.copy(), np.zeros(POINTS, bool), np.zeros(POINTS, bool))
        for i in range(POINTS):
            seen = np.array([each.points[i] for each in observations if each.visible[i]]).reshape(-1, 2)
            self._estimate_point(i, seen, expected[i], radii[i], noise_px, estimate)
        return estimate

    def count(self, observations: Sequence[Observation], estimate: PointEstimate, noise_px: float) -> None:
        """Learns from observations at one place how many points are mistaken."""
        for each in observations:
            told = each.visible & estimate.found
            wrong = lengths_px(each.points - estimate.points)[told] > self._agree_px(noise_px)
            self.counts = self.counts + np.array([np.count_nonzero(wrong), len(wrong)])

    def _agree_px(self, noise_px: float) -> float:
        return self.AGREE * np.sqrt(2) * noise_px

    def _estimate_point(
        self, i: int, seen: Array, expected: Array, radius: float, noise_px: float, estimate: PointEstimate
    ) -> None:
        """Writes point i into the estimate: what was seen (k, 2) inside the gate, or agrees."""
        inside = seen[lengths_px(seen - expected) <= radius]
        if len(inside):
            estimate.points[i], estimate.found[i] = np.median(inside, 0), True
        elif len(seen) > 1:
            agreeing = lengths_px(seen[:, None] - seen[None]) <= self._agree_px(noise_px)
            best = agreeing.sum(1).argmax()
            if agreeing[best].sum() > 1:
                estimate.points[i] = seen[agreeing[best]].mean(0)
                estimate.found[i] = estimate.inconsistent[i] = True


Observing = Generator[Array, Observation, Observation]
"""Yields zero words, is sent what is observed, returns an observation that can be trusted."""


class ObservationFilter:
    """What a robot has learned of its observations.

    How noisy they are, and how many are mistaken, is learned over trials; the rest in each trial anew.

    Attributes:
        noise: How noisy image points are.
        latency: How late they come.
        gating: Which of them can be trusted.
        visibility: Which of them are out of view.
        inconsistent: Which points (4,) were last trusted although they were not where they were predicted.
        home: Where the gripper was seen at home in the last trial (2, 2); NaN where it was not.
    """

    MOST_OBSERVATIONS = 8
    """This many observations at one place are made at most. Derived: at 40 % mistaken points two of eight
    agree in 99 % of the cases (binomial), and with 30 % missing points one is seen in 99.99 %."""

    LIKELY = 0.1
    """Where one of four points is mistaken more often, the first are seen twice. Derived: that costs a
    motion, and to begin with a mistaken point about ten."""
    MISSES = 2.5
    """Where half of the latest points miss by so many of their standard deviations, noise is larger than it
    was thought to be. Derived: of right points one in 23 does (exp(-2.5² / 2)); a servo's expectations are
    too sure for several of a dozen, not for half of them."""

    def __init__(self) -> None:
        self.noise = NoiseEstimate()
        self.latency = LatencyEstimate()
        self.gating = Gating()
        self.visibility = Visibility()
        self.inconsistent = np.zeros(POINTS, bool)
        self.home = np.full((2, 2), np.nan)
        self._last: Observation | None = None
        self._begun: Observation | None = None
        self._misses = np.empty(0)

    @property
    def lost(self) -> Flags:
        """Which points (4,) must have got out of view in this trial."""
        return self.visibility.lost & self.visibility.ever

    @property
    def often_mistaken(self) -> bool:
        """Whether so many points are mistaken that one of the four is in more than `LIKELY` of the looks."""
        return POINTS * self.gating.mistaken > self.LIKELY

    @property
    def needs_samples(self) -> bool:
        """Whether it is worth observing again only to learn how noisy image points are."""
        if self.noise.measured or self._last is None or not self._last.visible.any():
            return False
        enough = len(self._misses) == self.noise.ENOUGH
        missed = enough and float(np.median(self._misses)) > self.MISSES
        return missed or self.noise.px > self.noise.NOISY_PX

    def for_next_trial(self) -> ObservationFilter:
        """One that knows what lasts."""
        other = ObservationFilter()
        other.noise, other.gating.counts, other.home = copy(self.noise), self.gating.counts, self.home
        other.visibility.returns = self.visibility.returns
        return other

    def arrays(self) -> dict[str, NDArray[Any]]:
        """What lasts, as named arrays."""
        at_once, of_homes = self.noise.arrays()
        noise = {"noise_differences": at_once, "home_differences": of_homes}
        return noise | {
            "mistaken": self.gating.counts,
            "last_home": self.home,
            "returns": self.visibility.returns,
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Takes over what `arrays` returned; of a version that kept less, the rest is as in a new one."""
        arrays = {**ObservationFilter().arrays(), **arrays}
        self.noise.restore(
            *(checked_array(arrays, name, (None,)) for name in ("noise_differences", "home_differences"))
        )
        self.gating.counts = checked_array(arrays, "mistaken", (2,), most=2**53)
        self.home = checked_array(arrays, "last_home", (2, 2), allow_nan=True)
        self.visibility.returns = checked_array(arrays, "returns", (2,))

    def first(self, observation: Observation) -> Observing:
        """Observes again until every point has been seen, or is hidden; twice alike where many are mistaken.

        An observation that has come out of it is taken as it is.
        """
        if observation is self._begun or (self._last is not None and observation.visible.all()):
            return observation
        self._compare_homes(observation)
        self._begun = yield from (self._agreed if self.often_mistaken else self._found)(observation)
        return self._begun

    def _found(self, observation: Observation) -> Observing:
        """Observes again until every point has been seen, or is hidden."""
        points, found = observation.points.copy(), observation.visible
        self._take_in(observation)
        for _ in range(self.MOST_OBSERVATIONS):
            if (found | self.visibility.lost).all():
                break
            observation = yield np.zeros_like(observation.registers)
            self._take_in(observation)
            new = observation.visible & ~found
            points[new] = observation.points[new]
            found = found | new
        return observation.estimated(points, found)

    def _compare_homes(self, observation: Observation) -> None:
        """Learns how noisy points are from the gripper at home, where every trial shows it."""
        if self._last is None and not observation.registers.any():
            seen = observation.visible[:2]
            both = seen & np.isfinite(self.home).all(1)
            if both.any():
                self.noise.add_homes((observation.points[:2] - self.home)[both])
            self.home = np.where(seen[:, None], observation.points[:2], self.home)

    def _agreed(self, observation: Observation) -> Observing:
        """Observes again until two observations of every point agree."""
        self._take_in(observation)
        observations = [observation]
        while True:
            estimate = self.gating.estimate(
                observations, np.zeros((POINTS, 2)), np.zeros(POINTS), self.noise.px
            )
            if estimate.found.all() or len(observations) == self.MOST_OBSERVATIONS:
                self.gating.count(observations, estimate, self.noise.px)
                seen = observations[-1]
                points = np.where(estimate.found[:, None], estimate.points, seen.points)
                return seen.estimated(points, estimate.found | seen.visible)
            observations.append((yield np.zeros_like(observation.registers)))
            self._take_in(observations[-1])

    def settle(
        self, observation: Observation, before: Observation, expected: Array, deviations_px: Array
    ) -> Observing:
        """Observes again until what was observed after a motion can be trusted.

        Args:
            observation: The first one after the motion.
            before: The trusted one before it.
            expected: Where the points should be (4, 2).
            deviations_px: Of their coordinates (4,), noise apart.

        Returns:
            An observation with estimated points; not visible where there was nothing to believe.
        """
        settled = yield from self._settled(observation, before, expected, deviations_px)
        if (settled.registers != before.registers).any():
            misses = lengths_px(settled.points - expected) / np.hypot(deviations_px, self.noise.px)
            new = misses[settled.visible & ~self.inconsistent]
            self._misses = np.concatenate([self._misses, new])[-self.noise.ENOUGH :]
        return settled

    def _settled(
        self, observation: Observation, before: Observation, expected: Array, deviations_px: Array
    ) -> Observing:
        """`settle`, without a thought of how noisy points are."""
        self._take_in(observation)
        radii = self.gating.radii(deviations_px, self.noise.px)
        if self._as_expected(observation, expected, radii):
            self.inconsistent = np.zeros(POINTS, bool)
            self.gating.counts = self.gating.counts + np.array([0, POINTS])
            return observation
        surely_px = lengths_px(expected - before.points) - radii
        observations = yield from self.latency.wait(observation, before.points, surely_px, self.noise.px)
        self._last = observations[-1]
        while True:
            radii = self.gating.radii(deviations_px, self.noise.px)
            estimate = self.gating.estimate(observations, expected, radii, self.noise.px)
            enough = len(observations) == self.MOST_OBSERVATIONS
            if enough or not self._worth_another(observations, estimate.found):
                self.inconsistent = estimate.inconsistent
                self.gating.count(observations, estimate, self.noise.px)
                return observations[-1].estimated(estimate.points, estimate.found)
            observations.append((yield np.zeros_like(observation.registers)))
            self._take_in(observations[-1])

    def _as_expected(self, observation: Observation, expected: Array, radii: Array) -> bool:
        """Whether an observation came in time, and all is seen and near where it is expected."""
        if self.latency.motions or not self.latency.confirmed or not observation.visible.all():
            return False
        return bool((lengths_px(observation.points - expected) <= radii).all())

    def _worth_another(self, observations: list[Observation], found: Flags) -> bool:
        """Whether one more observation at this place may show what is not trusted yet."""
        seen = np.array([each.visible for each in observations]).any(0)
        waiting = ~self.visibility.lost & (not self.visibility.gaps)
        return bool((~found & (seen | waiting)).any())

    def _take_in(self, observation: Observation) -> None:
        """Learns from an observation, more so where it is one more at the place of the last."""
        last, self._last = self._last, observation
        again = last is not None and bool((observation.registers == last.registers).all())
        self.visibility.add(observation.visible, again)
        if last is None or not again:
            return
        seen = last.visible & observation.visible
        self.noise.add((observation.points - last.points)[seen])
