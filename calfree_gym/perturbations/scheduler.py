"""What a schedule of perturbations does to the worlds of N rows."""

from __future__ import annotations

from typing import Any

from calfree_gym.perturbations.base import Perturbation
from calfree_gym.perturbations.schedule import CLOCKS, Event, parse_schedule
from calfree_gym.perturbations.undo import Undo, undone
from calfree_gym.streams import stream
from calfree_gym.workspace import first_in_view, in_view
from calfree_gym.world import World


class Strikes:
    """Turns worlds into others when events are due.

    What an event draws depends on the row's seed, the event's place in the schedule and the count of motions
    or trials at which it strikes, and on nothing else.

    Args:
        rows: N.
        schedule: Entries as for `schedule.parse_schedule`.
        mount: Where the cameras are fixed.
        keep_in_view: Whether worlds that the cameras do not see are drawn again, and drifts turn back.
    """

    def __init__(self, rows: int, schedule: Any, mount: str, keep_in_view: bool) -> None:
        events = tuple(enumerate(parse_schedule(schedule)))
        self.events = {clock: [(i, event) for i, event in events if event.clock == clock] for clock in CLOCKS}
        self._mount = mount
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

    def strike(
        self, number: int, event: Event, row: int, count: int, world: World
    ) -> tuple[World, Perturbation | Undo | None]:
        """Lets an event strike the world of a row.

        Returns:
            The world after it; and the perturbation with all that it drew, None where it is a further step
            of a drift that was told before.

        Raises:
            ValueError: What it draws is never in view, or what it brings back is not.
        """
        perturbation = event.perturbation
        if isinstance(perturbation, Undo):
            return self._undo(perturbation, row, world), perturbation
        if event.drift:
            return self._drift(number, perturbation, row, world)
        after, drawn = self._strike(number, perturbation, row, count, world)
        if number in self._to_undo:
            self._undoable[row][number] = world, after
        return after, drawn

    def _strike(
        self, number: int, perturbation: Perturbation, row: int, count: int, world: World
    ) -> tuple[World, Perturbation]:
        drawn = perturbation

        def perturbed(attempt: int) -> World:
            nonlocal drawn
            drawn = perturbation.drawn(stream(self._seeds[row], "perturbation", number, count, attempt))
            return drawn.change(world)

        if not self._keep_in_view:
            return perturbed(0), drawn
        what = f"the world after {perturbation.to_dict()}"
        return first_in_view(perturbed, self._mount, what), drawn

    def _undo(self, undo: Undo, row: int, world: World) -> World:
        there = undone(world, *self._undoable[row][undo.event])
        if self._keep_in_view and not in_view(there, self._mount):
            raise ValueError(f"the world after {undo.to_dict()} is not in view: {there.to_dict()}")
        return there

    def _drift(
        self, number: int, perturbation: Perturbation, row: int, world: World
    ) -> tuple[World, Perturbation | None]:
        """One step on, or back where there is no further."""
        drifts = self._drifts[row]
        begins = number not in drifts
        if begins:
            drifts[number] = perturbation.drawn(stream(self._seeds[row], "drift", number), slowly=True), False
        step, back = drifts[number]
        for way in (back, not back):
            try:
                there = step.drift(world, way)
            except ValueError:  # a quantity is at the end of its range
                continue
            if not self._keep_in_view or in_view(there, self._mount):
                drifts[number] = step, way
                world = there
                break
        return world, step if begins else None
