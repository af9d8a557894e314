"""Options that several commands have."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

Parser = argparse.ArgumentParser


def add_config(parser: Parser) -> None:
    """Adds the configuration, and values in place of its own."""
    parser.add_argument("config", type=Path)
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="replace a value of the configuration, such as scenarios.0.motions=200 (repeatable)",
    )


def add_import(parser: Parser) -> None:
    """Adds the modules that a configuration may have imported."""
    parser.add_argument(
        "--import",
        action="append",
        default=[],
        dest="modules",
        metavar="MODULE",
        help="trust agents of a module of yours, or of a package of modules (repeatable)",
    )


def whole(least: int) -> Callable[[str], int]:
    """A type of options: whole numbers from `least` on."""

    def read(text: str) -> int:
        if not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f"found {text!r}; must be a whole number, {least} or more")
        return int(text)

    return read


def add_gone(parser: Parser, option: str, instead: str) -> None:
    """Adds an option that there was once: it says what to use instead."""

    class Gone(argparse.Action):
        def __call__(self, parser: Parser, *_: Any) -> None:
            parser.error(f"{option} is no option any more: {instead}")

    parser.add_argument(option, nargs="?", action=Gone, help=argparse.SUPPRESS)
