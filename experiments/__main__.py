"""The command line: `python -m experiments {validate,run,status,report,tune,...} ...`."""

import argparse
import sys
from importlib import import_module

from experiments.errors import ConfigError

COMMANDS = {
    "validate": ("execution.commands", "check a configuration"),
    "run": ("execution.commands", "carry out a configuration, and report"),
    "status": ("execution.commands", "show how far the runs in a results folder are"),
    "tune": ("tuning.command", "seek better settings of agents, as a configuration says"),
    "film": ("film.command", "film an agent at work, as MP4 and GIF"),
    "film-knocked": ("fetch_reach.film", "film two policies in FetchReach, whose camera is turned"),
    "report": ("reporting.commands", "write the report of results again"),
    "keep": ("reporting.commands", "copy what was measured into experiments/results, with a report"),
    "results-tables": ("reporting.commands", "make the tables of README.md and docs/ anew"),
    "picture": ("reporting.commands", "draw what a saved grid_table has learned"),
    "check-arm": ("arm_check", "show what comes of an arm's MJCF, and draw it"),
    "benchmark": ("studies", "measure speed, and what the agents reach"),
}
"""Each in its module, whose `add_...` adds its options, and what it does; no other module is loaded."""
GONE = {
    "merge": "copy all folders of PART/runs into DIR/runs, then `run CONFIG --out DIR` makes what is missing"
}
"""Commands that there were, and what to use instead."""


def main(arguments: list[str] | None = None) -> int:
    """Does what the command line says.

    Returns:
        0 where all went well, 1 where runs failed, 2 where the user's input cannot be used.
    """
    given = sys.argv[1:] if arguments is None else arguments
    options = _parser(*given[:1]).parse_args(given)
    try:
        _check_out(options)
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


def _parser(chosen: str = "") -> argparse.ArgumentParser:
    """Knows all commands, and the options of the chosen one."""
    parser = argparse.ArgumentParser(prog="python -m experiments", description=__doc__)
    if chosen in GONE:
        parser.error(f"{chosen} is no command any more: {GONE[chosen]}")
    commands = parser.add_subparsers(dest="command", required=True)
    for name, (module, what) in COMMANDS.items():
        command = commands.add_parser(name, help=what)
        if name == chosen:
            add = getattr(import_module(f"experiments.{module}"), f"add_{name.replace('-', '_')}")
            add(command)
    return parser


def _check_out(options: argparse.Namespace) -> None:
    """Raises ConfigError where a command would not find what it needs to write its results."""
    out = getattr(options, "out", None)
    if options.command in ("run", "tune", "film", "report") and out and out.exists() and not out.is_dir():
        raise ConfigError(f"--out: {out} is a file; allowed: a folder, which need not be there yet")
    if options.command in ("benchmark", "film-knocked") and out is not None and out.is_dir():
        raise ConfigError(f"--out: {out} is a folder; allowed: a file, which need not be there yet")


if __name__ == "__main__":
    sys.exit(main())
