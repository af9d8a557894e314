"""`python -m experiments {validate,run,status}`: what is to be run, running it, and how far it is."""

import argparse
import shlex
import sys
from collections import Counter
from pathlib import Path

from calfree_gym.errors import to_install
from experiments.config.loading import load
from experiments.errors import ConfigError
from experiments.execution.pending import Machines, ThisMachine
from experiments.options import Parser, add_config, add_gone, add_import, whole
from experiments.running.run import runs_of
from experiments.running.versions import REPOSITORY


def add_validate(parser: Parser) -> None:
    """Checks a configuration."""
    add_config(parser)
    add_import(parser)
    parser.set_defaults(does=_validate)


def _validate(options: argparse.Namespace) -> int:
    suite = load(options.config, options.set, options.modules)
    parts = ((len(suite.agents), "agent"), (len(suite.scenarios), "scenario"), (len(suite.sweeps), "sweep"))
    counts = ", ".join(f"{n} {what}{'s' * (n > 1)}" for n, what in (*parts, (suite.worlds, "world")) if n)
    runs = runs_of(suite)
    work = Counter[str]()
    for run in runs:
        amount, of = run.work
        work[of] += amount
    todo = ", ".join(f"{amount:,} {of}" for of, amount in work.items())
    print(f"{options.config}: valid: {counts}: {len(runs)} runs, {todo}")
    return 0


def add_run(parser: Parser) -> None:
    """Makes what is not finished, then the report."""
    add_config(parser)
    add_import(parser)
    parser.add_argument("--out", type=Path, required=True, help="folder for the results")
    parser.add_argument("--fail-fast", action="store_true", help="stop at the first run that fails")
    parser.add_argument(
        "--retries",
        type=whole(0),
        default=2,
        metavar="N",
        help="how often a run is made again whose worker was lost (default: 2)",
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--jobs", type=whole(1), default=1, help="runs at a time, here (default: 1)")
    where.add_argument("--cluster", metavar="ADDRESS", help="make the runs on the Dask cluster there")
    parser.add_argument(
        "--cluster-patience",
        type=whole(1),
        default=120,
        metavar="SECONDS",
        help="give up a Dask cluster that has had no worker for so long (default: 120)",
    )
    for option in ("--slurm", "--slurm-option"):
        add_gone(parser, option, "let Slurm start Dask's workers, and give --cluster (docs/configuration.md)")
    add_gone(parser, "--part", "--cluster shares runs out; or --set agents=..., and copy the runs together")
    parser.set_defaults(does=_run)


def _run(options: argparse.Namespace) -> int:
    suite = load(options.config, options.set, options.modules)
    from experiments.execution.progress import display
    from experiments.execution.runner import Runner

    machines = machines_of(options)
    with display() as shown:
        runner = Runner(
            suite,
            options.out,
            machines,
            shown,
            retries=options.retries,
            fail_fast=options.fail_fast,
            at_once=None if options.cluster else options.jobs,
        )
        failed = runner.run(command_of(options))
    from experiments.reporting.report import report

    print(f"report: {report(options.out, options.out)}")
    if failed:
        print(f"{len(failed)} runs FAILED or did not finish: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


def command_of(options: argparse.Namespace) -> str:
    """The command that makes these results, into any folder and on any machine.

    A configuration of the repository is named from its root, any other one by its bare name.
    """
    config = options.config.resolve()
    inside = config.is_relative_to(REPOSITORY)
    name = config.relative_to(REPOSITORY).as_posix() if inside else config.name
    words = ["python", "-m", "experiments", "run", name, "--out", "DIR"]
    given = [("--set", value) for value in options.set] + [("--import", name) for name in options.modules]
    return shlex.join([*words, *(word for option in given for word in option)])


def machines_of(options: argparse.Namespace) -> Machines:
    """The machines that the user asks for."""
    if not options.cluster:
        return ThisMachine(options.jobs)
    try:
        from experiments.execution.dask_cluster import DaskCluster
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"--cluster needs {error.name}, which is not installed: {to_install('cluster')}"
        ) from None
    return DaskCluster(options.cluster, options.cluster_patience)


def add_status(parser: Parser) -> None:
    """Tells how far the runs in a folder are."""
    parser.add_argument("folder", type=Path)
    parser.set_defaults(does=_status)


def _status(options: argparse.Namespace) -> int:
    from experiments.execution.progress import status
    from experiments.reporting.tables import Table, show

    found = status(options.folder)
    show([Table("status", str(options.folder), found.runs, note=f"{found.counts}\nmade by: {found.command}")])
    return 1 if found.failed else 0
