"""`python -m experiments film`: one agent in one world, as YAML has it, lives and is filmed."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from pydantic import Field, ValidationInfo, field_validator

import agents
from agents.base.observation import Array
from agents.body_schema.body_schema import BodySchema
from agents.servo.image_model.smooth_points import SmoothPoints
from agents.servo.safe.safe_start import SafeStart
from calfree_gym.engine.config import LARGEST, SMALLEST
from calfree_gym.image import IMAGE_UNIT, LOOK_SECONDS
from calfree_gym.robot.inserting import RADIUS
from experiments.config.environment import EnvironmentConfig
from experiments.config.in_words import in_words
from experiments.config.life import check_reached
from experiments.config.loading import load_as
from experiments.config.model import Model
from experiments.config.requirements import requirements
from experiments.config.suite import AgentConfig
from experiments.errors import ConfigError
from experiments.evaluation import TrialRecord, evaluate
from experiments.film.pictures import (
    NO_ALARM,
    Alarm,
    FilmFiles,
    Image,
    Lettering,
    Markings,
    Screen,
    ScreenWords,
    Trial,
    moment,
)
from experiments.options import Parser, add_config, add_import
from experiments.reporting.tables import counted
from experiments.running.lifetime import LifetimeRecorder, learn_trials
from experiments.running.results_folder import made_folder

BAND = 6.5
"""The band of words takes one part in so many of a film's height."""
LEAST_HEIGHT = 144
"""Of a film, so that its pictures are not smaller than pictures can be."""


class GifConfig(Model):
    """The film once more, small enough for a page."""

    width: int = Field(720, ge=SMALLEST, le=LARGEST)
    frames_per_second: int = Field(10, gt=0, le=50)


class FilmConfig(Model):
    """A lifetime that is filmed.

    Attributes:
        seed: Of world, objects, noise and agent.
        first_trial: The first that is shown; those before are made, too.
        learn: Whether the agent learns, or shows what it does without.
        height: Of the film, words included, in pixels.
        words: Whether words stand below, and say what happens; small films are better without.
    """

    agent: AgentConfig
    env: EnvironmentConfig
    seed: int = Field(0, ge=0)
    trials: int = Field(gt=0)
    first_trial: int = Field(1, gt=0)
    learn: bool = True
    perturbations: tuple[dict[str, Any], ...] = Field((), strict=False)
    words: bool = True
    height: int = Field(780, ge=LEAST_HEIGHT, le=LARGEST)
    width: int = Field(1080, ge=SMALLEST, le=LARGEST)
    frames_per_second: int = Field(20, gt=0, le=120)
    gif: GifConfig = Field({}, validate_default=True)

    @field_validator("first_trial")
    @classmethod
    def _one_of_them(cls, value: int, info: ValidationInfo) -> int:
        if value > info.data.get("trials", value):
            raise ValueError(f"there are {info.data['trials']} trials")
        return value

    @field_validator("perturbations")
    @classmethod
    def _within_the_film(
        cls, value: tuple[dict[str, Any], ...], info: ValidationInfo
    ) -> tuple[dict[str, Any], ...]:
        check_reached(value, {"trial": info.data.get("trials")})
        return value

    @field_validator("height", "width")
    @classmethod
    def _even(cls, value: int, info: ValidationInfo) -> int:
        if value % 2:
            raise ValueError("it must be even, as MP4 wants it")
        height = info.data.get("height")
        if info.field_name == "width" and height is not None and value < height:
            raise ValueError(f"it must be at least the height, {height}")
        return value

    @field_validator("gif")
    @classmethod
    def _no_finer_than_the_film(cls, value: GifConfig, info: ValidationInfo) -> GifConfig:
        for key in ("width", "frames_per_second"):
            of_film = info.data.get(key)
            if of_film is not None and getattr(value, key) > of_film:
                raise ValueError(
                    f"gif.{key} is {getattr(value, key)}: it must be at most the film's {of_film}"
                )
        return value

    @property
    def band(self) -> int:
        """Height of the band of words, in pixels; even."""
        return self.words * 2 * round(self.height / (2 * BAND))


def load_film(path: Path, overrides: Sequence[str] = (), modules: Sequence[str] = ()) -> FilmConfig:
    """Reads and validates what is to be filmed; environment and agent are built once."""
    return load_as(FilmConfig, path, overrides, _unbuildable, modules)


def _unbuildable(config: FilmConfig) -> dict[str, str]:
    try:
        config.env.make(config.perturbations).close()
    except ValueError as error:
        return {"env": f"{error}"}
    try:
        required = requirements(config.agent, config.env)
    except Exception as error:  # whatever a library raises at a setting that it cannot use
        return {"agent": f"{error}"}
    if required.rows > 1:
        return {"agent": f"{config.agent.name!r} learns from {required.rows} arms at once; a film shows one"}
    return {}


UNSURE_PX = 40.0
"""What an agent knows no better than this (standard deviation) is no prediction. Choice."""


class Predictions:
    """Asks an agent what it predicts, and changes nothing in it."""

    def __init__(self, agent: Any) -> None:
        self._findings: Any = None
        other = isinstance(agent, BodySchema | SafeStart)  # a chain of joints; registers in other units
        if hasattr(agent, "new_findings") and not other:
            self._make = agent.new_findings
            agent.new_findings = self._new_findings

    def _new_findings(self) -> Any:
        self._findings = self._make()
        return self._findings

    def at(self, registers: Array) -> Array | None:
        """Image points (4, 2) at registers (m,), from all looks before; NaN where it is not sure.

        None where it predicts none.
        """
        points = getattr(self._findings, "estimator", None)
        if not isinstance(points, SmoothPoints):
            return None
        expected = points.at(registers)
        sure = np.sqrt(expected.variances) < UNSURE_PX * IMAGE_UNIT
        return np.where(sure[:, None], expected.points, np.nan)


def add_film(parser: Parser) -> None:
    """Films an agent."""
    add_config(parser)
    add_import(parser)
    parser.add_argument("--out", type=Path, required=True, help="folder for film.mp4, film.gif and film.png")
    parser.set_defaults(does=_film)


def _film(options: argparse.Namespace) -> int:
    config = load_film(options.config, options.set, options.modules)
    folder, gif = made_folder(options.out), config.gif
    rates = config.frames_per_second, gif.width, gif.frames_per_second
    required = requirements(config.agent, config.env)
    sensors, height = config.env.observation == "vision", config.height - config.band
    write = _without_words
    if config.words:
        write = Lettering(config.width, config.width - height // 2, config.band).write
    with closing(config.env.make(config.perturbations, tell=required.privileged)) as env:
        unwrapped: Any = env.unwrapped
        try:
            screen = Screen(unwrapped, config.width, height, sensors)
        except gymnasium.error.DependencyNotInstalled as error:
            raise ConfigError(f"{error}") from None
        with closing(screen), FilmFiles(folder, config.width, config.height, *rates) as files:
            shown = config.agent.label, config.first_trial
            recorder = FilmRecorder(env, screen, write, files, rates[0], *shown)
            records = _live(config, recorder, required.settings)
    for record in records:
        ends = "rendezvous" if record.rendezvous else "no rendezvous"
        print(f"trial {record.trial + 1}: {ends} after {record.motions} motions, {record.error_px:.1f} px")
    size = files.gif.stat().st_size / 1e6
    print(f"film: {files.mp4}, {files.gif}, {files.png} ({files.seconds:.0f} s, GIF {size:.1f} MB)")
    return 0


def _without_words(picture: Image, words: ScreenWords) -> Image:
    return picture


def _live(config: FilmConfig, recorder: FilmRecorder, settings: dict[str, Any]) -> list[TrialRecord]:
    """Lets the agent make its trials."""
    if not config.learn:
        agent = agents.make(config.agent.name, recorder, seed=config.seed, **settings)
        recorder.predicted = Predictions(agent).at
        return evaluate(agent, recorder, config.trials, config.seed)
    lifetime = LifetimeRecorder(recorder, config.seed)
    agent = agents.make(config.agent.name, lifetime, seed=config.seed, **settings)
    recorder.predicted = Predictions(agent).at
    return learn_trials(agent, lifetime, config.trials)


# -- An environment whose motions are filmed, and what the film says in words

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
