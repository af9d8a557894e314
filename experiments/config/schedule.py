"""Whether a schedule of perturbations fits what it is for."""

from collections.abc import Mapping, Sequence
from typing import Any

from calfree_gym.perturbations import parse_schedule


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
