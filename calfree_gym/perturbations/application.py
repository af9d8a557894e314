"""Applies a schedule of perturbations to the worlds of N rows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, ClassVar

from calfree_gym.perturbations.base import Perturbation
from calfree_gym.perturbations.schedule import CLOCKS, Event, Undo, parse_schedule, undone
from calfree_gym.robot.arms.robot import Mounts, Robot
from calfree_gym.robot.workspace import cameras_at_home, first_in_view, in_view
from calfree_gym.streams import stream
from calfree_gym.world import World

Applied = tuple[int, Perturbation | Undo]
"""A row, and the perturbation that was applied to it, with all that it drew."""
Kept = tuple[dict[int, tuple[Perturbation, bool]], dict[int, tuple[World, World]]]
"""Of a row: the drifts that have begun, and what events may be undone."""


class PerturbationScheduler:
    """Changes the worlds of N rows when events of a schedule are due.

    What an event draws depends on the row's seed, the event's place in the schedule and the count of motions
    or trials at which it is applied (a drift: not on the count). With `keep_in_view` it also depends on the
    world at that moment, because draws out of view are repeated.

    Attributes:
        events: For each clock, its events with their places in the schedule.

    Args:
        rows: N.
        schedule: Entries as for `schedule.parse_schedule`.
        robot: Their arm.
        mounts: Where the cameras are fixed.
        keep_in_view: Whether worlds that the cameras do not see are drawn again, and drifts turn back.
        as_seen: A world as it is judged whether they do.
        can_begin: Whether a trial can begin in a world of a row, if that is asked, too.
    """

    state_names: ClassVar[tuple[str, ...]] = ("_drifts", "_undoable")

    def __init__(
        self,
        rows: int,
        schedule: Any,
        robot: Robot,
        mounts: Mounts,
        keep_in_view: bool,
        as_seen: Callable[[World], World] = lambda world: world,
        can_begin: Callable[[int], Callable[[World], bool] | None] = lambda row: None,
    ) -> None:
        events = tuple(enumerate(parse_schedule(schedule)))
        self.events = {clock: [(i, event) for i, event in events if event.clock == clock] for clock in CLOCKS}
        self._robot, self._mounts, self._as_seen, self._can_begin = robot, mounts, as_seen, can_begin
        for _, event in events:
            if not isinstance(event.perturbation, Undo):
                event.perturbation.check_fits(robot)
        self._keep_in_view = keep_in_view
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
            count: Motions or trials of the row so far.
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
        after, drawn = self._draw(place, perturbation, row, count, world)
        if place in self._to_undo:
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

        if not self._keep_in_view:
            return perturbed(0), drawn
        found = first_in_view(
            perturbed,
            self._robot,
            self._mounts,
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
        there = change(replace(world, camera_position=positions), robot=self._robot)
        return replace(there, camera_position=world.camera_position)

    def _serves(self, row: int, world: World) -> bool:
        if not self._keep_in_view:
            return True
        can_begin = self._can_begin(row)
        seen = in_view(self._as_seen(world), self._robot, self._mounts)
        return seen and (can_begin is None or can_begin(world))

    def _undo(self, undo: Undo, row: int, world: World) -> World:
        if undo.event not in self._undoable[row]:
            return world
        there = undone(world, *self._undoable[row][undo.event])
        if not self._serves(row, there):
            raise ValueError(
                f"the world after {undo.to_dict()} is not in view, or no trial can begin: {there.to_dict()}"
            )
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
