"""Saved classical agents: one .npz of plain arrays with a JSON header, never a pickle."""

import json
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from io import BytesIO
from os import PathLike
from os.path import realpath
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from calfree_gym.files import check_size, whole

from .checks import check_number

AgentFile = str | PathLike[str] | BinaryIO
"""Where an agent is saved: a path, whose folder is made, or an open binary file."""
_HEADER = "calfree.json"
_VERSION = 1


def save(file: AgentFile, kind: str, arrays: Mapping[str, NDArray[Any]], motions: int, motors: int) -> None:
    """Writes what an agent knows, its motions and motors, and `kind`: what it is, settings and all.

    Raises:
        TypeError: The file is neither a path nor a binary file; or an array holds objects, such as whole
            numbers beyond 64 bits, which would have to be pickled.
    """
    for name, array in arrays.items():
        if array.dtype.hasobject:
            raise TypeError(f"{name} is {array!r:.80}; allowed: an array of plain numbers or text")
    header = json.dumps({"calfree": _VERSION, "kind": kind, "num_timesteps": motions, "motors": motors})
    with written(file) as place:
        np.savez_compressed(place, **{_HEADER: np.array(header)}, **arrays)  # type: ignore[arg-type]


@contextmanager
def written(file: AgentFile) -> Iterator[BinaryIO]:
    """Where an agent's file is written: it, or what its path leads to, is as before after an error.

    Raises:
        TypeError: It is neither a path nor a binary file.
    """
    if isinstance(file, str | PathLike):
        Path(file).parent.mkdir(parents=True, exist_ok=True)
        with whole(realpath(file)) as place:
            yield place
    else:
        _check_open(file, "write", b"")
        buffer = BytesIO()
        yield buffer
        file.write(buffer.getvalue())


def content(file: AgentFile) -> bytes:
    """What stands in a file; of an open one, from where it stands on, or all where that is its end.

    Raises:
        FileNotFoundError: There is no such file.
        TypeError: It is neither a path nor a binary file.
    """
    if isinstance(file, str | PathLike):
        try:
            return Path(file).read_bytes()
        except (FileNotFoundError, ValueError):  # of a name that no file can have
            raise FileNotFoundError(f"{file}: there is no such file") from None
    _check_open(file, "read", 0)
    found = file.read()
    if not found and file.seekable():
        file.seek(0)
        found = file.read()
    return found


def _check_open(file: BinaryIO, use: str, nothing: bytes | int) -> None:
    """Raises TypeError where it is no binary file that can be put to use: tried with nothing."""
    try:
        is_binary = getattr(file, use)(nothing) in (b"", 0, None)
    except (AttributeError, TypeError, OSError, ValueError):
        is_binary = False
    if not is_binary:
        raise TypeError(f"found {file!r}; allowed: a path, or a binary file that is open to {use}")


def load(
    file: AgentFile, kind: str, motors: int, present_kind: Callable[[str], str] = lambda saved: saved
) -> tuple[dict[str, NDArray[Any]], int]:
    """Reads the arrays and the number of motions that `save` wrote for an agent of the same `kind`.

    Args:
        file: Its path, or itself, open.
        kind: What this agent is, with all settings.
        motors: Of this agent; a file of an earlier version does not tell its own.
        present_kind: From what a file of an earlier version calls itself to what that is called now; such a
            file loads with a warning.

    Raises:
        FileNotFoundError: There is no such file.
        TypeError: It is neither a path nor a binary file.
        ValueError: The file is damaged, no saved agent, of another kind or other settings, or of an arm of
            other motors; says which.
    """
    found = content(file)
    try:
        with np.load(BytesIO(found), allow_pickle=False) as saved_arrays:
            check_size(saved_arrays.zip)
            arrays = {name: saved_arrays[name] for name in saved_arrays.files}
            header = json.loads(str(arrays.pop(_HEADER)))
            motions = check_number("num_timesteps", header["num_timesteps"], least=0, whole=True)
            if not isinstance(header["kind"], str):
                raise ValueError(f"kind is {header['kind']!r}")
    except Exception as error:  # what NumPy raises on a damaged file depends on where the damage is
        raise ValueError(
            f"{file} is damaged or no saved agent; allowed: a file that save of such an agent wrote, {kind}"
        ) from error
    if header.get("calfree") != _VERSION or kind not in (header["kind"], present_kind(header["kind"])):
        raise ValueError(
            f"{file} holds {header['kind']} (version {header.get('calfree')}); "
            f"this agent is {kind} (version {_VERSION})"
        )
    if (saved := header.get("motors", motors)) != motors:
        raise ValueError(f"{file} was saved for {saved} motors; this agent's environment has {motors}")
    if header["kind"] != kind:
        warnings.warn(f"{file} names {header['kind']}, which is now {kind}", stacklevel=3)
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
