"""Schedules: when perturbations are applied and undone, as written in YAML, and how worlds then change."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from functools import partial
from typing import Any, ClassVar

import numpy as np

from calfree_gym.errors import check_choice, check_whole, near_misses
from calfree_gym.perturbations.base import Perturbation
from calfree_gym.perturbations.types import parse_perturbation
from calfree_gym.robot.arms.robot import ROOM, Mounts, Robot
from calfree_gym.robot.workspace import Workspaces, cameras_at_home, first_in_view
from calfree_gym.streams import stream
from calfree_gym.world import World

_WHOLE = ("light_direction", "occluder", "dock")
"""Fields that have one value for all."""


@dataclass(frozen=True)
class Undo:
    """Restores what an earlier event changed.

    It is listed among the applied perturbations but is not one: a perturbation sees the present world alone,
    and that world does not know the old camera. In a world that was drawn or set since, it changes nothing.

    Attributes:
        event: The earlier one's place in the schedule, from 0.
    """

    type: ClassVar[str] = "undo"
    event: int

    def to_dict(self) -> dict[str, Any]:
        """As `Perturbation.to_dict`."""
        return {"type": self.type, "event": self.event}


def undone(world: World, before: World, after: World) -> World:
    """The world with all that differs between `before` and `after` restored; other quantities stay.

    The comparison is per camera, joint and motor: along the first axis of each field, but for lamp,
    occluder and dock, which come back whole.
    """
    restored = {}
    for field in fields(World):
        old, new = getattr(before, field.name), getattr(after, field.name)
        differs = old != new
        if field.name in _WHOLE:
            differs = differs.any(keepdims=True)
        elif differs.ndim > 1:
            differs = differs.any(axis=-1, keepdims=True)
        if differs.any():
            restored[field.name] = np.where(differs, old, getattr(world, field.name))
    return world.replace(**restored)


CLOCKS = ("motion", "trial")
_CLOCK_OF = {"motion": "motion", "trial": "trial", "step": "motion", "episode": "trial"}
"""What schedules may call them."""
WHENS = ("at", "every", "drift")
LATEST = 2**62
"""No event is due later (a guard)."""


@dataclass(frozen=True)
class Event:
    """One entry of a schedule.

    Attributes:
        clock: "motion": counted over the environment's life, in mid-trial too; or "trial".
        at: How many motions or trials are over when it is applied.
        perturbation: What is applied, or which event is undone.
        every: Whether it is applied again each time that as many more are over.
        drift: Whether each application is one step of a drift.
    """

    clock: str
    at: int
    perturbation: Perturbation | Undo
    every: bool = False
    drift: bool = False

    def __post_init__(self) -> None:
        check_choice("clock", self.clock, CLOCKS)
        check_whole("at", self.at, int(self.every), LATEST)
        if isinstance(self.perturbation, Undo):
            if self.every or self.drift:
                raise ValueError("an Undo is applied once; every and drift must be False")
            return
        if not isinstance(self.perturbation, Perturbation):
            raise ValueError(f"perturbation is {self.perturbation!r}; it must be a Perturbation or an Undo")
        if self.drift and not (self.every and self.at == 1 and self.perturbation.drifts):
            raise ValueError(
                f"a drift of {self.perturbation.type!r} is {self!r}; it must have small steps, one at every 1"
            )

    def is_due(self, counts: Any) -> Any:
        """Whether it is applied when this many motions or trials are over: one number, or an array."""
        if self.every:
            return (counts > 0) & (counts % self.at == 0)
        return counts == self.at

    def to_dict(self) -> dict[str, Any]:
        """As in YAML."""
        when: dict[str, Any] = {"every" if self.every else "at": {self.clock: self.at}}
        if self.drift:
            when = {"drift": {"per": self.clock}}
        if isinstance(self.perturbation, Undo):
            return when | {"undo": self.perturbation.event}
        return when | {"do": self.perturbation.to_dict()}


Schedule = tuple[Event, ...]


def parse_schedule(entries: Iterable[Mapping[str, Any]] | None, where: str = "perturbations") -> Schedule:
    """Reads a list such as `[{"at": {"motion": 2000}, "do": {"type": "camera_roll"}}]`.

    `do` names a type of `perturbations.TYPES` and any of its settings. One of these keys says when:

    - `at: {motion: n}` or `at: {trial: n}`: applied once, after n motions or trials since the environment
      was seeded, before the next one starts;
    - `every: {motion: n}` or `every: {trial: n}`: applied each time that n more are over. Omitted settings
      are drawn again each time;
    - `drift: {per: motion}` or `drift: {per: trial}`: a slow change, one step before each motion or trial but
      the first. Its direction is drawn once. It turns back where the cameras would no longer see the work
      space (with `keep_in_view`) or where a quantity is at the end of its range. A given setting is the size
      of one step; an omitted one is a hundredth of what the perturbation draws.

    `at: {every: ...}` and `at: {drift: ...}` mean the same, and so do `step` for motion and `episode` for
    trial.

    `undo: k` may replace `do` beside `at`: what the entry at place k (from 0) changed becomes again what it
    was before, for example the old camera comes back. What later entries changed in the same quantity of the
    same camera, joint or motor goes, too; all other changes stay. Entry k must be one that is applied once,
    earlier and on the same clock.

    Args:
        entries: The list; None is an empty one.
        where: What errors call it.

    Raises:
        ValueError: An entry is malformed; names it by its place, what was found and what is allowed.
    """
    if entries is None:
        return ()
    if isinstance(entries, Mapping | str) or not isinstance(entries, Iterable):
        raise ValueError(f"{where} is {entries!r}; it must be a list of {{at: ..., do: ...}}")
    events: list[Event] = []
    for i, entry in enumerate(entries):
        event = entry if isinstance(entry, Event) else _event(entry, f"{where}.{i}")
        if isinstance(event.perturbation, Undo):
            _check_undo(event, event.perturbation.event, f"{where}.{i}", events)
        events.append(event)
    return tuple(events)


def in_motions_and_trials(entry: Mapping[str, Any]) -> dict[str, Any]:
    """The same entry of a schedule, which counts steps and episodes by these names."""

    def renamed(when: Any) -> Any:
        if isinstance(when, Mapping):
            return {_CLOCK_OF.get(key, key): renamed(value) for key, value in when.items()}
        return _CLOCK_OF.get(when, when) if isinstance(when, str) else when

    return {key: value if key == "do" else renamed(value) for key, value in entry.items()}


def _event(entry: Mapping[str, Any], where: str) -> Event:
    if isinstance(entry, Mapping) and entry.keys() == {"at", "undo"}:
        return Event(*_count(entry["at"], f"{where}.at"), Undo(entry["undo"]))
    if not isinstance(entry, Mapping) or len(entry) != 2 or "do" not in entry:
        raise ValueError(
            f"{where} is {entry!r}; it must be a mapping of do and one of {', '.join(WHENS)}, "
            "or of at and undo"
        )
    ((how, when),) = ((key, value) for key, value in entry.items() if key != "do")
    if how not in WHENS:
        raise ValueError(f"{where} has {how!r}{near_misses(how, WHENS)}; allowed: do and {', '.join(WHENS)}")
    place = f"{where}.{how}"
    if how == "at" and isinstance(when, Mapping) and len(when) == 1 and set(when) <= set(WHENS):
        ((how, when),) = when.items()
        place = f"{place}.{how}"
    do = entry["do"]
    perturbation = do if isinstance(do, Perturbation) else parse_perturbation(do, f"{where}.do")
    if how == "drift":
        if not perturbation.drifts:
            raise ValueError(
                f"{place} has {perturbation.type!r}, which has no small steps; allowed with it: at, every"
            )
        return Event(_drifting(when, place), 1, perturbation, every=True, drift=True)
    clock, count = _count(when, place)
    if how == "every" and count == 0:
        raise ValueError(f"{place}.{clock} is 0; it must be at least 1")
    return Event(clock, count, perturbation, every=how == "every")


def _check_undo(undo: Event, place: Any, where: str, earlier: list[Event]) -> None:
    allowed = [
        i
        for i, event in enumerate(earlier)
        if event.clock == undo.clock
        and event.at < undo.at
        and not (event.every or isinstance(event.perturbation, Undo))
    ]
    if isinstance(place, bool) or place not in allowed:
        raise ValueError(
            f"{where}.undo is {place!r}; it must be the place of an entry before it that is applied once, "
            f"at an earlier {undo.clock}: {', '.join(map(str, allowed)) or 'there is none'}"
        )


def _count(when: Any, where: str) -> tuple[str, int]:
    if not isinstance(when, Mapping) or len(when) != 1:
        raise ValueError(f"{where} is {when!r}; it must be one of {{motion: n}}, {{trial: n}}")
    ((clock, count),) = when.items()
    if clock not in _CLOCK_OF:
        raise ValueError(
            f"{where} has {clock!r}{near_misses(clock, _CLOCK_OF)}; allowed: {', '.join(_CLOCK_OF)}"
        )
    if isinstance(count, bool) or not isinstance(count, int | np.integer) or not 0 <= count <= LATEST:
        raise ValueError(f"{where}.{clock} is {count!r}; it must be a whole number, 0 or more")
    return _CLOCK_OF[clock], int(count)


def _drifting(when: Any, where: str) -> str:
    if not isinstance(when, Mapping) or set(when) != {"per"}:
        raise ValueError(f"{where} is {when!r}; it must be {{per: motion}} or {{per: trial}}")
    clock = when["per"]
    if clock not in tuple(_CLOCK_OF):
        raise ValueError(
            f"{where}.per is {clock!r}{near_misses(clock, _CLOCK_OF)}; allowed: {', '.join(_CLOCK_OF)}"
        )
    return _CLOCK_OF[clock]


Applied = tuple[int, Perturbation | Undo]
"""A row, and the perturbation that was applied to it, with all that it drew."""
Kept = tuple[dict[int, tuple[Perturbation, bool]], dict[int, tuple[World, World]]]
"""Of a row: the drifts that have begun, and what events may be undone."""


def _as_it_is(world: World) -> World:
    return world


def _not_asked(row: int) -> None:
    return None


class PerturbationScheduler:
    """Changes the worlds of N rows when events of a schedule are due.

    What an event draws depends on the row's seed, the event's place in the schedule and, where it comes again
    and again, the count of motions or trials at which it is applied. With `keep_in_view` it also depends on
    the world at that moment, because draws out of view are repeated.

    Attributes:
        events: For each clock, its events with their places in the schedule.

    Args:
        rows: N.
        schedule: Entries as for `schedule.parse_schedule`.
        robot: Their robot. Without `keep_in_view` and occluders, the names of its parts and `slides` will do.
        mounts: Where the cameras are fixed.
        keep_in_view: Whether worlds that the cameras do not see are drawn again, and drifts turn back.
        as_seen: A world as it is judged whether they do.
        can_begin: Whether a trial can begin in a world of a row, if that is asked, too.
        judge: One row that judges whether a world is in view, where that is not an arm's work space.
    """

    state_names: ClassVar[tuple[str, ...]] = ("_drifts", "_undoable")

    def __init__(
        self,
        rows: int,
        schedule: Any,
        robot: Robot,
        mounts: Mounts = (ROOM, ROOM),
        keep_in_view: bool = False,
        as_seen: Callable[[World], World] = _as_it_is,
        can_begin: Callable[[int], Callable[[World], bool] | None] = _not_asked,
        judge: Workspaces | None = None,
    ) -> None:
        events = tuple(enumerate(parse_schedule(schedule)))
        self.events = {clock: [(i, event) for i, event in events if event.clock == clock] for clock in CLOCKS}
        self._robot, self._mounts, self._as_seen, self._can_begin = robot, mounts, as_seen, can_begin
        self._judge = (judge or Workspaces(1, robot, mounts)) if keep_in_view else None
        for _, event in events:
            if not isinstance(event.perturbation, Undo):
                event.perturbation.check_fits(robot)
        self._seeds = [0] * rows
        self._drifts: list[dict[int, tuple[Perturbation, bool]]] = [{} for _ in range(rows)]
        self._to_undo = {e.perturbation.event for _, e in events if isinstance(e.perturbation, Undo)}
        self._undoable: list[dict[int, tuple[World, World]]] = [{} for _ in range(rows)]

    def seed(self, row: int, seed: int) -> None:
        """Starts `row` anew from `seed`."""
        self._seeds[row] = seed
        self._drifts[row] = {}
        self._undoable[row] = {}

    def kept(self, row: int) -> Kept:
        """What is kept of events so far, for `go_on_with`."""
        return self._drifts[row].copy(), self._undoable[row].copy()

    def go_on_with(self, row: int, kept: Kept) -> None:
        """Goes on from what `kept` gave."""
        self._drifts[row], self._undoable[row] = kept

    def forget(self, row: int) -> None:
        """The world of `row` is another one: what events changed before is not undone in it."""
        self._undoable[row] = {}

    def apply(
        self, place: int, event: Event, row: int, count: int, world: World
    ) -> tuple[World, Perturbation | Undo | None]:
        """Applies an event to the world of a row.

        Args:
            place: The event's place in the schedule.
            event: The event.
            row: The row.
            count: Motions or trials of the row so far. What an event draws that comes but once does not hang
                on it: lives of any length meet the same.
            world: The world of the row.

        Returns:
            The world after it; and the perturbation with all that it drew, or None for every step of a
            drift after its first.

        Raises:
            ValueError: No draw of it is in view, or the world that it restores is not.
        """
        perturbation = event.perturbation
        if isinstance(perturbation, Undo):
            return self._undo(perturbation, row, world), perturbation
        if event.drift:
            return self._drift(place, perturbation, row, world)
        after, drawn = self._draw(place, perturbation, row, count if event.every else 0, world)
        if place in self._to_undo:
            self._undoable[row].pop(place, None)  # the latest last
            self._undoable[row][place] = world, after
        return after, drawn

    def _draw(
        self, place: int, perturbation: Perturbation, row: int, count: int, world: World
    ) -> tuple[World, Perturbation]:
        drawn = perturbation

        def perturbed(attempt: int) -> World:
            nonlocal drawn
            rng = stream(self._seeds[row], "perturbation", place, count, attempt)
            drawn = perturbation.drawn(rng, robot=self._robot)
            return self._changed(drawn, world, drawn.change)

        if self._judge is None:
            return perturbed(0), drawn
        found = first_in_view(
            perturbed,
            self._judge,
            0,
            f"the world after {perturbation.to_dict()}",
            also=self._can_begin(row),
            also_asks="can a trial begin",
            as_seen=self._as_seen,
        )
        return found, drawn

    def _changed(self, perturbation: Perturbation, world: World, change: Callable[..., World]) -> World:
        """The world after a change, which is told where the cameras are at home if it must know."""
        if not perturbation.at_home:
            return change(world, robot=self._robot)
        positions = cameras_at_home(world, self._robot, self._mounts)
        there = change(world.replace(camera_position=positions), robot=self._robot)
        return there.replace(camera_position=world.camera_position)

    def _serves(self, row: int, world: World) -> bool:
        if self._judge is None:
            return True
        can_begin = self._can_begin(row)
        self._judge.set_world(0, self._as_seen(world))
        return self._judge.in_view(0) and (can_begin is None or can_begin(world))

    def _undo(self, undo: Undo, row: int, world: World) -> World:
        changes = self._undoable[row]
        if undo.event not in changes:
            return world
        there = undone(world, *changes[undo.event])
        if not self._serves(row, there):
            raise ValueError(
                f"the world after {undo.to_dict()} is not in view, or no trial can begin: {there.to_dict()}"
            )
        places = [*changes]
        for later in places[places.index(undo.event) + 1 :]:  # to undo these does not bring it back
            before, after = changes[later]
            changes[later] = undone(before, *changes[undo.event]), undone(after, *changes[undo.event])
        return there

    def _drift(
        self, place: int, perturbation: Perturbation, row: int, world: World
    ) -> tuple[World, Perturbation | None]:
        """One step on, or one back where the next step is impossible."""
        drifts = self._drifts[row]
        begins = place not in drifts
        if begins:
            rng = stream(self._seeds[row], "drift", place)
            drifts[place] = perturbation.drawn(rng, slowly=True, robot=self._robot), False
        step, back = drifts[place]
        for way in (back, not back):
            try:
                there = self._changed(step, world, partial(step.drift, back=way))
            except ValueError:  # a quantity is at the end of its range
                continue
            if self._serves(row, there):
                drifts[place] = step, way
                world = there
                break
        return world, step if begins else None
