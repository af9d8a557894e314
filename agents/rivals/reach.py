"""One trial by a regression: Gauss-Newton to where gripper and object are expected to meet, else a probe."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from calfree_gym.image import IMAGE_UNIT, rounded

from ..base.observation import Array, Observation
from ..base.registers import Stops
from ..servo.perception import ObservationFilter
from ..servo.trial import HARDLY_NEARER, Motions
from .images import ImageRegression
from .looks import RegressionLooks

CAUTION = 0.3
"""How much the variance of the image distance counts beside the square of its mean. Choice, as all numbers
here; tried in wild worlds 81000 to 81002."""
NEAR = 1e-4
"""How much the square of words counts (a guard: it decides among equals)."""
DRAWN, NEARBY, SPREAD = 150, 60, 0.15
"""It begins at the best of so many places within a motion, and of so many that spread about the present."""
STEPS, DIFFERENCE, DAMPING = 8, 1e-3, 1e-4
"""Of Gauss-Newton (guards)."""
ENOUGH = 0.99
"""It ends where a step leaves more than this share of the cost (a guard)."""
UNKNOWN, UNKNOWN_PX = 0.3, 10.0
"""It probes where a step is to leave more than this share of the distance, and more than so many pixels."""
PROBE, PROBE_PX, MOST_PROBE, STEP = 0.05, 24.0, 2.0, 0.5
"""A probe is so large a word for each motor, but no larger than moves points so far in the images and than so
many times that; the step beside it is no larger than the last one."""
PATIENCE = 12
"""After so many motions of a trial that came hardly nearer, only its own looks count. Choice: as many as a
first reach takes."""


@dataclass
class RegressionFindings:
    """What a trial finds out.

    Attributes:
        images: What is known of image points.
        looks: All that it is known by.
        filter: What is known of observations.
        random: Draws places and probes.
        ends: Bounds of the registers (2, m), as the observation space has them.
        gripper_home: The gripper's sensor vector at home (4,); None where it was not seen.
    """

    images: ImageRegression
    looks: RegressionLooks
    filter: ObservationFilter
    random: np.random.Generator
    ends: Array
    gripper_home: Array | None = None

    def see(self, seen: Observation, home: Observation) -> None:
        """Learns from a look, in a trial that began with `home`."""
        look = RegressionLooks.one(seen, home, self.filter.noise.px)
        self.images.learn(look)
        self.looks += look

    def begin_anew(self, unlearned: ImageRegression, looks: RegressionLooks) -> None:
        """Knows what these looks tell, and no others."""
        self.images, self.looks = unlearned.copy(), looks
        self.images.learn(looks)


class RegressionReach:
    """One trial.

    Attributes:
        now: What is estimated after the last motion.

    Args:
        first: The trial's first observation that can be trusted.
        findings: What to begin with.
        unlearned: Image points before any look, for where looks of earlier trials lead nowhere; None where
            these are not doubted.
    """

    def __init__(
        self, first: Observation, findings: RegressionFindings, unlearned: ImageRegression | None
    ) -> None:
        self.now = self._first = first
        self._findings, self._unlearned = findings, unlearned
        self._stops = Stops(first.registers)
        self._earlier = len(findings.looks)
        self._seen_at = first.registers
        self._nearest_px, self._in_vain = np.inf, 0
        findings.see(first, first)

    def go(self) -> Motions:
        """Moves until the trial ends."""
        while True:
            yield from self._move(self._words())
            while self._findings.filter.needs_samples:
                yield from self._move(np.zeros_like(self.now.registers))

    def _move(self, words: Array) -> Motions:
        """Executes words (m,), and learns from what is then seen."""
        before, images, home = self.now, self._findings.images, self._first.object
        observation = yield words
        here = observation.registers
        self._stops.learn(words, words - (here - before.registers), here)
        then, now = images.points(np.stack([before.registers, here]), home)
        expected = before.points + (now - then).reshape(4, 2)
        variances = images.variances(here[None], before.registers, home).reshape(4, 2).max(1)
        deviations_px = np.hypot(np.sqrt(variances) / IMAGE_UNIT, images.misfit_px)
        self.now = yield from self._findings.filter.settle(observation, before, expected, deviations_px)
        self._findings.see(self.now, self._first)
        self._judge()

    def _judge(self) -> None:
        """Notes where all is seen, and forgets earlier trials where it comes no nearer."""
        if not self._findings.filter.lost.any():
            self._seen_at = self.now.registers
        if self.now.distance_px < HARDLY_NEARER * self._nearest_px:
            self._nearest_px, self._in_vain = self.now.distance_px, 0
            return
        self._in_vain += 1
        if self._in_vain == PATIENCE and self._unlearned is not None:
            self._findings.begin_anew(self._unlearned, self._findings.looks.only(slice(self._earlier, None)))
            self._unlearned = None

    def _words(self) -> Array:
        """The next words (m,): a step, with a probe where that is to leave too much; half back when blind."""
        here = self.now.registers
        if self._findings.filter.lost.any():
            return (self._seen_at - here) / 2
        least, most = self._findings.ends
        lowest = np.maximum(np.maximum(self._stops.lowest, here - 1), least)
        highest = np.minimum(np.minimum(self._stops.highest, here + 1), most)
        goal, left = self._seek(lowest, highest)
        if left < max(UNKNOWN * float(np.linalg.norm(self.now.distance)), UNKNOWN_PX * IMAGE_UNIT):
            return goal - here
        words = (goal - here) / max(1.0, float(np.abs(goal - here).max()) / STEP)
        return np.clip(here + words + self._probe(), lowest, highest) - here

    def _probe(self) -> Array:
        """Words (m,) for all motors, of random signs, that move points about as far as is wanted."""
        random, here, home = self._findings.random, self.now.registers, self._first.object
        size = len(here)
        probe = PROBE * random.choice([-1.0, 1.0], size) * random.uniform(0.5, 1.0, size)
        moved = self._distances((here + probe)[None])[0] - self.now.distance
        variances = self._findings.images.distance_variances((here + probe)[None], here, home)
        moves = np.sqrt(variances.mean() + np.square(moved).mean())
        return np.asarray(probe * min(MOST_PROBE, PROBE_PX * IMAGE_UNIT / max(float(moves), IMAGE_UNIT)))

    def _seek(self, lowest: Array, highest: Array) -> tuple[Array, float]:
        """Registers (m,) of least cost between bounds (m,), and the root of the cost there."""
        here, random = self.now.registers, self._findings.random
        drawn = random.uniform(lowest, highest, (DRAWN, len(here)))
        nearby = here + SPREAD * random.normal(size=(NEARBY, len(here)))
        places = np.concatenate([here[None], drawn, nearby]).clip(lowest, highest)
        place, cost = self._best(places)
        for _ in range(STEPS):
            beside = place + np.concatenate([np.zeros((1, len(here))), DIFFERENCE * np.eye(len(here))])
            distances = self._distances(beside)
            jacobian = (distances[1:] - distances[0]).T / DIFFERENCE
            normal = jacobian.T @ jacobian + DAMPING * np.eye(len(here))
            step = -np.linalg.solve(normal, jacobian.T @ distances[0])
            next_, left = self._best((place + np.outer([1.0, 0.5, 0.25], step)).clip(lowest, highest))
            if left >= ENOUGH * cost:
                break
            place, cost = next_, left
        return place, float(np.sqrt(cost))

    def _best(self, places: Array) -> tuple[Array, float]:
        """The one of places (n, m) whose cost is least, and that cost."""
        here, home = self.now.registers, self._first.object
        variances = self._findings.images.distance_variances(places, here, home)
        costs = np.square(self._distances(places)).sum(1) + CAUTION * variances.sum(1)
        costs = rounded(costs + NEAR * np.square(places - here).sum(1))
        best = int(costs.argmin())
        return places[best], float(costs[best])

    def _distances(self, places: Array) -> Any:
        """The image distances (n, 4) that are expected at registers (n, m)."""
        points = self._findings.images.points(np.vstack([self.now.registers, places]), self._first.object)
        distances = points[:, 0] - points[:, 1]
        return self.now.distance + distances[1:] - distances[0]
