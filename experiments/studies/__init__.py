"""Studies that no suite can be: `python -m experiments benchmark NAME`.

Each module here is a study of its name, and has `tables()`, which yields tables as they are measured. One
with `figure(tables)` has a figure of them, too.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from calfree_gym.errors import near_misses
from experiments.errors import ConfigError
from experiments.options import Parser
from experiments.reporting.tables import Table, show
from experiments.running.results_folder import made_folder, write_whole
from experiments.running.versions import commit, versions

SHARED = "common"
"""The one module that is no study."""
MOVED = {
    **dict.fromkeys(("servo", "controllers", "models"), "run configs/first-trials.yaml --out FOLDER"),
    "robust": "run configs/bad-observations.yaml --out FOLDER",
    "table": "run configs/re-aimed-table.yaml --out FOLDER",
    "sac": "run configs/sac.yaml --out FOLDER",
    "first_grasps": "run configs/first-grasps.yaml --out FOLDER",
    "arms": "run configs/other-arms.yaml --out FOLDER",
    "grasping": "benchmark speed",
    "knowledge": "run configs/paper.yaml --out FOLDER",
}
"""Commands that measure what studies of these names did."""


def names() -> tuple[str, ...]:
    """Of all studies."""
    return tuple(module.name for module in iter_modules(__path__) if module.name != SHARED)


def check_names(found: Sequence[str]) -> None:
    """Raises ConfigError where one of these is no study; says where it went, or what there is."""
    for name in found:
        if name in MOVED:
            raise ConfigError(f"{name} is now: python -m experiments {MOVED[name]}")
        if name not in (known := names()):
            raise ConfigError(f"no study {name!r}{near_misses(name, known)}; allowed: {', '.join(known)}")


def add_benchmark(parser: Parser) -> None:
    """Makes some studies."""
    help_ = f"of {', '.join(names())} (default: speed)"
    parser.add_argument("studies", nargs="*", default=["speed"], metavar="STUDY", help=help_)
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--markdown", action="store_true", help="print Markdown tables on a terminal, too")
    form.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--out", type=Path, metavar="FILE.json", help="write the same JSON to a file")
    parser.add_argument(
        "--peer",
        action="append",
        default=[],
        metavar="PYTHON=ENV_ID",
        help="time a Gymnasium environment of another interpreter beside ours (repeatable)",
    )
    parser.set_defaults(does=_benchmark)


def _benchmark(options: argparse.Namespace) -> int:
    check_names(options.studies)
    if options.peer and "speed" not in options.studies:
        raise ConfigError(f"--peer is timed by speed, which is none of {', '.join(options.studies)}")
    if options.out:
        made_folder(options.out.parent)
    code = {"commit": commit(), "versions": versions()}  # before: files may change while it is measured
    by_study = {name: measure(name, options) for name in options.studies}
    tables = [table.to_dict() for of_study in by_study.values() for table in of_study]
    measured = {**code, "tables": tables}
    text = json.dumps(measured, indent=2, default=lambda number: number.item())
    if options.json:
        print(text)
    if options.out:
        write_whole(options.out, text)
        _draw(by_study, options.out)
    return 0


def _draw(by_study: Mapping[str, Sequence[Table]], out: Path) -> None:
    """Writes the figure of each study that has one: beside a study's own FILE.json as FILE.png."""
    for name, tables in by_study.items():
        study = import_module(f"{__name__}.{name}")
        if hasattr(study, "figure"):
            target = out.with_suffix(".png") if len(by_study) == 1 else out.with_name(f"{name}.png")
            study.figure(tables).savefig(target, dpi=160)


def measure(name: str, options: argparse.Namespace) -> list[Table]:
    """Makes a study; each table is shown as soon as it is there, unless JSON is asked for."""
    study = import_module(f"{__name__}.{name}")
    if not hasattr(study, "tables"):
        raise ConfigError(f"{name} is no study: it has no function tables(), which yields its tables")
    found = []
    for table in study.tables(options.peer) if name == "speed" else study.tables():
        if not options.json:
            show([table], options.markdown)
        found.append(table)
    return found
