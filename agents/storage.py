"""Saved classical agents: one .npz of plain arrays with a JSON header, never a pickle."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_HEADER = "calfree.json"
_VERSION = 1


def save(path: str | Path, kind: str, arrays: Mapping[str, NDArray[Any]], motions: int) -> None:
    """Writes what an agent of `kind` knows, and how many motions it has made."""
    header = json.dumps({"calfree": _VERSION, "kind": kind, "num_timesteps": motions})
    with Path(path).open("wb") as file:
        np.savez_compressed(file, **{_HEADER: np.array(header)}, **arrays)  # type: ignore[arg-type]


def load(path: str | Path, kind: str) -> tuple[dict[str, NDArray[Any]], int]:
    """Reads the arrays and the number of motions that `save` wrote for an agent of `kind`.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is damaged, no saved agent, or of another kind; says which.
    """
    try:
        with np.load(Path(path), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except (ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
        if isinstance(error, FileNotFoundError):
            raise
        raise ValueError(f"{path} is damaged or no saved agent: {error}") from error
    if not isinstance(arrays, dict) or _HEADER not in arrays:
        raise ValueError(f"{path} is no saved agent: it has no header {_HEADER}")
    header = json.loads(str(arrays.pop(_HEADER)))
    if header["calfree"] != _VERSION or header["kind"] != kind:
        raise ValueError(
            f"{path} holds a {header['kind']} (version {header['calfree']}); "
            f"this agent loads a {kind} (version {_VERSION})"
        )
    return arrays, int(header["num_timesteps"])
