"""What happens in a run of reaches, as its report and its film need it."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from calfree_gym.cli.drawing import jpeg, side_by_side
from calfree_gym.lerobot import LeRobotReachEnv, ReachRecord
from calfree_gym.picture_reach import PictureLook


@dataclass
class FilmFrame:
    """One look: in words, and as a file of both pictures with what is seen."""

    said: str
    picture: bytes


@dataclass
class RecordedReach:
    """A reach and all looks of it; `outcome` is None where it has not ended."""

    number: int
    frames: list[FilmFrame] = field(default_factory=list)
    outcome: ReachRecord | None = None


@dataclass(frozen=True)
class Noticed:
    """A change that the agent believes in: which one, and after which reach of this run it noticed it."""

    what: str
    reach: int


class Recording:
    """Takes in each look as it comes, and tells how far the run is.

    Attributes:
        reaches: The latest last; one more is begun than has ended.

    Args:
        count: How many reaches there are to be.
    """

    def __init__(self, count: int) -> None:
        self.count, self.reaches = count, [RecordedReach(1)]
        self._last: PictureLook | None = None
        self._known = 0
        self._noticed: list[int] = []

    def begin(self, env: LeRobotReachEnv, agent: Any) -> None:
        """The run begins; what the agent has noticed before is not of it."""
        self._env, self._agent = env, agent
        self._known = len(_events(agent))

    def tick(self, *_: Any) -> None:
        """A twentieth of a second has gone by."""
        if (look := self._env.look) is None or look is self._last:
            return
        self._last, now = look, self.reaches[-1]
        if not (motions := self._env.motions):
            now.frames.clear()  # the object may be placed more than once
        how = f"{look.px:.1f} px off" if look.visible.all() else "a mark is not seen"
        when = f"motion {motions}" if motions else "from home"
        said = f"reach {now.number} of {self.count}, {when}: {how}"
        now.frames.append(FilmFrame(said, jpeg(side_by_side(look))))
        if sys.stdout.isatty():
            print(f"\r\033[K{said}", end="", flush=True)

    def end(self, reach: ReachRecord) -> None:
        """A reach has ended."""
        self.tick()
        ended = self.reaches[-1]
        ended.outcome = reach
        before = len(self.noticed)
        events = len(_events(self._agent)) - self._known
        self._noticed = self._noticed[:events] + [ended.number] * (events - len(self._noticed))
        if sys.stdout.isatty():
            print("\r\033[K", end="")
        print(in_words(ended.number, reach))
        for noticed in self.noticed[before:]:
            print(f"  the agent has noticed a change: {noticed.what}")
        self.reaches.append(RecordedReach(ended.number + 1))

    @property
    def noticed(self) -> list[Noticed]:
        """What the agent believes, by now, has changed in this run."""
        events = _events(self._agent)[self._known :]
        return [Noticed(each.kind, reach) for each, reach in zip(events, self._noticed, strict=False)]


def in_words(number: int, reach: ReachRecord) -> str:
    """One line about a reach."""
    outcome = "reached" if reach.reached else "not reached"
    motions = f"{reach.motions} motion{'s' * (reach.motions > 1)}"
    back = f"; stayed back: {', '.join(reach.stopped)}" if reach.stopped else ""
    return f"reach {number}: {outcome}, {motions}, {reach.px:.1f} px, {reach.seconds:.0f} s{back}"


def _events(agent: Any) -> Sequence[Any]:
    return getattr(agent, "events", ())
