"""When knowledge is kept, mapped all at once, set aside for a new start, or recalled from the archive.

The paper asks when to discard what is stored, and when "to modify all stored data at once in a systematic
way". The robot tells by motions that it makes anyway: by the gripper's view at home, and by what it sees
elsewhere and did not expect. What it knew before a change stays as it was; what it makes of that is thought
over as more is seen, until that is enough.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import astuple, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.adaptation.arm_change import ArmChange, fit_arm
from agents.adaptation.camera_change import CameraChange, fit_camera
from agents.adaptation.home_view import SIGMAS, Cameras, HomeView, lengths_px
from agents.adaptation.pairs import Pairs
from agents.base.checks import checked_array
from agents.base.observation import Array
from agents.base.storage import prefixed, under
from agents.jacobian.estimator import MARKER_NOISE_PX as NOISE_PX
from agents.knowledge.gaussian_process import GaussianProcess
from agents.knowledge.knowledge import Knowledge
from calfree_gym.image import IMAGE_UNIT

ON_CHANGE = ("recognise", "map", "discard", "keep")
"""What is done where something has jumped: what is best by what was seen, or always the same. A drift is
followed, unless all is to be kept."""

Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Event:
    """A change of the world, as it was recognised.

    Attributes:
        trial: The first trial, counted from 0, that showed it.
        kind: "drift", "re-aimed", "rolled", "zoomed", "moved", "replaced", "arm changed", "back", or
            "unknown" where it was not looked into.
        action: What was done with what was known: "map", "discard", or "recall" from the archive.
    """

    trial: int
    kind: str
    action: str


class Recognition:
    """Teaches a knowledge base, and acts upon it where the world has changed.

    Attributes:
        knowledge: The knowledge base.
        views: What should be seen where: the knowledge base itself, where it can tell.
        home: The gripper's view at home.
        archive: What was known before changes, the latest last.
        events: The changes that were recognised.

    Args:
        knowledge: An empty knowledge base.
        motors: Number of registers.
        on_change: One of `ON_CHANGE`.
    """

    STRANGE_PX = 4.0
    """What is off by less is not worth a thought."""
    STRANGE = 2.5
    """What is strange is so many times further off, for what is known there, than is usual."""
    USUAL = 20
    """What is usual is known from so many trials."""
    AGAIN = 4
    """What is strange counts where it is so again within so many trials."""
    MISTAKEN_PX = 30.0
    """What was further off, and was not seen again so, was mistaken."""
    MANY = 4
    """So many looks in one trial are enough to be sure, where most of them are strange."""
    DISCARD_PX = 40.0
    """Beyond this deviation of the best explanation it is better to start empty."""
    SURE = 30
    """So many trials after a change it is no longer thought over."""
    SOON = 5
    """So many it is thought over after each, and then after each so many."""
    DRIFT = 12
    """Trials by which a drift is followed."""
    ARCHIVED = 8
    """So many worlds are kept in the archive."""

    def __init__(self, knowledge: Knowledge, motors: int, on_change: str = "recognise") -> None:
        if on_change not in ON_CHANGE:
            raise ValueError(f"on_change is {on_change!r}; allowed: {', '.join(ON_CHANGE)}")
        self.knowledge = knowledge
        self.views = knowledge if isinstance(knowledge, GaussianProcess) else GaussianProcess(motors)
        self.on_change = on_change
        self.home = HomeView()
        self.archive: list[Arrays] = []
        self.events: list[Event] = []
        self._nothing = Pairs(np.empty((0, motors)), np.empty((0, 4)), np.empty(0, np.int64))
        self._empty = copy.deepcopy(self._known())
        self._trial = 0
        self._told = np.zeros(2, bool)
        self._doubted = np.empty((0, 4))
        self._scores = np.empty((0, 2))
        self._held = self._recent = self._since = self._nothing
        self._before: Arrays = {}
        self._cameras = np.zeros(2, bool)
        self._drifting = False

    def fitting(self, gripper: Array) -> Knowledge | None:
        """The knowledge for a world in which the gripper at home is seen there (4,), if there is any."""
        if self.on_change == "keep" or not (self._told | self.home.jumped(gripper)).any():
            return self.knowledge
        archived = self._archived(gripper)
        return archived.knowledge if archived else None

    def tell(self, cameras: Cameras) -> None:
        """Takes it from somebody who knows: before the next trial these cameras (2,) have been changed.

        Both, where it is the arm.
        """
        self._told = np.asarray(cameras, bool)

    def learn(self, registers: Array, sensors: Array) -> None:
        """Takes in a trial: what was seen (n, 4), and at which registers (n, m); at home first.

        A trial in which home was not seen teaches nothing, unless changes are of no interest.
        """
        pairs = Pairs(registers, sensors.copy(), np.full(len(registers), self._trial))
        self._trial += 1
        if self.on_change == "keep":
            self._learn(pairs)
            return
        if not len(pairs) or registers[0].any():
            return
        jumped = self._jumped(pairs)
        if len(self.views.registers):
            jumped = jumped | self._told
        self._told = np.zeros(2, bool)
        self.home.add(pairs.sensors[0])
        strange = self._strange(pairs)
        if jumped.any():
            self._change(pairs, jumped)
        elif strange.any() and (len(self._held) or self._surely(strange)):
            self._change(self._held + pairs, np.asarray(strange.any(0)))
        elif strange.any():
            self._held = pairs
        else:
            if len(self._held) and self._held.trials[0] <= self._trial - self.AGAIN:
                pairs, self._held = self._credible(self._held) + pairs, self._nothing
            self._go_on(pairs)

    def _go_on(self, pairs: Pairs) -> None:
        """Nothing has jumped: learns, thinks on about the last change, and follows a drift."""
        self._recent = (self._recent + pairs).latest(self.DRIFT)
        if self._before:
            self._since = self._since + pairs
            age = self._trial - self.events[-1].trial
            if self._drifting or age <= self.SOON or age % self.SOON == 0:
                self._think()
            else:
                self._learn(pairs)
            return
        self._learn(pairs)
        drifting = self.home.drifting()
        if drifting.any():
            self._follow(drifting)

    def _change(self, pairs: Pairs, cameras: Cameras) -> None:
        """Something has jumped: sets aside what was known, and looks for what explains it."""
        trials = self._trial - int(pairs.trials[0])
        before = {**self._known(), "home": self.home.seen[:-trials].mean(0)}
        self.home.keep(trials)
        self._held = self._recent = self._nothing
        self._before = {}
        self._scores = np.empty((0, 2))
        self.events.append(Event(int(pairs.trials[0]), "unknown", "discard"))
        archived = self._archived(pairs.sensors[0])
        self.archive = [*self.archive, before][-self.ARCHIVED :]
        if self.on_change == "discard":
            self._begin_anew(pairs)
        elif archived and archived.explain(pairs):
            self._restore(archived._known())
            self._learn(pairs)
            self.events[-1] = replace(self.events[-1], kind="back", action="recall")
        else:
            self._before, self._since = before, pairs
            self._cameras, self._drifting = cameras, False
            self._think()

    def _follow(self, cameras: Cameras) -> None:
        """Something goes on slowly: what was known is mapped to where it has gone, trial after trial."""
        self._before, self._since = self._known(), self._recent
        self._cameras, self._drifting = cameras, True
        self.events.append(Event(self._trial - 1, "drift", "map"))
        self._think()

    def _think(self) -> None:
        """Finds what explains best all that was seen since the change, and acts upon what was known by it."""
        since = self._drifted() if self._drifting else self._since
        self._restore(self._before)
        changes = self._explanation(since)
        kind, action = changes[0].kind, "map"
        if self._off(changes) > self.DISCARD_PX and self.on_change == "recognise":
            kind, action = "replaced" if self._cameras.sum() == 1 else kind, "discard"
            self._begin_anew(since)
        else:
            for change in changes:
                for store in self._stores():
                    store.map(change, change.deviation_px)
            self._learn(since)
        if not self._drifting:
            self.events[-1] = replace(self.events[-1], kind=kind, action=action)
        if self._trial - self.events[-1].trial >= self.SURE:
            self._before = {}
            if self._drifting:
                self.home.keep(self.DRIFT)

    def _explanation(self, since: Pairs) -> list[CameraChange] | list[ArmChange]:
        cameras = [
            fit_camera(self.views, int(camera), since.sensors, since.registers)
            for camera in np.flatnonzero(self._cameras)
        ]
        if self._drifting:
            return cameras
        arm = [fit_arm(self.views, since.sensors, since.registers)]
        return arm if self._off(arm) < len(cameras) * self._off(cameras) else cameras

    def _off(self, changes: list[CameraChange] | list[ArmChange]) -> float:
        return max(float(change.deviation_px.max()) for change in changes)

    def _drifted(self) -> Pairs:
        """What was seen in the latest trials, where it would be seen now."""
        self._since = self._since.latest(self.DRIFT)
        rate = np.where(self._cameras.repeat(2), self.home.rate(self.DRIFT), 0.0)
        ages = self._trial - 1 - self._since.trials
        return replace(self._since, sensors=self._since.sensors + np.outer(ages, rate))

    def _strange(self, pairs: Pairs) -> NDArray[np.bool_]:
        """Which looks (n - 1, 2) away from home, in each camera, are off by far more than is usual."""
        if not len(self.views.registers) or len(pairs) == 1:
            return np.zeros((len(pairs) - 1, 2), bool)
        missed, scores = self._off_by(pairs)
        limit = np.full(2, np.inf)
        if len(self._scores) == self.USUAL:
            limit = np.maximum(SIGMAS, self.STRANGE * np.quantile(self._scores, 0.9, axis=0))
        strange = (scores > limit) & (missed > self.STRANGE_PX)
        if not strange.any():
            self._scores = np.concatenate([self._scores, [scores.max(0)]])[-self.USUAL :]
        return np.asarray(strange)

    def _jumped(self, pairs: Pairs) -> Cameras:
        """In which cameras home is seen elsewhere, and so is most of the rest, or home was so once before.

        Else that look was mistaken, and home is taken to be where it was.
        """
        home = pairs.sensors[0]
        jumped = self.home.jumped(home)
        near = lengths_px(self._doubted - home) < SIGMAS * self.home.noise_px()
        if not jumped.any() or (jumped & self._off_elsewhere(pairs)).any() or near.all(1).any():
            self._doubted = self._nothing.sensors
            return jumped
        self._doubted = home[None].copy()
        pairs.sensors[0] = self.home.seen[-self.home.FEW :].mean(0)
        return np.zeros(2, bool)

    def _off_elsewhere(self, pairs: Pairs) -> Cameras:
        """In which cameras (2,) most of what was seen away from home was not where it was expected."""
        missed, scores = self._off_by(pairs)
        off = (scores > SIGMAS) & (missed > self.STRANGE_PX)
        return np.asarray(2 * off.sum(0) > len(off) - (len(off) > 2))

    def _credible(self, pairs: Pairs) -> Pairs:
        """Without looks that were far off and were not confirmed: they were mistaken."""
        missed, _ = self._off_by(pairs)
        near = np.concatenate([[True], (missed < self.MISTAKEN_PX).all(1)])
        return Pairs(pairs.registers[near], pairs.sensors[near], pairs.trials[near])

    def _off_by(self, pairs: Pairs) -> tuple[Array, Array]:
        """How far off (n - 1, 2) looks away from home were, in pixels; and for what was known there."""
        views, variances = self.views.views(pairs.registers[1:])
        missed = lengths_px(pairs.sensors[1:] - views)
        return missed, missed / np.sqrt(variances / IMAGE_UNIT**2 + NOISE_PX**2)

    def _surely(self, strange: NDArray[np.bool_]) -> bool:
        """Whether so much (n, 2) was strange in one trial that it needs no other."""
        return len(strange) >= self.MANY and bool(strange.any(1).mean() > 0.5)

    def explain(self, pairs: Pairs) -> bool:
        """Whether most of it was to be expected."""
        missed = lengths_px(pairs.sensors - self.views.views(pairs.registers)[0])
        return bool(np.median(missed) < SIGMAS * NOISE_PX)

    def _archived(self, gripper: Array) -> Recognition | None:
        """What was once known of a world in which the gripper at home was seen there (4,)."""
        for arrays in reversed(self.archive) if self.on_change == "recognise" else ():
            if (lengths_px(gripper - arrays["home"]) < SIGMAS * NOISE_PX).all():
                archived = Recognition(copy.deepcopy(self.knowledge), self._nothing.registers.shape[1])
                archived._restore(arrays)
                return archived
        return None

    def _begin_anew(self, pairs: Pairs) -> None:
        self._restore(self._empty)
        self._learn(pairs)

    def _learn(self, pairs: Pairs) -> None:
        for store in self._stores():
            for registers, sensors in zip(pairs.registers, pairs.sensors, strict=True):
                store.learn(sensors, registers)

    def _stores(self) -> tuple[Knowledge, ...]:
        if self.views is self.knowledge or self.on_change == "keep":
            return (self.knowledge,)
        return self.knowledge, self.views

    def _known(self) -> dict[str, NDArray[Any]]:
        known = self.knowledge.arrays()
        return known if len(self._stores()) == 1 else known | prefixed("views", self.views.arrays())

    def _restore(self, known: Arrays) -> None:
        self.knowledge.restore(known)
        if len(self._stores()) > 1:
            self.views.restore(under("views", known))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All that it knows, as named arrays."""
        if self.on_change == "keep":
            return self._known()
        archive = [prefixed(f"archive/{i}", known) for i, known in enumerate(self.archive)]
        pairs = {"held": self._held, "recent": self._recent, "since": self._since}
        return {
            **self._known(),
            **prefixed("before", self._before),
            **{name: array for known in archive for name, array in known.items()},
            **{
                name: array
                for key, each in pairs.items()
                for name, array in prefixed(key, each.arrays()).items()
            },
            "home": self.home.seen,
            "steps": self.home.steps,
            "doubted": self._doubted,
            "scores": self._scores,
            "cameras": self._cameras,
            "clock": np.array([self._trial, self._drifting]),
            "events": np.array([astuple(event) for event in self.events], str).reshape(-1, 3),
        }

    def restore(self, arrays: Arrays) -> None:
        """Takes over what `arrays` returned."""
        self._restore(arrays)
        if self.on_change == "keep":
            return
        self._before = under("before", arrays)
        self.archive = []
        while known := under(f"archive/{len(self.archive)}", arrays):
            self.archive.append(known)
        self._held, self._recent, self._since = (
            Pairs.of(under(key, arrays)) for key in ("held", "recent", "since")
        )
        self.home = HomeView(
            checked_array(arrays, "home", (None, 4)), checked_array(arrays, "steps", (None, 4))
        )
        self._doubted = checked_array(arrays, "doubted", (None, 4))
        self._scores = checked_array(arrays, "scores", (None, 2))
        self._cameras = checked_array(arrays, "cameras", (2,)) > 0
        clock = checked_array(arrays, "clock", (2,))
        self._trial, self._drifting = int(clock[0]), bool(clock[1])
        self.events = [Event(int(trial), kind, action) for trial, kind, action in arrays["events"]]
