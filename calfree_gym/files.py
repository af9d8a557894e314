"""Files: written whole or not at all, and unzipped only where they say that they are of a sane size."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from secrets import token_hex
from typing import BinaryIO
from zipfile import ZipFile

MOST_BYTES = 2**30
"""Of a zip, unpacked. Choice: what agents know takes megabytes."""


@contextmanager
def whole(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """A file to write, which takes its place when all is written: an error leaves what stands there.

    Until then it has a name beside it that nobody can foresee, so that no link lies there.
    """
    place = Path(path)
    partial = place.with_name(f".{token_hex(8)}.partial")
    try:
        with partial.open("xb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        partial.replace(place)
    finally:
        partial.unlink(missing_ok=True)


def check_size(archive: ZipFile) -> None:
    """Raises ValueError where a zip has too many bytes unpacked; none is unpacked beyond what it declares."""
    size = sum(member.file_size for member in archive.infolist())
    if size > MOST_BYTES:
        raise ValueError(f"it has {size} bytes unpacked; allowed: {MOST_BYTES}")
