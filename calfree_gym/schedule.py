"""Schedules: when perturbations strike, as they stand in YAML."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from calfree_gym.perturbations import Perturbation, parse_perturbation
from calfree_gym.world import near_misses

CLOCKS = ("motion", "trial")


@dataclass(frozen=True)
class Event:
    """One entry of a schedule.

    Attributes:
        clock: "motion": counted over the environment's life, in mid-trial too; or "trial".
        at: How many motions or trials have gone before it strikes.
        every: Whether it strikes again each time as many more have gone.
        perturbation: What it does.
    """

    clock: str
    at: int
    every: bool
    perturbation: Perturbation

    def strikes(self, clock: str, count: int) -> bool:
        """Whether it strikes when `count` motions or trials have gone."""
        if clock != self.clock:
            return False
        return count == self.at or (self.every and count > 0 and count % self.at == 0)


Schedule = tuple[Event, ...]


def parse_schedule(entries: Iterable[Mapping[str, Any]] | None) -> Schedule:
    """Reads a list such as `[{"at": {"motion": 2000}, "do": {"type": "camera_roll"}}]`.

    `at` is `{motion: n}`, `{trial: n}` or `{every: {motion: n}}`, `{every: {trial: n}}`: it strikes when n
    motions or trials have gone since the environment was seeded, before the next. `do` names a type of
    `perturbations.TYPES` and any of its settings.

    Raises:
        ValueError: An entry is malformed; names it by its place, what was found and what is allowed.
    """
    if entries is None:
        return ()
    if isinstance(entries, Mapping | str) or not isinstance(entries, Iterable):
        raise ValueError(f"perturbations is {entries!r}; it must be a list of {{at: ..., do: ...}}")
    return tuple(
        _event(entry, f"perturbations[{i}]") if not isinstance(entry, Event) else entry
        for i, entry in enumerate(entries)
    )


def _event(entry: Mapping[str, Any], where: str) -> Event:
    if not isinstance(entry, Mapping) or set(entry) != {"at", "do"}:
        raise ValueError(f"{where} is {entry!r}; it must be a mapping with exactly at and do")
    at, do = entry["at"], entry["do"]
    every = isinstance(at, Mapping) and set(at) == {"every"}
    clock, count = _count(at["every"], f"{where}.at.every") if every else _count(at, f"{where}.at")
    if every and count == 0:
        raise ValueError(f"{where}.at.every.{clock} is 0; it must be at least 1")
    perturbation = do if isinstance(do, Perturbation) else parse_perturbation(do, f"{where}.do")
    return Event(clock, count, every, perturbation)


def _count(at: Any, where: str) -> tuple[str, int]:
    if not isinstance(at, Mapping) or len(at) != 1:
        raise ValueError(
            f"{where} is {at!r}; it must be one of {{motion: n}}, {{trial: n}} or {{every: {{trial: n}}}}"
        )
    ((clock, count),) = at.items()
    if clock not in CLOCKS:
        raise ValueError(
            f"{where} has {clock!r}{near_misses(clock, CLOCKS)}; allowed: {', '.join(CLOCKS)}, every"
        )
    if isinstance(count, bool) or not isinstance(count, int) or count < 0:
        raise ValueError(f"{where}.{clock} is {count!r}; it must be a whole number, 0 or more")
    return clock, count
