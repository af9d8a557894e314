"""`python -m experiments film`: an agent lives, and is filmed."""

import argparse
from pathlib import Path
from typing import Any

import gymnasium

import agents
from experiments.config.requirements import requirements
from experiments.errors import ConfigError
from experiments.evaluation import TrialRecord, evaluate
from experiments.film.config import FilmConfig, load_film
from experiments.film.drawing import Screen
from experiments.film.files import FilmFiles
from experiments.film.lettering import Image, Lettering, Words
from experiments.film.predictions import Predictions
from experiments.film.recorder import FilmRecorder
from experiments.options import Parser, add_config
from experiments.running.lifetime import LifetimeRecorder, learn_trials
from experiments.running.results_folder import made_folder


def add_film(parser: Parser) -> None:
    """Films an agent."""
    add_config(parser)
    parser.add_argument("--out", type=Path, required=True, help="folder for film.mp4, film.gif and film.png")
    parser.set_defaults(does=_film)


def _film(options: argparse.Namespace) -> int:
    files, records = film(load_film(options.config, options.set), options.out)
    for record in records:
        ends = "rendezvous" if record.rendezvous else "no rendezvous"
        print(f"trial {record.trial + 1}: {ends} after {record.motions} motions, {record.error_px:.1f} px")
    size = files.gif.stat().st_size / 1e6
    print(f"film: {files.mp4}, {files.gif}, {files.png} ({files.seconds:.0f} s, GIF {size:.1f} MB)")
    return 0


def film(config: FilmConfig, out: Path) -> tuple[FilmFiles, list[TrialRecord]]:
    """Films an agent.

    Args:
        config: Whom, and where.
        out: Folder for film.mp4, film.gif and film.png.

    Returns:
        The files, and what all trials came to.

    Raises:
        ConfigError: The folder cannot be made, or OpenGL or the codec is missing.
    """
    folder = made_folder(out)
    gif = config.gif
    rates = config.frames_per_second, gif.width, gif.frames_per_second
    required = requirements(config.agent, config.env)
    env = config.env.make(config.perturbations, tell=required.privileged)
    unwrapped: Any = env.unwrapped
    try:
        sensors, height = config.env.observation == "vision", config.height - config.band
        screen = Screen(unwrapped.arms, config.width, height, sensors)
        try:
            with FilmFiles(folder, config.width, config.height, *rates) as files:
                write = _without_words
                if config.words:
                    write = Lettering(config.width, config.width - height // 2, config.band).write
                recorder = FilmRecorder(
                    env, screen, write, files, rates[0], config.agent.label, config.first_trial
                )
                records = _live(config, recorder, required.settings)
        finally:
            screen.close()
    except gymnasium.error.DependencyNotInstalled as error:
        raise ConfigError(f"{error}") from None
    finally:
        env.close()
    return files, records


def _without_words(picture: Image, words: Words) -> Image:
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
