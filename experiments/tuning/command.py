"""`python -m experiments tune`: several agents, one after the other or side by side."""

import argparse
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import optuna

from experiments.errors import ConfigError
from experiments.options import Parser, add_config, whole
from experiments.reporting.tables import show
from experiments.running.process import end_idle_workers
from experiments.running.results_folder import locked, made_folder, write_whole
from experiments.running.versions import REPOSITORY, commit, versions
from experiments.tuning.config import TuningConfig, load_tuning
from experiments.tuning.results import SETTINGS, settings_file, write_agent, write_tables
from experiments.tuning.tuner import DefaultsFailError, Lifetimes, LostError, Tuner

STUDIES = "studies"


def add_tune(parser: Parser) -> None:
    """Tunes agents."""
    add_config(parser)
    parser.add_argument("--out", type=Path, required=True, help="folder for the results")
    parser.add_argument("--jobs", type=whole(1), default=1, help="agents at a time (default: 1)")
    parser.add_argument("--agent", nargs="+", default=[], metavar="NAME", help="these alone")
    parser.add_argument("--write", action="store_true", help="write better settings into configs/agents")
    parser.set_defaults(does=_tune)


def _tune(options: argparse.Namespace) -> int:
    config = load_tuning(options.config, options.set)
    return 1 if tune(config, options.out, options.agent, options.jobs, options.write) else 0


def tune(config: TuningConfig, out: Path, names: list[str], jobs: int, write: bool) -> list[str]:
    """Tunes agents, all or those named, and writes what came of it; returns those whose tuning failed.

    What stands in the folder is gone on with. So many agents are tuned at a time; the tries of one follow
    each other, as each learns from those before it. With `write`, settings that beat the default ones go into
    configs/agents.

    Raises:
        ConfigError: An agent is not tuned here, another process is at work in the folder, or it holds tries
            of other code or of another configuration.
    """
    try:
        agents = config.only(names).agents if names else config.agents
    except ValueError as error:
        raise ConfigError(f"--agent: {error}") from None
    made_folder(out / STUDIES)
    with locked(out):
        made_by = {**versions(("experiments/tuning",)), "optuna": optuna.__version__}
        lifetimes, by = Lifetimes(made_by), commit()
        tuners = [Tuner(config, each, out / STUDIES, lifetimes.make, made_by, by, _say) for each in agents]
        pool = ThreadPoolExecutor(jobs)
        tuned = [pool.submit(_tuned, tuner, out) for tuner in tuners]
        try:
            found = [each.result() for each in tuned]
        finally:  # each agent whose worker was ended begins no other
            pool.shutdown(wait=False, cancel_futures=True)
            while not all(each.done() for each in tuned):
                lifetimes.stop()
                time.sleep(0.1)
            end_idle_workers()
        show(write_tables(out, config))
    for each in found:
        if each and each["choice"] == "tuned":
            _offer(each, write)
    return [agent.name for agent, each in zip(agents, found, strict=True) if each is None]


def _tuned(tuner: Tuner, out: Path) -> dict[str, Any] | None:
    """What became of an agent; None where its tuning failed, which stops no other."""
    try:
        found = tuner.tune()
    except (DefaultsFailError, LostError) as error:
        print(f"{tuner.name}: FAILED: {error}", file=sys.stderr)
        return None
    write_agent(out, found)
    _say(f"{tuner.name}: {found['choice']} settings, stopped by {found['stopped_by']}")
    return found


def _offer(found: dict[str, Any], write: bool) -> None:
    """Writes or prints the settings that beat the default ones."""
    path = SETTINGS / f"{found['agent']['name']}.yaml"
    text = settings_file(found)
    if write:
        write_whole(path, text)
    _say(f"{path.relative_to(REPOSITORY)}{'' if write else ', which --write writes'}:\n{text}")


def _say(text: str) -> None:
    print(text, flush=True)
