"""Saved learners: a zip of a JSON header and tensors, which reading never unpickles."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile, ZipFile

import torch

_HEADER, _PARAMETERS = "calfree.json", "parameters.pt"
_VERSION = 1
_FOREIGN_HEADER, _VARIABLES = "data", "pytorch_variables.pth"


class Saved(NamedTuple):
    """What a file holds.

    Attributes:
        about: What the learner is; None of a file that stable-baselines3 itself has written.
        motions: That it has made.
        updates: Of its networks.
        parameters: State dicts by name, as `BaseAlgorithm.get_parameters` gives them.
        variables: Single tensors by name, such as the logarithm of SAC's entropy coefficient.
    """

    about: dict[str, Any] | None
    motions: int
    updates: int
    parameters: dict[str, Any]
    variables: dict[str, torch.Tensor]


def write(path: str | Path, saved: Saved) -> None:
    """Writes a file that `read` reads."""
    header = {"calfree": _VERSION, **saved._asdict()}
    tensors = io.BytesIO()
    torch.save({name: header.pop(name) for name in ("parameters", "variables")}, tensors)
    with ZipFile(path, "w") as archive:
        archive.writestr(_HEADER, json.dumps(header, indent=1))
        archive.writestr(_PARAMETERS, tensors.getvalue())


def read(path: str | Path, trusted: bool = False) -> Saved:
    """Reads what `write` or stable-baselines3 wrote. Of the latter's file only tensors and counts are read.

    Args:
        path: The file.
        trusted: Whether tensors may be unpickled, which executes what the file says.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It is damaged, no saved learner, or needs unpickling and is not trusted.
    """
    try:
        with ZipFile(path) as archive:
            entries = {name: archive.read(name) for name in archive.namelist()}
    except FileNotFoundError:
        raise
    except (BadZipFile, OSError, NotImplementedError, RuntimeError) as error:
        raise ValueError(f"{path} is damaged or no saved learner: {error!r}") from error
    header = _header(path, entries)
    found = {
        name: _tensors(path, name, content, trusted)
        for name, content in entries.items()
        if name.endswith((".pt", ".pth"))
    }
    if _PARAMETERS in found:
        about = header["about"]
        motions, updates = header["motions"], header["updates"]
        parameters, variables = (found[_PARAMETERS].get(name) for name in ("parameters", "variables"))
    else:
        about = None
        motions, updates = header.get("num_timesteps", 0), header.get("_n_updates", 0)
        variables = found.pop(_VARIABLES, None) or {}
        parameters = {name.removesuffix(".pth"): tensors for name, tensors in found.items()}
    saved = Saved(about, motions, updates, parameters, variables)
    for name, kind in (("motions", int), ("updates", int), ("parameters", dict), ("variables", dict)):
        if not isinstance(getattr(saved, name), kind):
            raise ValueError(f"{path} is damaged: its {name} are no {kind.__name__}")
    return saved


def _header(path: str | Path, entries: Mapping[str, bytes]) -> dict[str, Any]:
    """The JSON header: ours, or stable-baselines3's, whose pickles stay the texts that they are in JSON."""
    ours = _HEADER in entries and _PARAMETERS in entries
    if not ours and not {_FOREIGN_HEADER, "policy.pth"} <= entries.keys():
        raise ValueError(
            f"{path} holds {', '.join(sorted(entries)) or 'nothing'}; a saved learner holds {_HEADER} and "
            f"{_PARAMETERS}, or, of stable-baselines3, {_FOREIGN_HEADER} and policy.pth"
        )
    try:
        header = json.loads(entries[_HEADER if ours else _FOREIGN_HEADER])
        if ours and header["calfree"] != _VERSION:
            raise ValueError(f"its version is {header['calfree']}, this code reads {_VERSION}")
        if ours and not {"about", "motions", "updates"} <= header.keys():
            raise ValueError(f"{_HEADER} holds {', '.join(header)}")
        return {**header}
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise ValueError(f"{path} is damaged: {error!r}") from error


def _tensors(path: str | Path, name: str, content: bytes, trusted: bool) -> Any:
    try:
        return {**torch.load(io.BytesIO(content), map_location="cpu", weights_only=not trusted)}
    except Exception as error:  # what torch raises on a damaged file depends on where the damage is
        hint = (
            "" if trusted else ", or would have to be unpickled: load(path, trusted=True) does, at your risk"
        )
        raise ValueError(f"{name} in {path} is damaged{hint}: {str(error).splitlines()[0]}") from error
