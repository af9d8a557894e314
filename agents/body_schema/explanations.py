"""What has changed: the explanation of what is seen now that is most probable (paper, section 5)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from calfree_gym.image import CAMERAS, rounded

from ..adaptation.detector import NO_CAMERA
from ..adaptation.pairs import Pairs
from ..base.observation import Array, Flags
from .fitting import Fit, Gaussian, any_std
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
        known: What is known then.
        evidence: The logarithm of its odds.
    """

    kind: str
    known: Known
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
        return max(self._explanations(), key=lambda each: rounded(each.evidence))

    def _explanations(self) -> Iterator[Explanation]:
        chain, numbers = self.known.chain, self.known.numbers
        yield self._by(NOTHING, numbers, numbers.mean[None])
        both = numbers.mean.copy()
        for camera, name in enumerate(CAMERAS):
            if not self.cameras[camera]:
                continue
            starts, of_camera = rolled(chain, numbers.mean, camera), chain.camera(camera)
            yield self._by(f"{name} camera turned", self._but_for(chain.turn(camera)), starts)
            changed = self._by(f"{name} camera", self._but_for(of_camera), starts)
            yield changed
            both[of_camera] = changed.known.fitted.numbers[of_camera]
        if not self.cameras.all():
            return
        yield self._by("both cameras", self._but_for(chain.cameras), both[None])
        for motor in range(chain.motors):
            name, mirrored = f"motor {motor + 1}", numbers.mirrored(reversing(chain, motor))
            starts = np.stack([numbers.mean, mirrored.mean])
            yield self._by(name, self._but_for(chain.joint(motor)), starts)
            yield self._by(f"{name} reversed", mirrored, mirrored.mean[None])
        yield self._by("gripper", self._but_for(chain.gripper), numbers.mean[None])

    def _but_for(self, changed: slice) -> Gaussian:
        """What was known, where some numbers may have changed to any others."""
        chain = self.known.chain
        which = np.zeros(chain.size, bool)
        which[changed] = True
        return self.known.numbers.but_for(which, any_std(chain))

    def _by(self, kind: str, before: Gaussian, starts: Array) -> Explanation:
        """The explanation by what was known `before`, fitted from `starts` (s, p)."""
        fits = Fit(self.known.chain, self.since, before)(starts, STEPS)
        known = Known(self.known.chain, before, self.since, min(fits, key=lambda each: rounded(each.cost)))
        odds = np.log(SELDOM) if kind == NOTHING else 0.0
        return Explanation(kind, known, odds + known.evidence)
