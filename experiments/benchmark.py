"""`python -m experiments benchmark`: what is measured beside suites."""

import argparse
from collections.abc import Iterable
from pathlib import Path

from experiments.benchmarks.parts import PARTS, dumped, measure
from experiments.options import Parser
from experiments.reporting.tables import Table, show
from experiments.running.results_folder import made_folder, write_whole


def add_benchmark(parser: Parser) -> None:
    """Measures some parts."""
    names = ("speed", *PARTS)
    parser.add_argument(
        "parts",
        nargs="*",
        choices=names,
        default="speed",
        metavar="PART",
        help=f"of {', '.join(names)} (default: speed)",
    )
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
    if options.out:
        made_folder(options.out.parent)

    def shown(tables: Iterable[Table]) -> None:
        if not options.json:
            show(tables, options.markdown)

    parts = [options.parts] if isinstance(options.parts, str) else options.parts
    found = dumped(measure(parts, options.peer, shown))
    if options.json:
        print(found)
    if options.out:
        write_whole(options.out, found)
    return 0
