"""What stands beside a finished suite's report, as it is read: `results.parquet` and `timings.csv`."""

import base64
import json
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from experiments.errors import ConfigError

RESULTS, TIMES = "results.parquet", "timings.csv"
TIMED = ("run", "wall_seconds", "decision", "learning")
"""Columns of `timings.csv`: seconds of each finished run, one a row."""
METADATA = "calfree"
"""Under this key stands, packed, all that a report needs beside the rows."""
VERSION = 1
OTHER = "it was made by other code; make its report with that code"

Found = TypeVar("Found")


def opened(read: Callable[[Path], Found], results: Path) -> Found:
    """What `read` reads of a Parquet file.

    Raises:
        ConfigError: There is no such file, or it is damaged.
    """
    try:
        return read(results)
    except FileNotFoundError:
        raise ConfigError(f"{results}: there is no such file") from None
    except (OSError, pa.ArrowException) as error:
        raise ConfigError(f"{results} is damaged, or no Parquet file: {error}") from None


def packed(about: dict[str, Any]) -> str:
    """Metadata as they are written: Parquet does not compress them."""
    return base64.b64encode(zlib.compress(json.dumps(about).encode(), 9)).decode()


def read_about(results: Path) -> dict[str, Any]:
    """What a Parquet file says of its suite.

    Raises:
        ConfigError: There is no such file, it is damaged, or it was made by other code.
    """
    metadata: dict[bytes, bytes] = opened(pq.read_metadata, results).metadata or {}
    if METADATA.encode() not in metadata:
        raise ConfigError(f"{results} says nothing of a suite: {OTHER}")
    try:
        about: dict[str, Any] = json.loads(zlib.decompress(base64.b64decode(metadata[METADATA.encode()])))
    except (ValueError, zlib.error) as error:
        raise ConfigError(f"{results} is damaged in what it says of its suite: {error}") from None
    if (version := about.get("version")) != VERSION:
        raise ConfigError(f"{results} has form {version}; known is form {VERSION}: {OTHER}")
    return about


def read_times(path: Path) -> pd.DataFrame:
    """Seconds of finished runs, if they are known.

    Raises:
        ConfigError: The file is damaged.
    """
    if not path.exists():
        return pd.DataFrame(columns=TIMED)
    try:
        return pd.read_csv(
            path, usecols=TIMED, dtype={name: str if name == "run" else float for name in TIMED}
        )
    except ValueError as error:
        raise ConfigError(
            f"{path} is damaged ({error}): delete it, or make it anew by `report` of the results folder"
        ) from None
