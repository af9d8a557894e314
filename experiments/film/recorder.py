"""An environment whose motions are filmed, and what the film says in words."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import gymnasium
import numpy as np

from calfree_gym.geometry import Array
from calfree_gym.image import LOOK_SECONDS
from calfree_gym.robot.inserting import RADIUS
from experiments.config.in_words import in_words
from experiments.film.files import FilmFiles
from experiments.film.pictures import NO_ALARM, Alarm, Image, Markings, Screen, ScreenWords, Trial, moment
from experiments.reporting.tables import counted

MM = 1000.0


class TrialStatus(NamedTuple):
    """Where a trial is: its number, its motions, what `calfree_gym` told of the last one, how it stands."""

    trial: int
    motions: int
    info: Mapping[str, Any]
    success: bool = False
    over: bool = False

    @property
    def task(self) -> TaskInWords:
        """What the agent is to do."""
        return next(task for task in TASKS if not task.told_by or task.told_by in self.info["truth"])


class TaskInWords(NamedTuple):
    """What an agent is to do, in words: what only its truth tells; a trial; what was done; what is marked."""

    told_by: str
    trial: str
    done: str
    marks: tuple[str, str] = ("gripper", "object")


TASKS = (
    TaskInWords("lifted_mm", "grasp", "lifted"),
    TaskInWords("depth_mm", "insertion", "inserted"),
    TaskInWords("offset_mm", "docking", "docked", ("own marks", "the dock's")),
    TaskInWords("", "reach", "reached"),
)


def caption(agent: str, status: TrialStatus) -> str:
    """The line below the pictures."""
    count, task = counted(status.motions, "motion"), status.task
    where = f"motion {status.motions}"
    if status.success:
        where = f"{task.done} in {count}"
    elif status.over:
        where = f"not {task.done} in {count}"
    return " · ".join([agent, f"trial {status.trial}", where, *_measured(status.info)])


def told(status: TrialStatus) -> str:
    """Where a trial is, in a few words."""
    count = counted(status.motions, "motion") if status.motions else "begins"
    return f"{status.task.trial} {status.trial}: {count}" + ", in vain" * (status.over and not status.success)


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
    if "offset_mm" in truth:
        return [f"{truth['offset_mm']:.0f} mm and {truth['heading_deg']:.0f}° off"]
    off = f"{truth['error_px']:.0f} px off"
    if "contacts" not in info:
        return [off]
    return [off, f"touches with {info['peak_force']:.0f} N" if info["contacts"] else "touches nothing"]


# Seconds in the film. Choice: so that a film of ten motions takes about ten seconds.
LOOK, END = 0.3, 0.6
"""Of a look, and after a trial."""
SHORTEST = 0.25
"""Of the shortest way; others take as long as the robot needs for them."""
FLASH, FLASHES, NEWS = 0.1, 3, 0.8
"""Where the world is changed: of each of so many flashes, and of the news after them, while the arm rests."""
STILL = 1e-4
"""Joints that move less (rad or m) stand still in the film (a guard)."""


class FilmRecorder(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Films every trial from `first_trial` on.

    Attributes:
        predicted: Tells where the agent expects image points (4, 2) at registers (m,), or None; asked after a
            motion and before the agent gets to know what was seen.
    """

    def __init__(
        self,
        env: gymnasium.Env[Any, Any],
        screen: Screen,
        write: Callable[[Image, ScreenWords], Image],
        film: FilmFiles,
        frames_per_second: int,
        agent: str,
        first_trial: int = 1,
    ) -> None:
        super().__init__(env)
        self.predicted: Callable[[Array], Array | None] = lambda registers: None
        self._screen, self._write, self._film, self._rate = screen, write, film, frames_per_second
        self._agent, self._first_trial = agent, first_trial
        self._status = TrialStatus(0, 0, {})
        self._trials: list[Trial] = []
        self._marks: Markings | None = None
        self._alarm, self._expected = NO_ALARM, False
        self._way: list[Array] = []
        self._arms.simulation.way = self._way

    @property
    def _arms(self) -> Any:
        env: Any = self.env.unwrapped
        return env.arms

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begins a trial: what has happened to the world, the way home, and a look."""
        unwrapped: Any = self.env.unwrapped
        before, seconds = None, 0.0
        if self._filming:
            before, seconds = self._configuration(), unwrapped.home_seconds - LOOK_SECONDS
        self._way.clear()
        observation, info = self.env.reset(seed=seed, options=options)
        self._status = TrialStatus(self._status.trial + 1, 0, info)
        self._trials.append(Trial())
        self._marks, self._alarm = None, NO_ALARM
        self._note_changes()
        if self._filming:
            self._announce(before)
            if before is not None:
                self._travel(before, seconds)
            self._look()
        return observation, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Makes a motion: what has happened to the world, the way, and a look at its end."""
        before, marks = self._configuration(), self._marks
        self._way.clear()
        observation, reward, terminated, truncated, info = self.env.step(action)
        status = self._status._replace(motions=self._status.motions + 1)
        self._note_changes()
        if self._filming:
            self._announce(before)
        self._trials[-1] = self._trials[-1]._replace(motions=status.motions)
        if self._filming:
            assert marks is not None
            predicted = self.predicted(self._arms.told_registers()[0])
            self._expected = self._expected or predicted is not None
            self._status, self._marks = status, marks.lingering(predicted)
            self._travel(before, float(info["robot_seconds"]) - LOOK_SECONDS)
        over, success = terminated or truncated, bool(info["is_success"])
        self._status = status._replace(info=info, success=success, over=over)
        if over:
            self._trials[-1] = self._trials[-1]._replace(success=success)
        if self._filming:
            self._look(predicted)
        return observation, reward, terminated, truncated, info

    @property
    def _filming(self) -> bool:
        return self._status.trial >= self._first_trial

    def _configuration(self) -> Array:
        configuration: Array = self._arms.simulation.configuration(0)
        return configuration

    def _note_changes(self) -> None:
        """What has happened to the world before the last motion or reset."""
        unwrapped: Any = self.env.unwrapped
        self._changes = [perturbation.to_dict() for perturbation in unwrapped.applied]
        if self._changes:
            self._trials[-1] = self._trials[-1]._replace(knocked=True)

    def _words(self, announced: str = "", good: bool = False) -> ScreenWords:
        status = self._status
        said = caption(self._agent, status), good, announced, status.task.trial, status.task.marks
        return ScreenWords(*said, tuple(self._trials), self._expected)

    def _announce(self, configuration: Array | None) -> None:
        """Shows what has happened to the world, with the arm still where it was: it flashes, then stays."""
        marks = None if self._marks is None else self._marks.lingering(None)
        for change in self._changes:
            said = in_words(change)
            words, alarm = self._words(said), Alarm(change.get("camera", ""), now=True)
            for flash in (True, False) * FLASHES:
                self._show(FLASH, configuration, marks, words, alarm._replace(flash=flash))
            picture = self._show(NEWS, configuration, marks, words, alarm)
            self._film.keep(moment(picture, said, turn=True, change=True))
            self._alarm = alarm._replace(now=False)

    def _travel(self, before: Array, seconds: float) -> None:
        """Shows the way from `before` to now: as the simulation went, or else with joints moving evenly."""
        simulation, after, way = self._arms.simulation, self._configuration(), self._way
        words = self._words()
        if np.abs(after - before).max() < STILL:
            return
        frames = max(1, round(self._rate * max(seconds, SHORTEST)))
        for frame in range(1, frames + 1):
            passed = math.ceil(frame / frames * len(way)) - 1
            share = (1 - math.cos(math.pi * frame / frames)) / 2  # it starts and ends slowly
            there = way[passed] if way else simulation.between(before, after, share)
            self._show(0, there, self._marks, words, self._alarm)

    def _look(self, predicted: Array | None = None) -> None:
        """Shows what is seen now."""
        points, seen, target = self._arms.shown(0)
        self._marks = Markings(points, seen, target, predicted)
        status = self._status
        words, seconds = self._words(good=status.success), END if status.over else LOOK
        picture = self._show(seconds, None, self._marks, words, self._alarm)
        self._film.keep(moment(picture, told(status), turn=status.over))

    def _show(
        self,
        seconds: float,
        configuration: Array | None,
        marks: Markings | None,
        words: ScreenWords,
        alarm: Alarm,
    ) -> Image:
        """Shows a picture for so long, and at least for a frame; without words it is returned."""
        picture = self._screen.draw(configuration, marks, alarm)
        self._film.add(self._write(picture, words), max(1, round(self._rate * seconds)))
        return picture
