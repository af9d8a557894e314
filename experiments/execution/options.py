"""Options of `run` that say where and how runs are made."""

import argparse
import shlex
from pathlib import Path

from calfree_gym.errors import to_install
from experiments.errors import ConfigError
from experiments.execution.executor import Executor
from experiments.execution.part import WHOLE, Part
from experiments.running.versions import REPOSITORY


def add_run_options(run: argparse.ArgumentParser) -> None:
    """Adds them to the command."""
    run.add_argument("--out", type=Path, required=True, help="folder for the results")
    run.add_argument("--fail-fast", action="store_true", help="stop at the first run that fails")
    run.add_argument(
        "--retries",
        type=_count,
        default=2,
        metavar="N",
        help="how often a run is made again whose worker was lost (default: 2)",
    )
    run.add_argument(
        "--part",
        type=_part,
        default=WHOLE,
        metavar="K/N",
        help="make the K-th of N parts of the runs; `merge` puts parts together",
    )
    where = run.add_mutually_exclusive_group()
    where.add_argument("--jobs", type=_positive, default=1, help="runs at a time, here (default: 1)")
    where.add_argument("--cluster", metavar="ADDRESS", help="make the runs on the Dask cluster there")
    where.add_argument("--slurm", action="store_true", help="make the runs as jobs of Slurm")
    run.add_argument(
        "--slurm-option",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="such as partition=long, timeout_min=60 or mem_gb=4 (repeatable)",
    )
    run.add_argument(
        "--cluster-patience",
        type=_positive,
        default=120,
        metavar="SECONDS",
        help="give up a Dask cluster that has had no worker for so long (default: 120)",
    )


def add_tune_options(tune: argparse.ArgumentParser) -> None:
    """Adds them to the command."""
    tune.add_argument("--out", type=Path, required=True, help="folder for the results")
    tune.add_argument("--jobs", type=_positive, default=1, help="agents at a time (default: 1)")
    tune.add_argument("--agent", nargs="+", default=[], metavar="NAME", help="these alone")
    tune.add_argument("--write", action="store_true", help="write better settings into configs/agents")


def command_of(options: argparse.Namespace) -> str:
    """The command that makes these results, into any folder and on any machine.

    A configuration of the repository is named from its root, any other one by its bare name.
    """
    config = options.config.resolve()
    inside = config.is_relative_to(REPOSITORY)
    name = config.relative_to(REPOSITORY).as_posix() if inside else config.name
    words = ["python", "-m", "experiments", "run", name, "--out", "DIR"]
    return shlex.join([*words, *(word for value in options.set for word in ("--set", value))])


def executor_of(options: argparse.Namespace) -> Executor:
    """The machines that the user asks for.

    Raises:
        ConfigError: They cannot be reached, or a package for them is missing.
    """
    if options.slurm_option and not options.slurm:
        raise ConfigError("--slurm-option: found without --slurm")
    try:
        if options.cluster:
            from experiments.execution.dask_cluster import DaskCluster

            return DaskCluster(options.cluster, options.cluster_patience)
        if options.slurm:
            from experiments.execution.slurm import Slurm, parse_options

            return Slurm(options.out / ".submitit", parse_options(options.slurm_option))
    except ModuleNotFoundError as error:
        where = "--slurm" if options.slurm else "--cluster"
        raise ConfigError(
            f"{where} needs {error.name}, which is not installed: {to_install('cluster')}"
        ) from None
    from experiments.execution.local import Local

    return Local(options.jobs)


def _part(text: str) -> Part:
    try:
        return Part.parse(text)
    except ConfigError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _count(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"found {text!r}; must be a whole number, 0 or more")
    return int(text)


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"found {text!r}; must be a whole number, 1 or more")
    return int(text)
