"""The command line: `python -m experiments {validate,run,merge,status,report,tune,...} ...`."""

import argparse
import sys
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from experiments.config.loading import load
from experiments.errors import ConfigError
from experiments.execution.options import add_run_options, add_tune_options, command_of, executor_of
from experiments.execution.part import WHOLE
from experiments.running.plan import runs_of
from experiments.studies import check_names, names

FILL_FOLDERS = ("run", "tune", "film", "merge", "report")
"""Commands whose --out is a folder."""


def main(arguments: list[str] | None = None) -> int:
    """Does what the command line says.

    Returns:
        0 where all went well, 1 where runs failed, 2 where the user's input cannot be used.
    """
    options = _parser().parse_args(arguments)
    try:
        _check_folder(options)
        done: int = options.does(options)
        return done
    except ConfigError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except OSError as error:  # a full disk, a folder that cannot be written
        where = f": {error.filename}" if error.filename else ""
        print(f"error: {error.strerror}{where}; what has finished is kept", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted; started again, finished runs are skipped", file=sys.stderr)
        return 130


def _check_folder(options: argparse.Namespace) -> None:
    """Raises ConfigError where a command would not find what it needs to write its results."""
    out = getattr(options, "out", None)
    if options.command in FILL_FOLDERS and out is not None and out.exists() and not out.is_dir():
        raise ConfigError(f"--out: {out} is a file; allowed: a folder, which need not be there yet")
    if options.command == "benchmark" and out is not None and out.is_dir():
        raise ConfigError(f"--out: {out} is a folder; allowed: a file, which need not be there yet")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m experiments", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    validate = commands.add_parser("validate", help="check a configuration")
    run = commands.add_parser("run", help="carry out a configuration, and report")
    tune = commands.add_parser("tune", help="seek better settings of agents, as a configuration says")
    film = commands.add_parser("film", help="film an agent at work, as MP4 and GIF")
    for command in (validate, run, tune, film):
        command.add_argument("config", type=Path)
        command.add_argument(
            "--set",
            action="append",
            default=[],
            metavar="KEY=VALUE",
            help="replace a value of the configuration, such as scenarios.0.motions=200 (repeatable)",
        )
    add_run_options(run)
    add_tune_options(tune)
    validate.set_defaults(does=_validate)
    run.set_defaults(does=_run)
    tune.set_defaults(does=_tune)
    film.add_argument("--out", type=Path, required=True, help="folder for film.mp4, film.gif and film.png")
    film.set_defaults(does=_film)
    merge = commands.add_parser("merge", help="gather the parts of a suite (run --part), and report")
    merge.add_argument("parts", type=Path, nargs="+", metavar="PART", help="results folder of a part")
    merge.add_argument("--out", type=Path, required=True, help="folder for the whole")
    merge.set_defaults(does=_merge)
    status = commands.add_parser("status", help="show how far the runs in a results folder are")
    status.add_argument("folder", type=Path)
    status.set_defaults(does=_status)
    report = commands.add_parser("report", help="write the report of results again")
    report.add_argument("source", type=Path, help="results folder, or the results.parquet of one")
    report.add_argument("--out", type=Path, help="folder for the report (default: where the results stand)")
    report.set_defaults(does=lambda options: _report(options.source, options.out))
    keep = commands.add_parser("keep", help="copy what was measured into experiments/results, with a report")
    keep.add_argument("source", type=Path, help="results folder of a suite, or a benchmark's FILE.json")
    keep.set_defaults(does=_keep)
    _add_benchmark(commands)
    picture = commands.add_parser("picture", help="draw what a saved grid_table has learned")
    picture.add_argument("table", type=Path, help="file that grid_table.save wrote")
    picture.add_argument("--out", type=Path, required=True, help="image file, such as table.png")
    picture.set_defaults(does=_picture)
    _add_check_arm(commands)
    tables = commands.add_parser("results-tables", help="make the tables of README.md and docs/ anew")
    tables.add_argument("--check", action="store_true", help="change nothing; end with 1 where any differs")
    tables.set_defaults(does=_results_tables)
    return parser


def _add_benchmark(commands: Any) -> None:
    benchmark = commands.add_parser("benchmark", help="measure speed, and what the agents reach")
    benchmark.add_argument(
        "studies",
        nargs="*",
        default=["speed"],
        metavar="STUDY",
        help=f"of {', '.join(names())} (default: speed)",
    )
    form = benchmark.add_mutually_exclusive_group()
    form.add_argument("--markdown", action="store_true", help="print Markdown tables on a terminal, too")
    form.add_argument("--json", action="store_true", help="print JSON")
    benchmark.add_argument("--out", type=Path, metavar="FILE.json", help="write the same JSON to a file")
    benchmark.add_argument(
        "--peer",
        action="append",
        default=[],
        metavar="PYTHON=ENV_ID",
        help="time a Gymnasium environment of another interpreter beside ours (repeatable)",
    )
    benchmark.set_defaults(does=_benchmark)


def _add_check_arm(commands: Any) -> None:
    check = commands.add_parser("check-arm", help="show what comes of an arm's MJCF, and draw it")
    check.add_argument("model", metavar="FILE", help="MJCF or URDF file")
    check.add_argument("--gripper", required=True, metavar="NAME", help="site or body")
    check.add_argument("--motors", nargs="+", metavar="JOINT", help="default: all from base to gripper")
    home = check.add_mutually_exclusive_group()
    home.add_argument("--home", metavar="KEY", help="keyframe (default: derived)")
    home.add_argument(
        "--home-degrees", nargs="+", type=_joint_at, metavar="JOINT=DEGREES", help="hinges at home"
    )
    check.add_argument("--base", metavar="BODY", help="where the chain starts (default: below the world)")
    check.add_argument(
        "--camera-mount",
        nargs="+",
        default=["waist"],
        metavar="MOUNT",
        help="waist, stand or a body; two of these for left and right (default: waist)",
    )
    check.add_argument("--out", type=Path, metavar="PICTURE", help="image file, such as arm.png")
    check.set_defaults(does=_check_arm)


def _joint_at(text: str) -> tuple[str, float]:
    joint, _, degrees = text.rpartition("=")
    if not joint:
        raise argparse.ArgumentTypeError(f"found {text!r}; allowed: such as elbow=-30")
    try:
        return joint, float(degrees)
    except ValueError:
        raise argparse.ArgumentTypeError(f"found {text!r}: {degrees!r} is no number of degrees") from None


def _validate(options: argparse.Namespace) -> int:
    suite = load(options.config, options.set)
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


def _run(options: argparse.Namespace) -> int:
    suite = load(options.config, options.set)
    from experiments.execution.progress.display import display
    from experiments.execution.runner import Runner

    executor = executor_of(options)
    with display() as shown:
        runner = Runner(
            suite,
            options.out,
            executor,
            shown,
            retries=options.retries,
            fail_fast=options.fail_fast,
            part=options.part,
            at_once=None if options.cluster or options.slurm else options.jobs,
        )
        failed = runner.run(command_of(options))
    if options.part == WHOLE:
        _report(options.out, options.out)
    else:
        print(f"part {options.part} is in {options.out}; `merge` makes the whole of all parts")
    return _unfinished(failed)


def _merge(options: argparse.Namespace) -> int:
    from experiments.execution.merge import merge

    missing = merge(options.parts, options.out)
    _report(options.out, options.out)
    return _unfinished(missing)


def _unfinished(runs: list[str]) -> int:
    if runs:
        print(f"{len(runs)} runs FAILED or did not finish: {', '.join(runs)}", file=sys.stderr)
    return 1 if runs else 0


def _tune(options: argparse.Namespace) -> int:
    from experiments.tuning.command import tune
    from experiments.tuning.loading import load_tuning

    config = load_tuning(options.config, options.set)
    failed = tune(config, options.out, options.agent, options.jobs, options.write)
    return 1 if failed else 0


def _film(options: argparse.Namespace) -> int:
    from experiments.film.command import film
    from experiments.film.config import load_film

    files, records = film(load_film(options.config, options.set), options.out)
    for record in records:
        ends = "rendezvous" if record.rendezvous else "no rendezvous"
        print(f"trial {record.trial + 1}: {ends} after {record.motions} motions, {record.error_px:.1f} px")
    size = files.gif.stat().st_size / 1e6
    print(f"film: {files.mp4}, {files.gif}, {files.png} ({files.seconds:.0f} s, GIF {size:.1f} MB)")
    return 0


def _status(options: argparse.Namespace) -> int:
    from experiments.execution.status import status
    from experiments.reporting.tables import Table, show

    found = status(options.folder)
    show([Table("status", str(options.folder), found.runs, note=f"{found.counts}\nmade by: {found.command}")])
    return 1 if found.failed else 0


def _keep(options: argparse.Namespace) -> int:
    from experiments.reporting.documents import benchmark_report, keep, kept_tables

    does = benchmark_report.keep_benchmark if options.source.suffix == ".json" else keep.keep
    print(f"kept: {does(options.source, kept_tables.KEPT)}")
    return 0


def _report(source: Path, out: Path | None) -> int:
    from experiments.reporting.report import report

    print(f"report: {report(source, out)}")
    return 0


def _picture(options: argparse.Namespace) -> int:
    from experiments.reporting.picture import draw_table

    draw_table(options.table, options.out)
    print(f"picture: {options.out}")
    return 0


def _check_arm(options: argparse.Namespace) -> int:
    from experiments.arm_check import ArmCheck
    from experiments.config.arms import as_arm
    from experiments.reporting.tables import show

    given = {name: getattr(options, name) for name in ("model", "gripper", "motors", "home", "base")}
    mount = options.camera_mount
    try:
        if options.out:
            ArmCheck.check_picture(options.out)
        if options.home_degrees:
            given["home_degrees"] = dict(options.home_degrees)
        check = ArmCheck(as_arm(given), mount[0] if len(mount) == 1 else tuple(mount))
    except ValueError as error:
        raise ConfigError(f"{error}") from None
    for table in check.tables():
        show([table])
    if options.out:
        check.picture(options.out)
        print(f"picture: {options.out}")
    for problem in check.problems:
        print(f"problem: {problem}", file=sys.stderr)
    return 1 if check.problems else 0


def _results_tables(options: argparse.Namespace) -> int:
    from experiments.reporting.documents.kept_tables import tables_named
    from experiments.reporting.documents.markers import outdated, pages
    from experiments.running.results_folder import write_whole

    changed = outdated(pages(), tables_named)
    for path, text in changed.items():
        print(f"{path}: {'differs from kept results' if options.check else 'tables made anew'}")
        if not options.check:
            write_whole(path, text)
    return 1 if options.check and changed else 0


def _benchmark(options: argparse.Namespace) -> int:
    from experiments.reporting.tables import Table, show
    from experiments.running.results_folder import made_folder, write_whole
    from experiments.studies import dumped, measure

    check_names(options.studies)
    if options.out:
        made_folder(options.out.parent)

    def shown(tables: Iterable[Table]) -> None:
        if not options.json:
            show(tables, options.markdown)

    found = dumped(measure(options.studies, options.peer, shown))
    if options.json:
        print(found)
    if options.out:
        write_whole(options.out, found)
    return 0


if __name__ == "__main__":
    sys.exit(main())
