"""Saved learners: a zip of a JSON header and tensors, which reading never unpickles."""

import copy
import io
import json
from collections.abc import Mapping
from typing import Any, NamedTuple
from zipfile import ZipFile, is_zipfile

import torch
from torch.optim import Optimizer

from calfree_gym.files import check_size

from ...base.checks import check_number
from ...base.storage import AgentFile, content, written

_HEADER, _PARAMETERS = "calfree.json", "parameters.pt"
_VERSION = 1
_FOREIGN_HEADER, _VARIABLES = "data", "pytorch_variables.pth"
_PACKED = (".pt", ".pth")
"""How the names of tensors end, which are zips themselves."""
_READ = (_HEADER, _FOREIGN_HEADER, *_PACKED)
"""How the names of what is read end; the rest stays packed."""


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


def write(path: AgentFile, saved: Saved) -> None:
    """Writes a file that `read` reads."""
    header = {"calfree": _VERSION, **saved._asdict()}
    tensors = io.BytesIO()
    torch.save({name: header.pop(name) for name in ("parameters", "variables")}, tensors)
    with written(path) as file, ZipFile(file, "w") as archive:
        archive.writestr(_HEADER, json.dumps(header, indent=1))
        archive.writestr(_PARAMETERS, tensors.getvalue())


def read(path: AgentFile, trusted: bool = False) -> Saved:
    """Reads what `write` or stable-baselines3 wrote. Of the latter's file only tensors and counts are read.

    Args:
        path: Of the file, or it, open.
        trusted: Whether tensors may be unpickled, which executes what the file says.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It is damaged, no saved learner, or needs unpickling and is not trusted.
    """
    found_bytes = content(path)
    try:
        with ZipFile(io.BytesIO(found_bytes)) as archive:
            check_size(archive)
            names = archive.namelist()
            entries = {name: archive.read(name) for name in names if name.endswith(_READ)}
        packed = {name: io.BytesIO(entry) for name, entry in entries.items() if name.endswith(_PACKED)}
        check_size(*(ZipFile(tensors) for tensors in packed.values() if is_zipfile(tensors)))
    except Exception as error:  # what is raised on a damaged file depends on where the damage is
        raise ValueError(f"{path} is damaged or no saved learner: {error!r}") from error
    header = _header(path, names, entries)
    found = {name: _tensors(path, name, tensors, trusted) for name, tensors in packed.items()}
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
    try:
        check_number("motions", motions, least=0, whole=True)
        check_number("updates", updates, least=0, whole=True)
        for what, tensors in (("parameters", parameters), ("variables", variables)):
            if not isinstance(tensors, dict) or not all(isinstance(name, str) for name in tensors):
                raise ValueError(f"{what} are {tensors!r:.80}; they must be a mapping of names")
    except ValueError as error:
        raise ValueError(f"{path} is damaged: {error}") from error
    return saved


def check_tensor(name: str, saved: Any, ours: torch.Tensor) -> None:
    """Raises ValueError where what was saved is no finite tensor of the same shape and type as ours."""
    fits = isinstance(saved, torch.Tensor) and saved.shape == ours.shape and saved.dtype == ours.dtype
    if not fits or not torch.isfinite(saved).all():
        raise ValueError(f"{name} is {saved!r:.80}; it must be finite, {ours.dtype}, of {ours.shape}")


def optimizer_state(name: str, saved: Any, optimizer: Optimizer) -> dict[str, Any]:
    """A state dict for our optimizer: what a file tells of each parameter, and our own settings.

    Raises:
        ValueError: That is not what a step of our optimizer leaves: fused ones would write beyond it.
    """
    stepped = copy.deepcopy(optimizer)
    for parameter in (each for group in stepped.param_groups for each in group["params"]):
        parameter.grad = torch.zeros_like(parameter)
    stepped.step()
    ours, states = stepped.state_dict()["state"], saved["state"]
    for number, state in states.items():
        what = f"the state of parameter {number} in {name}"
        if ours.get(number, {}).keys() != state.keys():
            raise ValueError(f"{what} has {', '.join(state)}; it must have {', '.join(ours.get(number, {}))}")
        for key, value in state.items():
            mine = torch.as_tensor(ours[number][key])
            theirs = value if isinstance(value, torch.Tensor) else torch.as_tensor(value, dtype=mine.dtype)
            check_tensor(f"{key} of {what}", theirs, mine)
            if (key == "step" or "sq" in key) and (theirs < 0).any():
                raise ValueError(f"{key} of {what} has {float(theirs.min()):g}; it must be 0 or more")
            mine.copy_(theirs)
            if not isinstance(ours[number][key], torch.Tensor):
                ours[number][key] = mine.item()
    return optimizer.state_dict() | {"state": {number: ours[number] for number in states}}


def _header(path: AgentFile, names: list[str], entries: Mapping[str, bytes]) -> dict[str, Any]:
    """The JSON header: ours, or stable-baselines3's, whose pickles stay the texts that they are in JSON."""
    ours = _HEADER in entries and _PARAMETERS in entries
    if not ours and not {_FOREIGN_HEADER, "policy.pth"} <= entries.keys():
        raise ValueError(
            f"{path} holds {', '.join(sorted(names)) or 'nothing'}; a saved learner holds {_HEADER} and "
            f"{_PARAMETERS}, or, of stable-baselines3, {_FOREIGN_HEADER} and policy.pth"
        )
    try:
        header = json.loads(entries[_HEADER if ours else _FOREIGN_HEADER])
        if ours and header["calfree"] != _VERSION:
            raise ValueError(f"its version is {header['calfree']}, this code reads {_VERSION}")
        if ours and not {"about", "motions", "updates"} <= header.keys():
            raise ValueError(f"{_HEADER} holds {', '.join(header)}")
        if ours and not isinstance(header["about"], dict):
            raise ValueError(f"about is {header['about']!r:.80}; it must be a mapping")
        return {**header}
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise ValueError(f"{path} is damaged: {error!r}") from error


def _tensors(path: AgentFile, name: str, packed: io.BytesIO, trusted: bool) -> Any:
    packed.seek(0)
    try:
        return {**torch.load(packed, map_location="cpu", weights_only=not trusted)}
    except Exception as error:  # what torch raises on a damaged file depends on where the damage is
        hint = (
            "" if trusted else ", or would have to be unpickled: load(path, trusted=True) does, at your risk"
        )
        raise ValueError(f"{name} in {path} is damaged{hint}: {str(error).splitlines()[0]}") from error
