"""What a film says in words: where it is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from calfree_gym.robot.inserting.peg import RADIUS

MM = 1000.0


class Status(NamedTuple):
    """Where a trial is.

    Attributes:
        trial: From 1.
        motions: Made in it.
        info: What `calfree_gym` tells of the last motion.
        success: Whether the task is done.
        over: Whether it has ended.
    """

    trial: int
    motions: int
    info: Mapping[str, Any]
    success: bool = False
    over: bool = False

    @property
    def task(self) -> Task:
        """What the agent is to do."""
        return next(task for task in TASKS if not task.told_by or task.told_by in self.info["truth"])


class Task(NamedTuple):
    """What an agent is to do, in words.

    Attributes:
        told_by: What only its truth tells; nothing, of reaching.
        trial: What a trial is.
        done: What has happened where the trial was a success.
    """

    told_by: str
    trial: str
    done: str


TASKS = (
    Task("lifted_mm", "grasp", "lifted"),
    Task("depth_mm", "insertion", "inserted"),
    Task("", "reach", "reached"),
)


def caption(agent: str, status: Status) -> str:
    """The line below the pictures."""
    count, task = motions_in_words(status.motions), status.task
    where = f"motion {status.motions}"
    if status.success:
        where = f"{task.done} in {count}"
    elif status.over:
        where = f"not {task.done} in {count}"
    return " · ".join([agent, f"trial {status.trial}", where, *_measured(status.info)])


def told(status: Status) -> str:
    """Where a trial is, in a few words."""
    count = motions_in_words(status.motions) if status.motions else "begins"
    return f"{status.task.trial} {status.trial}: {count}" + ", in vain" * (status.over and not status.success)


def motions_in_words(motions: int) -> str:
    """So many motions."""
    return f"{motions} motion{'s' * (motions != 1)}"


def _measured(info: Mapping[str, Any]) -> list[str]:
    """What is true of the task."""
    truth = info["truth"]
    if "lifted_mm" in truth:
        if truth["lifted_mm"] == 0:  # nothing is between the jaws
            return ["not held"]
        up = round(float(truth["lifted_mm"]))
        return [f"held, {up} mm up" if up > 0 else "held"]
    if "depth_mm" in truth:
        inside = truth["depth_mm"] > 0 and truth["lateral_mm"] < MM * RADIUS
        return [f"peg {truth['depth_mm']:.0f} mm in the hole" if inside else "peg outside the hole"]
    off = f"{truth['error_px']:.0f} px off"
    if "contacts" not in info:
        return [off]
    return [off, f"touches with {info['peak_force']:.0f} N" if info["contacts"] else "touches nothing"]
