"""How a robot recognises that its world has changed, and what it does about its knowledge (section 5).

The paper asks when to discard stored knowledge, and when "to modify all stored data at once in a systematic
way". Here the robot tells by motions that it makes anyway. What it knew before a change is set aside and stays
as it was; what it made of it is thought over after every trial, until enough was seen.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.agent import Array
from agents.jacobian import NOISE_PX
from agents.knowledge.arm_change import ArmChange, fit_arm
from agents.knowledge.camera_change import CameraChange, fit_camera
from agents.knowledge.gaussian_process import GaussianProcess
from agents.knowledge.home_view import SIGMAS, Cameras, HomeView, lengths_px
from calfree_gym.world import IMAGE_UNIT

ON_CHANGE = ("recognise", "map", "discard", "keep")
"""What is done where the world has changed: what seems best, or always the same."""

Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Pairs:
    """What was seen, and where: registers (n, m), sensor vectors (n, 4), and the trial (n,) of each."""

    registers: Array
    sensors: Array
    trials: NDArray[np.int64]

    def __add__(self, other: Pairs) -> Pairs:
        return Pairs(
            np.concatenate([self.registers, other.registers]),
            np.concatenate([self.sensors, other.sensors]),
            np.concatenate([self.trials, other.trials]),
        )

    def latest(self, trials: int) -> Pairs:
        """Those of the latest so many trials."""
        late = self.trials > self.trials.max(initial=0) - trials
        return Pairs(self.registers[late], self.sensors[late], self.trials[late])


@dataclass(frozen=True)
class Event:
    """A change of the world, as it was recognised.

    Attributes:
        trial: The first trial, counted from 0, that showed it.
        kind: "drift", "re-aimed", "rolled", "zoomed", "moved", "replaced", "arm changed", or "back".
        action: What was done with what was known: "map", "discard", or "recall" from the archive.
    """

    trial: int
    kind: str
    action: str


class Recognition:
    STRANGE_PX = 6.0
    DISCARD_PX = 25.0
    SURE = 30
    DRIFT = 12
    ARCHIVED = 8
    USUAL = 20

    def __init__(self, knowledge: GaussianProcess, on_change: str = "recognise") -> None:
        self.knowledge = knowledge
        self.on_change = on_change
        self.events: list[Event] = []
        self.archive: list[Arrays] = []
        self.home = HomeView()
        self._empty = {name: value.copy() for name, value in knowledge.arrays().items()}
        self._nothing = Pairs(self._empty["registers"], self._empty["sensors"], np.empty(0, np.int64))
        self._trial = 0
        self._held = self._recent = self._since = self._nothing
        self._before: Arrays | None = None
        self._cameras = np.zeros(2, bool)
        self._drifting = False
        self._scores = np.empty((0, 2))

    def as_ever(self, gripper: Array) -> bool:
        """Whether the gripper at home is seen where it always was."""
        return self.on_change == "keep" or not self.home.jumped(gripper).any()

    def recollected(self, gripper: Array) -> GaussianProcess | None:
        """Archived knowledge of a world in which the gripper at home was seen there, if there is any."""
        if self.on_change != "recognise":
            return None
        for arrays in reversed(self.archive):
            if (lengths_px(gripper - arrays["home"]) < SIGMAS * NOISE_PX).all():
                knowledge = GaussianProcess(self.knowledge.registers.shape[1], self.knowledge.points)
                knowledge.restore(arrays)
                return knowledge
        return None

    def learn(self, registers: Array, sensors: Array) -> None:
        """Takes in a trial: what was seen (n, 4), and at which registers (n, m); at home first."""
        pairs = Pairs(registers, sensors, np.full(len(registers), self._trial))
        self._trial += 1
        if self.on_change == "keep":
            self._learn(pairs)
            return
        jumped = self.home.jumped(sensors[0])
        if jumped.any():
            before = len(self.home.seen)
            self.home.add(sensors[0])
            self._change(pairs, jumped, 1)
            return
        self.home.add(sensors[0])
        strange = self._strange(pairs)
        if strange.any():
            twice = len(self._held.trials) > 0
            pairs, self._held = self._held + pairs, pairs
            if twice:
                self._change(pairs, strange, 2)
            return
        pairs, self._held = self._held + pairs, self._nothing
        self._recent = (self._recent + pairs).latest(self.DRIFT)
        if self._before is None:
            self._learn(pairs)
            latest, cameras = self.home.displaced()
            if latest:
                self._drift(cameras)
        else:
            self._since = self._since + pairs
            self._think()

    def _strange(self, pairs: Pairs) -> Cameras:
        """Which cameras (2,) show what was not expected, by more than it usually is."""
        if not len(self.knowledge.registers):
            return np.zeros(2, bool)
        views, variances = map(np.array, zip(*map(self.knowledge.view, pairs.registers), strict=True))
        missed = lengths_px(pairs.sensors - views)[1:]
        scores = missed / np.sqrt(variances[1:] / IMAGE_UNIT**2 + NOISE_PX**2)
        usual = np.concatenate([self._scores, np.full((1, 2), 3 * SIGMAS)]) if len(self._scores)<10 else self._scores
        limit = np.maximum(SIGMAS, 3 * np.quantile(usual, 0.9, axis=0)) if len(self._scores)>=10 else np.full(2, 30.0)
        self._scores = np.concatenate([self._scores, [scores.max(0, initial=0.0)]])[-self.USUAL :]
        return np.asarray(((scores > limit) & (missed > self.STRANGE_PX)).any(0))

    def _change(self, pairs: Pairs, cameras: Cameras, latest: int) -> None:
        """Something has jumped: sets aside what was known, and looks for what explains it."""
        self._set_aside(latest)
        self._held = self._recent = self._nothing
        trial = int(pairs.trials[0])
        if self.on_change == "discard":
            self._begin_anew(pairs)
            self._before=None
            self.events.append(Event(trial, "unknown", "discard"))
            return
        back = self.recollected(pairs.sensors[0])
        if back is not None and self._explains(back, pairs):
            self.knowledge.restore(back.arrays())
            self._learn(pairs)
            self._before = None
            self.events.append(Event(trial, "back", "recall"))
            return
        self.archive = [*self.archive, self._before][-self.ARCHIVED :]
        self._since, self._cameras, self._drifting = pairs, cameras, False
        self.events.append(Event(trial, "unknown", "map"))
        self._think()

    def _drift(self, cameras: Cameras) -> None:
        """Something goes on slowly: follows it from here on."""
        self._before = self.knowledge.arrays()
        self._since, self._cameras, self._drifting = self._recent, cameras, True
        if not self.events or self.events[-1].kind!="drift" or True: self.events.append(Event(self._trial, "drift", "map"))
        self._think()

    def _set_aside(self, latest: int) -> None:
        seen = self.home.seen
        self._before = {**self.knowledge.arrays(), "home": seen[:-latest].mean(0)}
        self.home.keep(latest)

    def _think(self) -> None:
        """Finds what explains best all that was seen since the change, and takes the knowledge over by it."""
        assert self._before is not None
        since = self._since
        if self._drifting:
            since = self._since = since.latest(self.DRIFT)
            rate, _ = self.home.drift(self.DRIFT)
            rate = np.where(np.repeat(self._cameras, 2), rate, 0.0)
            since = replace(since, sensors=since.sensors + np.outer(self._trial - 1 - since.trials, rate))
        self.knowledge.restore(self._before)
        cameras = [fit_camera(self.knowledge, int(i), since.sensors, since.registers) for i in np.flatnonzero(self._cameras)]
        changes: list[CameraChange|ArmChange] = list(cameras)
        if not self._drifting:
            arm = fit_arm(self.knowledge, since.sensors, since.registers)
            if arm is not None and (arm.deviation_px.max() < (max(c.deviation_px.max() for c in cameras) if len(cameras)==1 else 2*max(c.deviation_px.max() for c in cameras))):
                changes = [arm]
        off = max(change.deviation_px.max() for change in changes)
        kind, action = _kind(changes), "map"
        if off > self.DISCARD_PX and self.on_change == "recognise":
            self._begin_anew(since)
            kind, action = ("replaced" if kind != "arm changed" else kind), "discard"
        else:
            for change in changes:
                self.knowledge.map(change, change.deviation_px)
            self._learn(since)
        if not self._drifting:
            self.events[-1] = replace(self.events[-1], kind=kind, action=action)
        if self._trial - self.events[-1].trial >= self.SURE:
            self._before = None
            if self._drifting:
                self.home.keep(self.DRIFT)
                sure = self.home.drift(self.DRIFT)[1]
                if sure.any(): self._drift(sure)

    def _explains(self, knowledge: GaussianProcess, pairs: Pairs) -> bool:
        views = np.array([knowledge.view(each)[0] for each in pairs.registers])
        return bool(np.median(lengths_px(pairs.sensors - views)) < 3 * NOISE_PX)

    def _begin_anew(self, pairs: Pairs) -> None:
        self.knowledge.restore(self._empty)
        self._learn(pairs)

    def _learn(self, pairs: Pairs) -> None:
        for registers, sensors in zip(pairs.registers, pairs.sensors, strict=True):
            self.knowledge.learn(sensors, registers)


def _kind(changes) -> str:
    change = changes[0]
    if isinstance(change, ArmChange):
        return "arm changed"
    if change.deviation_px.max() > 4: return "moved"
    if abs(change.turn) > np.radians(2): return "rolled"
    if abs(np.log(change.scale)) > 0.04: return "zoomed"
    return "re-aimed"
