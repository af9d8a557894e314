"""What has changed: the explanation of what is seen now that is most probable (paper, section 5)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from calfree_gym.image import CAMERAS

from ..adaptation.pairs import Pairs
from ..base.observation import Array, Flags
from .fitting import Fit, Fitted, Gaussian, any_std, log_evidence
from .known import Known
from .starts import reversed_joint, rolled

NOTHING = "nothing"
SELDOM = 1000.0
"""Beforehand the world changes once in so many trials. Choice, as of `AdaptiveMemory`."""
STEPS = 40
"""Of least squares (a guard)."""


class Explanation(NamedTuple):
    """One of what is seen now.

    Attributes:
        kind: "nothing", "left camera", "right camera", "both cameras", "motor 1" and so on, or "gripper".
        before: What is known of all numbers without what is seen now.
        fitted: What explains that best.
        evidence: The logarithm of its odds.
    """

    kind: str
    before: Gaussian
    fitted: Fitted
    evidence: float


def explained(known: Known, pairs: Pairs, cameras: Flags) -> Explanation:
    """The most probable explanation.

    Args:
        known: What was known before the change.
        pairs: What was seen since.
        cameras: Which of them (2,) see something else than they should.
    """
    return max(_all(known, pairs, cameras), key=lambda each: each.evidence)


def _all(known: Known, pairs: Pairs, cameras: Flags) -> Iterator[Explanation]:
    chain, numbers = known.chain, known.numbers

    def explanation(kind: str, changed: list[slice], starts: Array) -> Explanation:
        which = np.zeros(chain.size, bool)
        for each in changed:
            which[each] = True
        before = numbers.but_for(which, any_std(chain)) if changed else numbers
        fit = Fit(chain, pairs, before)
        fitted = min(fit(starts, STEPS), key=lambda each: each.cost)
        # what images leave open, such as the unit of lengths, stays open only about the same numbers
        after = fit.known(fitted, np.where(which, fitted.numbers, numbers.mean))
        odds = 0.0 if changed else np.log(SELDOM)
        return Explanation(kind, before, fitted, odds + log_evidence(before, fitted, after))

    yield explanation(NOTHING, [], numbers.mean[None])
    of_cameras = [
        explanation(f"{CAMERAS[each]} camera", [chain.camera(each)], rolled(chain, numbers.mean, each))
        for each in range(len(CAMERAS))
        if cameras[each]
    ]
    yield from of_cameras
    if not cameras.all():
        return
    both = numbers.mean.copy()
    for camera, each in enumerate(of_cameras):
        both[chain.camera(camera)] = each.fitted.numbers[chain.camera(camera)]
    yield explanation("both cameras", [chain.cameras], both[None])
    for motor in range(chain.motors):
        starts = reversed_joint(chain, numbers.mean, motor)
        yield explanation(f"motor {motor + 1}", [chain.joint(motor)], starts)
    yield explanation("gripper", [chain.gripper], numbers.mean[None])
