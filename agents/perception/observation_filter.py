"""Observations that can be trusted, from image points that may be noisy, mistaken, missing or late.

One mechanism for all servos. An observation that comes out as predicted is taken at once. Where a point is
not seen, or is not where it is predicted, or where nothing moved at all, the robot observes again (zero
words: a motion, and counted) until observations agree. From observations at one place it also learns how
noisy, how gappy and how late they are; no setting says so.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from copy import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import lengths_px

from ..base.checks import checked_array
from ..base.observation import POINTS, Array, Flags, Observation
from .gating import Gating
from .latency import LatencyEstimate
from .noise import NoiseEstimate
from .visibility import Visibility

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
        self.gating.counts = checked_array(arrays, "mistaken", (2,))
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
