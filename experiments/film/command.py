"""`python -m experiments film`: one agent in one world, as YAML has it, lives and is filmed."""

import argparse
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from pydantic import Field, ValidationInfo, field_validator

import agents
from agents.base.observation import Array
from agents.body_schema.body_schema import BodySchema
from agents.servo.image_model.smooth_points import SmoothPoints
from agents.servo.safe.safe_start import SafeStart
from calfree_gym.engine.config import LARGEST, SMALLEST
from calfree_gym.image import IMAGE_UNIT
from experiments.config.environment import EnvironmentConfig
from experiments.config.life import check_reached
from experiments.config.loading import load_as
from experiments.config.model import Model
from experiments.config.requirements import requirements
from experiments.config.suite import AgentConfig
from experiments.errors import ConfigError
from experiments.evaluation import TrialRecord, evaluate
from experiments.film.files import FilmFiles
from experiments.film.pictures import Image, Lettering, Screen, ScreenWords
from experiments.film.recorder import FilmRecorder
from experiments.options import Parser, add_config, add_import
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
