"""The command line: `python -m experiments {validate,run,report,benchmark} ...`."""

import argparse
import shlex
import sys
from pathlib import Path

from experiments.loading import ConfigError, load
from experiments.plan import runs_of

BENCHMARKS = ("speed", "servo", "table", "sac")


def main(arguments: list[str] | None = None) -> int:
    """Does what the command line says.

    Returns:
        0 where all went well, 1 where runs failed, 2 where the user's input cannot be used.
    """
    options = _parser().parse_args(arguments)
    try:
        if options.command == "validate":
            return _validate(options.config)
        if options.command == "run":
            return _run(options.config, options.out, options.jobs)
        if options.command == "benchmark":
            return _benchmark(options.parts)
        return _report(options.folder)
    except ConfigError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted; started again, finished runs are skipped", file=sys.stderr)
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m experiments", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    validate = commands.add_parser("validate", help="check a configuration")
    validate.add_argument("config", type=Path)
    run = commands.add_parser("run", help="carry out a configuration, and report")
    run.add_argument("config", type=Path)
    run.add_argument("--out", type=Path, required=True, help="folder for the results")
    run.add_argument("--jobs", type=_positive, default=1, help="runs at a time (default: 1)")
    report = commands.add_parser("report", help="write the report of a results folder again")
    report.add_argument("folder", type=Path)
    benchmark = commands.add_parser("benchmark", help="measure speed, and what the agents reach")
    benchmark.add_argument(
        "parts",
        nargs="*",
        choices=BENCHMARKS,
        default="speed",
        metavar="PART",
        help=f"of {', '.join(BENCHMARKS)} (default: speed)",
    )
    return parser


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"found {text!r}; must be a whole number, 1 or more")
    return int(text)


def _validate(config: Path) -> int:
    suite = load(config)
    motions = sum(spec.scenario.motions for spec in runs_of(suite))
    print(
        f"{config}: valid: {len(suite.agents)} agents × {len(suite.scenarios)} scenarios × "
        f"{suite.worlds} worlds = {len(runs_of(suite))} runs, {motions:,} motions"
    )
    return 0


def _run(config: Path, out: Path, jobs: int) -> int:
    suite = load(config)
    from experiments.progress import display
    from experiments.runner import Runner

    words = ["python", "-m", "experiments", "run", str(config), "--out", str(out)]
    with display() as shown:
        failed = Runner(suite, out, shown).run(jobs, shlex.join([*words, "--jobs", str(jobs)]))
    _report(out)
    if failed:
        print(f"{len(failed)} runs FAILED: {', '.join(failed)}", file=sys.stderr)
        return 1
    return 0


def _report(folder: Path) -> int:
    from experiments.report import write_report

    print(f"report: {write_report(folder)}")
    return 0


def _benchmark(parts: list[str] | str) -> int:
    from experiments import reaching
    from experiments.speed import speed

    measures = {"speed": speed, "servo": reaching.servo, "table": reaching.table, "sac": reaching.sac}
    for part in [parts] if isinstance(parts, str) else parts:
        print(measures[part](), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
