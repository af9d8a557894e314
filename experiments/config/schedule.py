"""Schedules of perturbations in a life: shares of it as motions, and whether every event is reached."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from calfree_gym.perturbations import parse_schedule

SHARE = "share"


def shares(schedule: Sequence[dict[str, Any]]) -> Iterator[tuple[int, Any]]:
    """The places of events that come at a share of a life, each with that share."""
    for i, entry in enumerate(schedule):
        when = entry.get("at") if isinstance(entry, Mapping) else None
        if isinstance(when, Mapping) and when.keys() == {SHARE}:
            yield i, when[SHARE]


def with_shares_as_motions(
    schedule: Sequence[dict[str, Any]], motions: int | None
) -> tuple[dict[str, Any], ...]:
    """A schedule in which `at: {share: 0.5}` is the motion that it means.

    Args:
        schedule: See `parse_schedule`, and shares.
        motions: Of the life; None where it is counted in trials.

    Raises:
        ValueError: A share is no number between 0 and 1, or the life is counted in trials.
    """
    found = list(schedule)
    for i, share in shares(schedule):
        where = f"perturbations.{i}.at.{SHARE}"
        if isinstance(share, bool) or not isinstance(share, int | float) or not 0 < share < 1:
            raise ValueError(f"{where} is {share!r}; it must be a number between 0 and 1, such as 0.5")
        if motions is None:
            raise ValueError(
                f"{where} is {share!r}: a share is of a life's motions, and this one is counted in trials; "
                "allowed: {trial: n}"
            )
        found[i] = {**found[i], "at": {"motion": round(share * motions)}}
    return tuple(found)


def check_reached(
    schedule: Sequence[dict[str, Any]], lengths: Mapping[str, int | None], of: str = ""
) -> None:
    """Raises where an event of a schedule is never reached, or the schedule is wrong.

    Args:
        schedule: See `parse_schedule`.
        lengths: Of a lifetime, by clock; None where it has none.
        of: What has these lengths, for the message.

    Raises:
        ValueError: Names the event.
    """
    for i, event in enumerate(parse_schedule(list(schedule))):
        clock, length = event.clock, lengths.get(event.clock)
        if length is not None and event.at >= length:
            raise ValueError(f"perturbations.{i}.at.{clock} is {event.at}: never, in {of}{length} {clock}s")
