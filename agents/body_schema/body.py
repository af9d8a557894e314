"""What a robot takes its body for, by all that it saw in earlier trials; and that it has changed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import CAMERAS, IMAGE_UNIT, rounded

from ..base.checks import checked_array
from ..base.observation import Array, Flags
from ..base.storage import prefixed, under
from ..memory.detector import NO_CAMERA
from ..memory.pairs import Pairs
from .chain import JointChain
from .fitting import Fit, Gaussian, Known, any_std, random_starts, reversing, rolled

Mounts = tuple[int, int]
STILL = 6.0
"""What is seen within so many times the noise of where it was from home is not moved. Choice."""
MOVED = 0.1
"""It is moved where this share of its coordinates is. Choice: some are mistaken."""
RIDGE = 1e-3
"""Of the regression, relative to the mean square of its registers (a guard)."""


def likely_mounts(pairs: Pairs, count: int | None = None) -> list[Mounts]:
    """How many motors, from the base, move the left and the right camera: guesses, the best `count` first.

    Motors before a camera move the object's image and not the gripper's; motors behind it, the other way
    round. The guesses are by linear regression of both on the registers.
    """
    motors = pairs.registers.shape[1]
    seen = pairs.only(pairs.with_object)
    moved = seen.objects - seen.homes
    if not _moves(moved, seen.noise_px):
        return [(0, 0)]
    at_home = ~pairs.registers.any(1)
    if not (at_home.any() and seen.registers.any()):
        return [(0, 0)]
    home = np.median(pairs.sensors[at_home], axis=0)
    if not _moves(pairs.sensors - home, pairs.noise_px):
        return [(motors, motors)]
    gripper = _squares(pairs.registers, pairs.sensors - home)
    object_ = _squares(seen.registers, moved)
    unlike = [gripper[:, :split].sum(1) + object_[:, split:].sum(1) for split in range(motors)]
    splits = np.array(unlike)  # (m, cameras)
    splits /= gripper.sum(1) + object_.sum(1)
    left, right = rounded(splits).argmin(0)
    alike = [(int(k), int(k)) for k in rounded(splits.sum(1)).argsort(kind="stable")]
    return list(dict.fromkeys([(int(left), int(right)), *alike]))[:count]


def _moves(moved: Array, noise_px: Array) -> bool:
    """Whether sensor vectors that are so much from home (n, 4) are moved, in noise of (n,) pixels."""
    far = np.abs(moved) > STILL * noise_px[:, None] * IMAGE_UNIT
    return bool(len(far) and far.mean() >= MOVED)


def _squares(registers: Array, moved: Array) -> Array:
    """By how much each motor moves each image, squared (2, m), from registers (n, m) and sensors (n, 4)."""
    away = registers.any(1)
    registers, moved = registers[away], moved[away]
    weights = 1 / np.square(registers).sum(1)[:, None]  # what is not linear grows with the square
    weighted, moved = registers * weights, moved * weights
    square = weighted.T @ weighted
    square += RIDGE * np.trace(square) / len(square) * np.eye(len(square))
    slopes = np.linalg.solve(square, weighted.T @ moved)  # (m, 4)
    return np.asarray(np.square(slopes).reshape(-1, len(CAMERAS), 2).sum(2).T)


NOTHING = "nothing"
SELDOM = 1000.0
"""Beforehand the world changes once in so many trials. Choice, as of `AdaptiveMemory`."""
STEPS = 40
"""Of least squares (a guard)."""


class BodyExplanation(NamedTuple):
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
class BodyChange:
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

    def going_on(self, pairs: Pairs, cameras: Flags = NO_CAMERA) -> BodyChange:
        """The same, where more was seen."""
        return BodyChange(self.known, self.cameras | cameras, self.since + pairs)

    @cached_property
    def explanation(self) -> BodyExplanation:
        """The most probable one."""
        return max(self._explanations(), key=lambda each: rounded(each.evidence))

    def _explanations(self) -> Iterator[BodyExplanation]:
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

    def _by(self, kind: str, before: Gaussian, starts: Array) -> BodyExplanation:
        """The explanation by what was known `before`, fitted from `starts` (s, p)."""
        fits = Fit(self.known.chain, self.since, before)(starts, STEPS)
        known = Known(self.known.chain, before, self.since, min(fits, key=lambda each: rounded(each.cost)))
        odds = np.log(SELDOM) if kind == NOTHING else 0.0
        return BodyExplanation(kind, known, odds + known.evidence)


class BodyEvent(NamedTuple):
    """A change of the world, as it was recognised.

    Attributes:
        trial: The first trial, counted from 0, that showed it.
        kind: What has changed, see `BodyExplanation`.
    """

    trial: int
    kind: str


class Body:
    """What a robot takes its body for.

    Each trial refits it. As long as it explains too little of what was seen, it is also sought from nothing.
    A trial that contradicts it shows that the world has changed, or that it was wrong: what explains more.

    Attributes:
        known: What it is taken for; None before the first trial.
        events: The changes that were recognised.
        trials: So many have taught it.

    Args:
        motors: m.
        seed: Of the arms that are drawn to begin with.
    """

    TRIALS, LOOKS = 40, 150
    """So many latest trials tell what it is, and no more than so many looks. Choice: several times what seven
    joints need; a fit takes as long as there are looks."""
    NEWER = 10
    """Where these no longer agree, so many do; and so many tell how wrong it is. Choice: so a drift is
    followed."""
    STARTS, GO_ON_WITH = 8, 3
    """It is sought from so many drawn arms, and on from the best of them. Choice: one in three ends right."""
    GUESSES = 3
    """That is done for so many guesses of which motors move the cameras. Where none explained what was seen,
    for all: from about as many arms together, and on from the best of each guess. Choice."""
    MORE = 1.3
    """And again once so many times as much was seen. Choice, between time and motions."""
    COARSE, COARSE_OUTLYING, COARSE_STEPS = 30.0, 5.0, 25
    """At first as if noise were so many times as large, with outliers so many times that away, by so many
    steps. Choice: then far places, which cost most, do not decide."""
    STEPS = 60
    """Of a fit (a guard: from what is known, two or three are enough)."""
    RECENT = 5
    """In so many trials, that of a change included, what is seen tells more of that change. Choice."""

    def __init__(self, motors: int, seed: int = 0) -> None:
        self.motors = motors
        self.known: Known | None = None
        self.events: list[BodyEvent] = []
        self.trials = 0
        self._offs_px = np.empty(0)
        self._seed = seed
        self._searched = 0
        self._change: BodyChange | None = None

    def learn(self, pairs: Pairs) -> None:
        """Takes in what was seen in a trial."""
        self.trials += 1
        if not len(pairs):
            return
        if self.known is None:
            self._search(pairs)
            return
        self._offs_px = np.append(self._offs_px, self.known.off_px(pairs))[-self.NEWER :]
        if self._change and self.trials > self._change.trial + self.RECENT:
            self._change = None
        cameras = self.known.contradicted(pairs) if self.known.explains else NO_CAMERA
        if cameras.any():
            self._explain(self._likely_change(pairs, cameras))
        elif self._change:
            self._explain(self._change.going_on(pairs))
        else:
            self._go_on(pairs)

    def with_looks(self, pairs: Pairs, sure: bool) -> Known:
        """What it would be taken for, had these been seen as well; of a trial that goes on, not the first.

        Args:
            pairs: The trial's.
            sure: Whether nothing among them can be mistaken.
        """
        assert self.known is not None
        least = 1 if sure else Known.LEAST
        if self.known.explains and (cameras := self.known.contradicted(pairs, least)).any():
            best = self._likely_change(pairs, cameras).explanation
            if best.kind != NOTHING:
                return best.known
        return self._refitted(self.known, self.known.seen + pairs)

    @property
    def off_px(self) -> float:
        """How far from where it expected them gripper points were in the latest trials, root mean square."""
        return float(np.sqrt(np.square(self._offs_px).mean())) if len(self._offs_px) else 0.0

    def _likely_change(self, pairs: Pairs, cameras: Flags) -> BodyChange:
        """That which explains what contradicts: one now, or one lately of which too little was seen."""
        assert self.known is not None
        now = BodyChange(self.known, cameras, pairs)
        if self._change is None:
            return now
        if not self._told and now.explanation.kind != NOTHING:
            return now
        return self._change.going_on(pairs, cameras)

    @property
    def _told(self) -> bool:
        """Whether the change of lately was told as an event."""
        return bool(self._change and self.events and self.events[-1].trial == self._change.trial)

    def _go_on(self, pairs: Pairs) -> None:
        """Learns, where nothing has jumped."""
        assert self.known is not None
        explained_before = self.known.explains
        self.known = self._refitted(self.known, self.known.seen + pairs)
        if self.known.explains:
            return
        if explained_before:
            newer = self._refitted(self.known, self.known.seen.latest(self.NEWER))
            if newer.explains:
                self.known = newer
                return
        self._search(self.known.seen)

    def _refitted(self, known: Known, seen: Pairs) -> Known:
        seen = self._latest(seen)
        (fitted,) = Fit(known.chain, seen, known.before)(known.fitted.numbers[None], self.STEPS)
        return Known(known.chain, known.before, seen, fitted)

    def _latest(self, seen: Pairs) -> Pairs:
        seen = seen.latest(self.TRIALS)
        return seen.only(np.arange(len(seen)) >= len(seen) - self.LOOKS)

    def _search(self, seen: Pairs) -> None:
        """Seeks from nothing what explains it, unless as much was sought not long ago."""
        if len(seen) < self.MORE * self._searched:
            return
        again = self._searched > 0
        guesses = likely_mounts(seen, None if again else self.GUESSES)
        self._searched = len(seen)
        random = np.random.default_rng((self._seed, self.trials))
        found = [] if self.known is None else [self._refitted(self.known, seen)]
        starts, go_on_with = self.STARTS, self.GO_ON_WITH
        if again:
            starts, go_on_with = math.ceil(self.STARTS * self.GUESSES / len(guesses)), 1
        for mounts in guesses:
            chain = JointChain(self.motors, mounts)
            before = Gaussian.of_any(chain)
            fit = Fit(chain, seen, before)
            drawn = random_starts(chain, before.mean, starts, random)
            coarse = fit(drawn, self.COARSE_STEPS, self.COARSE, self.COARSE_OUTLYING)
            best = sorted(coarse, key=lambda each: rounded(each.cost))[:go_on_with]
            fine = fit(np.array([each.numbers for each in best]), self.STEPS)
            found.append(Known(chain, before, seen, min(fine, key=lambda each: rounded(each.cost))))
        self.known = max(found, key=lambda each: rounded(each.evidence))

    def _explain(self, change: BodyChange) -> None:
        """Learns from what contradicts what is known."""
        best, before, since = change.explanation, change.known, change.since
        again = self._change is not None and self._change.trial == change.trial
        if again and self._told:
            self.events.pop()
        self._change = change
        if best.kind == NOTHING:
            self.known = before
            self._go_on(since)
            if self.known.before is not before.before:  # it was sought anew
                self._change = None
            return
        if not again and self._was_wrong(before, best.evidence, since):
            self._change = None
            return
        self.events.append(BodyEvent(change.trial, best.kind))
        self.known = best.known
        if not self.known.explains:
            self._searched = self._searched if again else 0
            self._search(self.known.seen)

    def _was_wrong(self, before: Known, changed: float, since: Pairs) -> bool:
        """Whether nothing has changed, but what was known was wrong; what explains all is known then."""
        self.known, self._searched = before, 0
        self._search(self._latest(before.seen + since))
        return self.known.evidence > before.evidence + changed

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All that it knows, as named arrays."""
        arrays = {
            **prefixed("known", self.known.arrays() if self.known else {}),
            "counts": np.array([self.trials, self._searched]),
            "offs_px": self._offs_px,
            "events": np.array(self.events, str).reshape(-1, 2),
        }
        if self._change:
            arrays |= prefixed("before", self._change.known.arrays())
            arrays |= prefixed("since", self._change.since.arrays())
            arrays["changed_cameras"] = self._change.cameras
        return arrays

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Takes over what `arrays` returned; raises ValueError where it does not fit."""
        known, before = (under(name, arrays) for name in ("known", "before"))
        trials, searched = checked_array(arrays, "counts", (2,))
        self.known = Known.of(known, self.motors) if known else None
        self._change = None
        if before:
            cameras = checked_array(arrays, "changed_cameras", (2,)) > 0
            self._change = BodyChange(
                Known.of(before, self.motors), cameras, Pairs.of(under("since", arrays))
            )
        self.trials, self._searched = int(trials), int(searched)
        self._offs_px = checked_array(arrays, "offs_px", (None,))
        self.events = [BodyEvent(int(trial), kind) for trial, kind in arrays["events"]]
