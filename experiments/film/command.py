"""`python -m experiments film`: an agent lives, and is filmed."""

import argparse
from contextlib import closing
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import agents
from agents.base.observation import Array
from agents.body_schema.body_schema import BodySchema
from agents.servo.image_model.smooth_points import SmoothPoints
from agents.servo.safe.safe_start import SafeStart
from calfree_gym.image import IMAGE_UNIT
from experiments.config.requirements import requirements
from experiments.errors import ConfigError
from experiments.evaluation import TrialRecord, evaluate
from experiments.film.config import FilmConfig, load_film
from experiments.film.files import FilmFiles
from experiments.film.pictures import Image, Lettering, Screen, ScreenWords
from experiments.film.recorder import FilmRecorder
from experiments.options import Parser, add_config
from experiments.running.lifetime import LifetimeRecorder, learn_trials
from experiments.running.results_folder import made_folder

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
    parser.add_argument("--out", type=Path, required=True, help="folder for film.mp4, film.gif and film.png")
    parser.set_defaults(does=_film)


def _film(options: argparse.Namespace) -> int:
    config = load_film(options.config, options.set)
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
