"""Saved classical agents: one .npz of plain arrays with a JSON header, never a pickle."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from .checks import check_number

_HEADER = "calfree.json"
_VERSION = 1


def save(path: str | Path, kind: str, arrays: Mapping[str, NDArray[Any]], motions: int, motors: int) -> None:
    """Writes what an agent knows, its motions and motors, and `kind`: what it is, settings and all."""
    header = json.dumps({"calfree": _VERSION, "kind": kind, "num_timesteps": motions, "motors": motors})
    with whole(path) as file:
        np.savez_compressed(file, **{_HEADER: np.array(header)}, **arrays)  # type: ignore[arg-type]


@contextmanager
def whole(path: str | Path) -> Iterator[BinaryIO]:
    """A file to write, which takes its place when all is written: an error leaves what stands there."""
    place = Path(path)
    partial = place.with_name(f"{place.name}.partial")
    try:
        with partial.open("wb") as file:
            yield file
        partial.replace(place)
    finally:
        partial.unlink(missing_ok=True)


def load(
    path: str | Path, kind: str, motors: int, present_kind: Callable[[str], str] = lambda saved: saved
) -> tuple[dict[str, NDArray[Any]], int]:
    """Reads the arrays and the number of motions that `save` wrote for an agent of the same `kind`.

    Args:
        path: The file.
        kind: What this agent is, with all settings.
        motors: Of this agent; a file of an earlier version does not tell its own.
        present_kind: From what a file of an earlier version calls itself to what that is called now; such a
            file loads with a warning.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is damaged, no saved agent, of another kind or other settings, or of an arm of
            other motors; says which.
    """
    try:
        with np.load(Path(path), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
            header = json.loads(str(arrays.pop(_HEADER)))
            motions = check_number("num_timesteps", header["num_timesteps"], least=0, whole=True)
            if not isinstance(header["kind"], str):
                raise ValueError(f"kind is {header['kind']!r}")
    except FileNotFoundError:
        raise FileNotFoundError(f"{path}: there is no such file") from None
    except Exception as error:  # what NumPy raises on a damaged file depends on where the damage is
        raise ValueError(
            f"{path} is damaged or no saved agent; allowed: a file that save of such an agent wrote, {kind}"
        ) from error
    if header.get("calfree") != _VERSION or kind not in (header["kind"], present_kind(header["kind"])):
        raise ValueError(
            f"{path} holds {header['kind']} (version {header.get('calfree')}); "
            f"this agent is {kind} (version {_VERSION})"
        )
    if (saved := header.get("motors", motors)) != motors:
        raise ValueError(f"{path} was saved for {saved} motors; this agent's environment has {motors}")
    if header["kind"] != kind:
        warnings.warn(f"{path} names {header['kind']}, which is now {kind}", stacklevel=3)
    return arrays, motions


def prefixed(prefix: str, arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Arrays under the names prefix/name, beside which others can stand."""
    return {f"{prefix}/{name}": array for name, array in arrays.items()}


def under(prefix: str, arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Those that `prefixed` put under a prefix, by their own names; empty where there are none."""
    start = f"{prefix}/"
    return {name.removeprefix(start): array for name, array in arrays.items() if name.startswith(start)}


def with_present_names(
    arrays: Mapping[str, NDArray[Any]], earlier: Mapping[str, str]
) -> Mapping[str, NDArray[Any]]:
    """Arrays under the names that they have now; warns of those that had another.

    Args:
        arrays: As they were saved; of prefix/name only the prefix may have changed.
        earlier: From names in files of earlier versions to those of today.
    """
    found = {name.split("/")[0] for name in arrays} & earlier.keys()
    if not found:
        return arrays
    names = ", ".join(f"{name} (now {earlier[name]})" for name in sorted(found))
    warnings.warn(f"read under the names of an earlier version: {names}", stacklevel=3)
    renamed = {}
    for name, array in arrays.items():
        first, *rest = name.split("/")
        renamed["/".join([earlier.get(first, first), *rest])] = array
    return renamed
