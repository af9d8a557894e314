"""What has changed: the explanation of what is seen now that is most probable (paper, section 5)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from calfree_gym.image import CAMERAS

from ..adaptation.detector import NO_CAMERA
from ..adaptation.pairs import Pairs
from ..base.observation import Array, Flags
from .fitting import Fit, Fitted, Gaussian, any_std, log_evidence
from .known import Known
from .starts import reversing, rolled

NOTHING = "nothing"
SELDOM = 1000.0
"""Beforehand the world changes once in so many trials. Choice, as of `AdaptiveMemory`."""
STEPS = 40
"""Of least squares (a guard)."""


class Explanation(NamedTuple):
    """One of what is seen now.

    Attributes:
        kind: "nothing", "left camera", "left camera turned", "both cameras", "motor 1", "motor 1 reversed",
            "gripper" and so on.
        before: What is known of all numbers without what is seen now.
        fitted: What explains that best.
        evidence: The logarithm of its odds.
    """

    kind: str
    before: Gaussian
    fitted: Fitted
    evidence: float


@dataclass(frozen=True)
class Change:
    """A change of the world that was seen, or seems to have been.

    Attributes:
        known: What was known before it.
        cameras: Which of them (2,) see something else than they should.
        since: What was seen since.
    """

    known: Known
    cameras: Flags
    since: Pairs

    @property
    def trial(self) -> int:
        """The first that showed it."""
        return int(self.since.trials[0])

    def going_on(self, pairs: Pairs, cameras: Flags = NO_CAMERA) -> Change:
        """The same, where more was seen."""
        return Change(self.known, self.cameras | cameras, self.since + pairs)

    @cached_property
    def explanation(self) -> Explanation:
        """The most probable one."""
        return max(self._explanations(), key=lambda each: each.evidence)

    def _explanations(self) -> Iterator[Explanation]:
        chain, numbers = self.known.chain, self.known.numbers
        yield self._by(NOTHING, [], numbers.mean[None])
        of_cameras = []
        for camera in (each for each in range(len(CAMERAS)) if self.cameras[each]):
            name, starts = f"{CAMERAS[camera]} camera", rolled(chain, numbers.mean, camera)
            of_cameras.append(self._by(name, [chain.camera(camera)], starts))
            yield self._by(f"{name} turned", [chain.turn(camera)], starts)
        yield from of_cameras
        if not self.cameras.all():
            return
        both = numbers.mean.copy()
        for camera, each in enumerate(of_cameras):
            both[chain.camera(camera)] = each.fitted.numbers[chain.camera(camera)]
        yield self._by("both cameras", [chain.cameras], both[None])
        for motor in range(chain.motors):
            name, signs = f"motor {motor + 1}", reversing(chain, motor)
            yield self._by(name, [chain.joint(motor)], np.stack([numbers.mean, signs * numbers.mean]))
            yield self._by(f"{name} reversed", [], (signs * numbers.mean)[None], numbers.mirrored(signs))
        yield self._by("gripper", [chain.gripper], numbers.mean[None])

    def _by(
        self, kind: str, changed: list[slice], starts: Array, before: Gaussian | None = None
    ) -> Explanation:
        """By numbers that changed to any others, or are known otherwise `before`."""
        chain, numbers = self.known.chain, before or self.known.numbers
        which = np.zeros(chain.size, bool)
        for each in changed:
            which[each] = True
        now = numbers.but_for(which, any_std(chain)) if changed else numbers
        fit = Fit(chain, self.since, now)
        fitted = min(fit(starts, STEPS), key=lambda each: each.cost)
        after = fit.known(fitted)
        odds = np.log(SELDOM) if kind == NOTHING else 0.0
        return Explanation(kind, now, fitted, odds + log_evidence(now, fitted, after))
