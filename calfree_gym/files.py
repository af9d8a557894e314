"""Files: written whole or not at all, and unzipped only where they say that they are of a sane size."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from secrets import token_hex
from stat import S_IMODE
from typing import BinaryIO
from zipfile import ZipFile

MOST_BYTES = 2**30
"""Of a zip, unpacked. Choice: what agents know takes megabytes."""


@contextmanager
def whole(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """A file to write, which takes its place and mode when all is written: an error leaves what stands there.

    Until then it has a name beside it that nobody can foresee, so that no link lies there. A link at its
    place gives way to it: to write where a link leads, give `os.path.realpath`.
    """
    place = Path(path)
    partial = place.with_name(f".{token_hex(8)}.partial")
    try:
        with partial.open("xb") as file:
            if place.is_file() and not place.is_symlink():
                partial.chmod(S_IMODE(place.stat().st_mode))
            yield file
            file.flush()
            os.fsync(file.fileno())
        partial.replace(place)
    except OSError as error:
        if error.filename == str(partial):
            error.filename = str(place)
        raise
    finally:
        partial.unlink(missing_ok=True)


def check_size(*archives: ZipFile) -> None:
    """Raises ValueError where zips have too many bytes unpacked; none is unpacked beyond what it declares."""
    size = sum(member.file_size for archive in archives for member in archive.infolist())
    if size > MOST_BYTES:
        raise ValueError(f"it has {size} bytes unpacked; allowed: {MOST_BYTES}")
