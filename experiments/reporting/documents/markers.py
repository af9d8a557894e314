"""Tables between markers in README.md and docs/: `<!-- table: NAME -->` ... `<!-- end of table -->`.

`<!-- table: NAME: COLUMN, COLUMN -->` shows these columns alone.
"""

import re
from collections.abc import Callable, Iterable
from pathlib import Path

from experiments.errors import ConfigError
from experiments.running.versions import REPOSITORY

_MARKER = re.compile(r"^<!-- (?:table: (?P<name>\S.*?)|(?P<end>end of table)) -->$", re.MULTILINE)


def pages() -> list[Path]:
    """README.md and the pages of docs/, of its folders too."""
    return [REPOSITORY / "README.md", *sorted((REPOSITORY / "docs").rglob("*.md"))]


def outdated(paths: Iterable[Path], table: Callable[[str], str]) -> dict[Path, str]:
    """The pages that differ from what the code makes, and what they should be.

    Args:
        paths: The pages.
        table: From a marker's name to the Markdown of its table.

    Raises:
        ConfigError: A marker is not closed, or there is no table of its name; says where.
    """
    found = {}
    for path in paths:
        text = path.read_text(encoding="utf-8")
        if (filled := _filled(path, text, table)) != text:
            found[path] = filled
    return found


def _filled(path: Path, text: str, table: Callable[[str], str]) -> str:
    """A page with all its tables made anew."""
    parts, position, opened = [], 0, None
    for marker in _MARKER.finditer(text):
        where = f"{path.name}, line {text.count(chr(10), 0, marker.start()) + 1}"
        if (marker["name"] is None) == (opened is None):
            raise ConfigError(f"{where}: {marker[0]} without its other half")
        if marker["name"] is None:
            opened, position = None, marker.start()
            continue
        opened = where
        try:
            made = table(marker["name"])
        except ConfigError as error:
            raise ConfigError(f"{where}: {error}") from None
        parts.append(f"{text[position : marker.end()]}\n\n{made}\n\n")
    if opened:
        raise ConfigError(f"{opened}: the table has no <!-- end of table -->")
    return "".join(parts) + text[position:]
