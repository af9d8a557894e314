"""From where the gripper's tip was seen, to go back there when it gets lost."""

from __future__ import annotations

from .observation import TIP, GraspObservation

LOST = 2
"""A tip that was not seen in so many looks is out of view. Choice: in one it may be hidden."""


class InView:
    """What is known of where the tip is in view.

    Attributes:
        registers: Where (5,) it was seen last.
        shorter: Share of which words are sent: less where it got lost.

    Args:
        first: The first observation.
    """

    def __init__(self, first: GraspObservation) -> None:
        self.registers, self.shorter = first.registers, 1.0
        self._unseen = 0

    def look(self, now: GraspObservation, was_seen: bool) -> None:
        """Takes in a look; where the tip gets lost, the next words are half as long."""
        self._unseen += 1
        if now.visible[TIP].all():
            self.registers, self._unseen = now.registers, 0
            self.shorter = min(1.0, 2 * self.shorter) if was_seen else self.shorter
        elif self._unseen == LOST:
            self.shorter /= 2

    @property
    def lost(self) -> bool:
        """Whether the tip is out of view."""
        return self._unseen >= LOST
