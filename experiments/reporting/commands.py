"""`python -m experiments {report,keep,results-tables,picture}`: what is shown of results."""

import argparse
from pathlib import Path

from experiments.options import Parser


def add_report(parser: Parser) -> None:
    """Writes a report again."""
    parser.add_argument("source", type=Path, help="results folder, or the results.parquet of one")
    parser.add_argument("--out", type=Path, help="folder for the report (default: where the results stand)")
    parser.set_defaults(does=_report)


def _report(options: argparse.Namespace) -> int:
    from experiments.reporting.report import report

    print(f"report: {report(options.source, options.out)}")
    return 0


def add_keep(parser: Parser) -> None:
    """Keeps what was measured."""
    parser.add_argument("source", type=Path, help="results folder of a suite, or a benchmark's FILE.json")
    parser.set_defaults(does=_keep)


def _keep(options: argparse.Namespace) -> int:
    from experiments.reporting.documents import benchmark_report, keep, kept_tables

    does = benchmark_report.keep_benchmark if options.source.suffix == ".json" else keep.keep
    print(f"kept: {does(options.source, kept_tables.KEPT)}")
    return 0


def add_results_tables(parser: Parser) -> None:
    """Makes the tables of documents anew."""
    parser.add_argument("--check", action="store_true", help="change nothing; end with 1 where any differs")
    parser.set_defaults(does=_results_tables)


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


def add_picture(parser: Parser) -> None:
    """Draws a table."""
    parser.add_argument("table", type=Path, help="file that grid_table.save wrote")
    parser.add_argument("--out", type=Path, required=True, help="image file, such as table.png")
    parser.set_defaults(does=_picture)


def _picture(options: argparse.Namespace) -> int:
    from experiments.reporting.picture import draw_table

    draw_table(options.table, options.out)
    print(f"picture: {options.out}")
    return 0
