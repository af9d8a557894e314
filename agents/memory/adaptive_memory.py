"""Keep, map, discard or recall: what is done with knowledge when the world has changed (paper, section 5).

The paper asks when to discard what is stored, and when "to modify all stored data at once in a systematic
way". The answer comes from motions that are made anyway. A trial that begins after a jump of home goes by
what was known, as if cameras had only turned. What was known before a change is set aside as it was; while
more is seen, the explanation of the change is fitted again, and what was known is mapped by it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.checks import checked_array
from ..base.observation import Array, Observation, camera_lengths_px
from ..base.prior_knowledge import PriorKnowledge
from ..base.storage import prefixed, under
from ..servo.image_model.smooth_points import SmoothPoints
from ..servo.slopes import Slopes
from .detector import NO_CAMERA, ChangeDetector, ChangeVerdict, Finding
from .explanation import as_seen_now, explain_drift, explain_jump, since_mid_trial
from .pairs import Cameras, HomeView, Pairs
from .remembered import ArmChange, Remembered

Arrays = Mapping[str, NDArray[Any]]


class Archive:
    """Keeps knowledge that was set aside, each with where the gripper was seen at home in its time.

    Attributes:
        worlds: Knowledge as named arrays, the latest last; "home" (4,) is the view at home, in image units.
    """

    KEPT = 8
    """This many worlds are kept. Choice: it bounds memory; each holds as many looks
    as `Remembered` keeps."""

    def __init__(self) -> None:
        self.worlds: list[Arrays] = []

    def add(self, known: Arrays, home: Array) -> None:
        """Sets aside what was known while the gripper at home was seen there (4,); drops the oldest."""
        self.worlds = [*self.worlds, {**known, "home": home}][-self.KEPT :]

    def find(self, gripper: Array, noise_px: float) -> Arrays | None:
        """The latest world in which the gripper at home was seen there (4,), as well as noise can tell."""
        near_px = HomeView.SIGMAS * noise_px
        for known in reversed(self.worlds):
            if (camera_lengths_px(gripper - known["home"]) < near_px).all():
                return known
        return None

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All worlds, as named arrays."""
        return {
            name: array
            for i, known in enumerate(self.worlds)
            for name, array in prefixed(f"archive/{i}", known).items()
        }

    def restore(self, arrays: Arrays) -> None:
        """Takes over what `arrays` returned.

        Raises:
            ValueError: Of a world it is not told where the gripper was seen at home.
        """
        self.worlds = []
        while known := under(f"archive/{len(self.worlds)}", arrays):
            checked_array(known, "home", (4,), allow_nan=True)
            self.worlds.append(known)


ON_CHANGE = ("recognise", "map", "discard", "keep")
"""What is done after a jump: what is best by what was seen, or always the same. A drift is followed, unless
all is to be kept."""


@dataclass(frozen=True)
class WorldEvent:
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


@dataclass(frozen=True)
class Change:
    """A jump that is still being explained, or a drift that is being followed.

    Attributes:
        before: What was known before it.
        cameras: The cameras (2,) that show it.
        after_change: All pairs seen since a jump.
        drifts: Whether it is a drift.
    """

    before: Remembered
    cameras: Cameras
    after_change: Pairs
    drifts: bool = False


class AdaptiveMemory:
    """Remembers what was seen; keeps, maps, discards or recalls it where the world has changed.

    Attributes:
        known: What is remembered of the present world.
        on_change: One of `ON_CHANGE`.
        detector: Says whether anything has changed.
        archive: What was known in earlier worlds.
        events: The changes that were recognised.
        change: The jump that is being explained or the drift that is being followed; None in a steady world.

    Args:
        known: What remembers; empty.
        on_change: One of `ON_CHANGE`.

    Raises:
        ValueError: `on_change` is none of these.
    """

    EXPLAINED_TRIALS = 30
    """This many trials after a change its explanation is final. Tuned (wild worlds 3000-)."""
    REFIT_TRIALS = 5
    """Up to this trial, that of the change included, the explanation is fitted again in each, later in every
    fifth. A choice between time and accuracy."""
    SELDOM = 1000.0
    """Beforehand the world changes once in so many trials. Choice."""
    DRIFT_TRIALS = 12
    """Trials by which a drift is followed. Tuned (wild worlds 3000-)."""

    def __init__(self, known: Remembered, on_change: str = "recognise") -> None:
        if on_change not in ON_CHANGE:
            raise ValueError(f"on_change is {on_change!r}; allowed: {', '.join(ON_CHANGE)}")
        self.on_change = on_change
        self.detector = ChangeDetector(known.motors)
        self.archive = Archive()
        self.events: list[WorldEvent] = []
        self.change: Change | None = None
        self.known = known
        self._none = Pairs.none(known.motors)
        self._recent = self._none
        self._announced = NO_CAMERA
        self._trial = 0

    @property
    def prior_knowledge(self) -> frozenset[PriorKnowledge]:
        """What it takes for granted to notice and to explain changes, see `Agent`.

        Its homographies are those of cameras with square pixels, and yet no camera model is among it: they
        save as many motions where images are sheared (`python -m experiments benchmark priors` tells how).
        """
        keeps = self.on_change == "keep"
        return frozenset() if keeps else frozenset({PriorKnowledge.IMAGE_SCALE, PriorKnowledge.NOISE})

    def known_for(self, home: Observation) -> Remembered | None:
        """What to go by in a world as it is seen at home.

        None where the world has changed and the archive knows none like it. A camera that does not show the
        gripper tells of no change.
        """
        changed = self._announced | self._jumped(home)
        if self.on_change == "keep":
            return self.known
        return self._recalled(home.gripper) if changed.any() else self._back(home.gripper) or self.known

    def points_for(
        self, home: Observation, noise_px: float, start: Slopes | None = None
    ) -> SmoothPoints | None:
        """What is known of the points, of an object and in a world as they are seen at home.

        Where the world has changed, that is a guess by how home has moved. None where nothing is known; see
        `Remembered.points`.
        """
        known = self.known_for(home) or self._guess(home)
        if known is None or not len(known.gripper):
            return None
        return known.points(home.object if home.shows_object else None, noise_px, start)

    def _guess(self, home: Observation) -> Remembered | None:
        """What was known before a change, as home has moved in images.

        None where it was announced, or where the trial before met one, too, that was no turn: this is then
        taken for no turn either.
        """
        if self.on_change == "discard" or self._announced.any() or not len(self.known.gripper):
            return None
        just_met = self.change and not self.change.drifts and self.events[-1].trial == self._trial - 1
        if just_met and self.events[-1].kind != "re-aimed":
            return None
        return self.known.as_home_moved(home.gripper, self._jumped(home))

    def _jumped(self, home: Observation) -> Cameras:
        """Which cameras show the gripper elsewhere at home."""
        return self.detector.home.jumped(home.gripper) & home.visible[:2]

    def announce_change(self, cameras: Cameras) -> None:
        """The user says that these cameras (2,) have changed before the next trial; both mean the arm."""
        self._announced = np.asarray(cameras, bool)

    def learn(self, looks: Sequence[Observation], noise_px: float, jumped: int = 0) -> None:
        """Takes in a trial.

        One in which home was not seen teaches nothing, unless all is kept whatever changes.

        Args:
            looks: What was observed, at home first.
            noise_px: Standard deviation of an image coordinate.
            jumped: The first look after a change that the servo met in mid-trial; 0: it met none.
        """
        pairs = Pairs.of_trial(looks, noise_px, self._trial)
        self._trial += 1
        if not len(pairs):
            return
        if self.on_change == "keep":
            self.known.learn(pairs)
            return
        if pairs.registers[0].any():
            return
        announced = self._announced if len(self.known.gripper) else NO_CAMERA
        self._announced = NO_CAMERA
        first = sum(look.shows_gripper for look in looks[:jumped])
        archived = self._back(pairs.sensors[0])
        finding = self.detector.examine(pairs, archived or self.known, announced, first)
        in_mid_trial = first > 0 and finding.first == first
        if archived and in_mid_trial and self._has_lasted(finding):
            self._go_on(pairs)
            return
        if archived:
            self.events.append(WorldEvent(int(pairs.trials[0]), "back", "recall"))
            self.known, self.change, self._recent = archived, None, self._none
        if finding.verdict is ChangeVerdict.CHANGED and (
            announced.any() or in_mid_trial or not self._was_only_wrong(finding)
        ):
            self._meet_jump(finding)
        elif finding.verdict is not ChangeVerdict.CHANGED and len(finding.pairs):
            self._go_on(finding.pairs)

    def _was_only_wrong(self, found: Finding) -> bool:
        """Whether nothing has changed, but points are less smooth than was thought: learns that."""
        relearned = self.known.copy()
        unchanged = relearned.learn_anew(found.pairs) + np.log(self.SELDOM)
        if unchanged <= explain_jump(self.known, found.pairs, found.cameras, True).odds(found.pairs):
            return False
        self.known = relearned
        self._note(found.pairs)
        return True

    def _meet_jump(self, found: Finding) -> None:
        """Sets aside what was known, and recalls, discards or maps it.

        Where the change came in mid-trial, home was seen before it, and the object from there.
        """
        before, home, first = self.known.copy(), found.pairs.sensors[0], int(found.pairs.trials[0])
        since = since_mid_trial(before, found.pairs, found.first, found.cameras)
        if in_mid_trial := since is not None:
            before.learn(found.pairs.only(np.arange(len(found.pairs)) < found.first))
            found = replace(found, pairs=since, home_before=self.detector.home.before(first + 1))
        self.detector.begin_anew(first + in_mid_trial)
        archived = None if in_mid_trial else self._recalled(home)
        self.archive.add(before.arrays(), found.home_before)
        self.change, self._recent = None, self._none
        if self.on_change == "discard":
            self.events.append(WorldEvent(first, "unknown", "discard"))
            self.known = before.nothing()
            self.known.learn(found.pairs)
        elif archived and archived.agrees_with(found.pairs, self.known):
            self.events.append(WorldEvent(first, "back", "recall"))
            self.known = archived
            self.known.learn(found.pairs)
        else:
            self.events.append(WorldEvent(first, "unknown", "map"))
            self._refit_explanation(Change(before, found.cameras, found.pairs))

    def _go_on(self, pairs: Pairs) -> None:
        """Nothing has jumped: learns, explains the last jump better, follows a drift."""
        self._note(pairs)
        if self.change:
            age = self._trial - self.events[-1].trial
            if self.change.drifts or age <= self.REFIT_TRIALS or age % self.REFIT_TRIALS == 0:
                self._refit_explanation(self.change)
            else:
                self.known.learn(pairs)
            return
        self.known.learn(pairs)
        drifting = self.detector.home.drifting()
        if drifting.any():
            self.events.append(WorldEvent(self._trial - 1, "drift", "map"))
            self._refit_explanation(Change(self.known.copy(), drifting, self._none, drifts=True))

    def _note(self, pairs: Pairs) -> None:
        """Keeps what was seen, for as long as a change is still being explained by it."""
        self._recent = (self._recent + pairs).latest(self.DRIFT_TRIALS)
        if self.change and not self.change.drifts:
            self.change = replace(self.change, after_change=self.change.after_change + pairs)

    def _refit_explanation(self, change: Change) -> None:
        """Explains the change by all that was seen since, and maps or discards what was known by it."""
        self.change = change
        if change.drifts:
            rate = self.detector.home.drift_rate(self.DRIFT_TRIALS)
            seen = as_seen_now(self._recent, change.cameras, rate, self._trial - 1)
            explanation = explain_drift(change.before, seen, change.cameras)
        else:
            seen, may_discard = change.after_change, self.on_change == "recognise"
            explanation = explain_jump(change.before, seen, change.cameras, may_discard)
            action = "map" if explanation.changes else "discard"
            self.events[-1] = replace(self.events[-1], kind=explanation.kind, action=action)
        self.known = explanation.known
        self.known.learn(seen)
        if self._trial - self.events[-1].trial >= self.EXPLAINED_TRIALS:
            self.change = None
            if change.drifts:
                self.detector.home.keep_since(self._trial - self.DRIFT_TRIALS)

    def _back(self, gripper: Array) -> Remembered | None:
        """What is archived of the world before a change in mid-trial, where that did not last until now.

        Then home is seen for the first time since, and the gripper (4,) where it was before; but after a
        change of the arm that may be so, too: see `_has_lasted`.
        """
        asked = self.events and self.events[-1].kind != ArmChange.kind
        return self._recalled(gripper) if asked and not len(self.detector.home.sensors) else None

    @staticmethod
    def _has_lasted(found: Finding) -> bool:
        """Whether what looks like another change in mid-trial is the one before, which has lasted.

        Home is seen as before both, and alone was. Both cameras will hardly have changed again: the arm has,
        and home does not show that.
        """
        return found.first == 1 and bool(found.cameras.all())

    def _recalled(self, gripper: Array) -> Remembered | None:
        """What is archived of a world in which the gripper at home was seen there (4,)."""
        noise_px = self.detector.home.noise_px
        archived = self.archive.find(gripper, noise_px) if self.on_change == "recognise" else None
        return self.known.copy_of(archived) if archived else None

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All that it knows, as named arrays."""
        if self.on_change == "keep":
            return self.known.arrays()
        change = self.change
        after_change = change.after_change if change else self._none
        return {
            **self.known.arrays(),
            **self.archive.arrays(),
            **self.detector.arrays(),
            **prefixed("before", change.before.arrays() if change else {}),
            **prefixed("after_change", after_change.arrays()),
            **prefixed("recent", self._recent.arrays()),
            "cameras": change.cameras if change else NO_CAMERA,
            "announced": self._announced,
            "clock": np.array([self._trial, bool(change and change.drifts)]),
            "events": np.array([astuple(event) for event in self.events], str).reshape(-1, 3),
        }

    def restore(self, arrays: Arrays) -> None:
        """Takes over what `arrays` returned.

        Raises:
            KeyError: An array of a change is missing.
            ValueError: Another array is missing, or one has another shape.
        """
        if self.on_change == "keep":
            self.known.restore(arrays)
            return
        self.known.restore(arrays)
        self.archive.restore(arrays)
        self.detector.restore(arrays)
        self._recent, after_change = (Pairs.of(under(key, arrays)) for key in ("recent", "after_change"))
        cameras = checked_array(arrays, "cameras", (2,)) > 0
        self._announced = checked_array({"announced": NO_CAMERA, **arrays}, "announced", (2,)) > 0
        trial, drifting = checked_array(arrays, "clock", (2,))
        self._trial = int(trial)
        before = under("before", arrays)
        self.change = (
            Change(self.known.copy_of(before), cameras, after_change, bool(drifting)) if before else None
        )
        self.events = [WorldEvent(int(trial), kind, action) for trial, kind, action in arrays["events"]]
