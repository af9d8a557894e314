"""The file of a network: safetensors, with what it was trained on and what it observes; never a pickle."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
import torch
from safetensors.torch import load, save

from ...base.checks import check_number
from ...base.observation import STANDARD_KEYS
from ...base.storage import AgentFile, content, written
from .network import RecurrentServoNetwork

KEPT = Path(__file__).parent / "weights.safetensors"
"""The network that comes with the code."""
_HEADER = "calfree"
_KIND = "recurrent_servo"
_FIELDS = ("observation_format", "hidden", "num_timesteps", "training")


def observation_format(observations: Any, actions: Any) -> dict[str, list[int]]:
    """Shapes of all that a network observes and sends, by key, of one robot's spaces."""
    spaces: Mapping[str, gym.Space[Any]] = getattr(observations, "spaces", {})
    shapes = {key: list(spaces[key].shape or ()) for key in STANDARD_KEYS if key in spaces}
    return shapes | {"words": list(actions.shape)}


def save_network(
    path: AgentFile,
    network: RecurrentServoNetwork,
    shapes: Mapping[str, list[int]],
    training: Mapping[str, Any],
    num_timesteps: int = 0,
) -> None:
    """Writes a network, what it observes (see `observation_format`) and how it was trained."""
    header = {
        "kind": _KIND,
        "observation_format": dict(shapes),
        "hidden": network.hidden,
        "num_timesteps": num_timesteps,
        "training": dict(training),
    }
    tensors = {name: tensor.float().contiguous() for name, tensor in network.state_dict().items()}
    with written(path) as file:
        file.write(save(tensors, {_HEADER: json.dumps(header)}))  # of several entries the order would change


def load_network(
    path: AgentFile, shapes: Mapping[str, list[int]]
) -> tuple[RecurrentServoNetwork, dict[str, Any], int]:
    """Reads a network that observes what `shapes` says, how it was trained, and its motions of `learn`.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is damaged, no such network, or of another observation format.
    """
    found = content(path)
    try:
        tensors = load(found)
        header = json.loads(_metadata(found).get(_HEADER, "{}"))
    except Exception as error:  # what is raised on a damaged file depends on where the damage is
        raise ValueError(f"{path} is damaged or no safetensors file: {error!r}") from error
    if not isinstance(header, dict):
        raise ValueError(f"{path} is damaged: its header is {header!r:.80}; it must be a mapping")
    if header.get("kind") != _KIND:
        raise ValueError(f"{path} holds {header.get('kind', 'no known agent')}; this agent is {_KIND}")
    if missing := [name for name in _FIELDS if name not in header]:
        raise ValueError(f"{path} is damaged: its header has no {', '.join(missing)}")
    try:
        hidden = check_number("hidden", header["hidden"], least=1, whole=True)
        recurrent = tensors.get("unit.weight_hh")
        if recurrent is None or recurrent.shape != (3 * hidden, hidden):
            raise ValueError(
                f"hidden is {hidden}, but its unit.weight_hh is {getattr(recurrent, 'shape', None)}"
            )
        motions = check_number("num_timesteps", header["num_timesteps"], least=0, whole=True)
        if not isinstance(header["training"], dict):
            raise ValueError(f"training is {header['training']!r:.80}; it must be a mapping")
    except ValueError as error:
        raise ValueError(f"{path} is damaged: {error}") from error
    saved = header["observation_format"]
    if saved != dict(shapes):
        raise ValueError(
            f"{path} is of a network with the observation format {saved}; here it is {dict(shapes)}: "
            "it acts where the keys and shapes are the same, with as many motors"
        )
    try:
        network = RecurrentServoNetwork(saved["words"][0], hidden)
        network.load_state_dict(tensors)
        if not all(torch.isfinite(tensor).all() for tensor in tensors.values()):
            raise ValueError("a weight is not finite")
    except (RuntimeError, ValueError) as error:
        raise ValueError(f"{path} is damaged: {error}") from error
    return network, header["training"], motions


def _metadata(found: bytes) -> dict[str, str]:
    """What stands in a safetensors file beside tensors: under one key of the JSON with which it begins."""
    size = int.from_bytes(found[:8], "little")
    metadata: dict[str, str] = json.loads(found[8 : 8 + size]).get("__metadata__", {})
    return metadata
