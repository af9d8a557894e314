"""Algorithms of stable-baselines3 and sb3_contrib by dotted name, and settings from plain values."""

from collections.abc import Mapping
from inspect import isclass, signature
from typing import Any

import numpy as np
import sb3_contrib
import stable_baselines3
import torch
from stable_baselines3 import HerReplayBuffer
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

from calfree_gym.errors import check_choice

from ...base.checks import check_number

Algorithm = type[BaseAlgorithm]

_OURS = ("self", "policy", "env", "device", "verbose", "tensorboard_log", "_init_setup_model")
"""What the adapter gives an algorithm by itself."""
_BUFFERS = {"ReplayBuffer": ReplayBuffer, "HerReplayBuffer": HerReplayBuffer}
ALGORITHMS: dict[str, Algorithm] = {
    f"{module.__name__}.{name}": found
    for module in (stable_baselines3, sb3_contrib)
    for name in module.__all__
    if isclass(found := getattr(module, name)) and issubclass(found, OnPolicyAlgorithm | OffPolicyAlgorithm)
}
"""By dotted name, such as "sb3_contrib.CrossQ": those that learn by gradients."""
_BOUNDS: dict[str, dict[str, Any]] = {
    "gamma": {"least": 0, "most": 1},
    "learning_rate": {"above": 0},
    "batch_size": {"least": 1, "whole": True},
    "buffer_size": {"least": 1, "whole": True},
    "n_steps": {"least": 1, "whole": True},
    "n_epochs": {"least": 1, "whole": True},
    "gradient_steps": {"least": -1, "whole": True},
    "learning_starts": {"least": 0, "whole": True},
    "tau": {"least": 0, "most": 1},
    "gae_lambda": {"least": 0, "most": 1},
    "clip_range": {"above": 0},
    "max_grad_norm": {"above": 0},
    "policy_delay": {"least": 1, "whole": True},
    "target_update_interval": {"least": 1, "whole": True},
}
"""Of settings that several algorithms share, which stable-baselines3 itself does not check."""


_TAKEN = {"net_arch", "features_extractor_class", "features_extractor_kwargs"}


def algorithm_of(name: str) -> Algorithm:
    """The algorithm of a dotted name.

    Raises:
        ValueError: There is none, with near misses and all that are allowed.
    """
    check_choice("algorithm", name, ALGORITHMS)
    return ALGORITHMS[name]


def settings_of(algorithm: Algorithm) -> dict[str, Any]:
    """The settings that an algorithm takes, with their defaults (`Parameter.empty`, where there is none)."""
    parameters = signature(algorithm.__init__).parameters
    return {name: parameter.default for name, parameter in parameters.items() if name not in _OURS}


def built_settings(settings: Mapping[str, Any], motors: int) -> dict[str, Any]:
    """Settings with objects where stable-baselines3 wants them, from the plain values of a YAML file.

    `replay_buffer_class` is a name, `action_noise` a standard deviation of normal noise, and
    `activation_fn` in `policy_kwargs` a module of `torch.nn`.

    Raises:
        ValueError: One of them is not allowed.
    """
    built = dict(settings)
    for setting, bounds in _BOUNDS.items():
        if setting in built and not callable(built[setting]):  # a learning rate may be a schedule
            check_number(setting, built[setting], **bounds)
    if "train_freq" in built:
        built["train_freq"] = _train_freq(built["train_freq"])
    if isinstance(buffer := built.get("replay_buffer_class"), str):
        check_choice("replay_buffer_class", buffer, _BUFFERS)
        built["replay_buffer_class"] = _BUFFERS[buffer]
    if "action_noise" in built and built["action_noise"] is not None:
        sigma = check_number("action_noise", built["action_noise"], least=0)
        built["action_noise"] = NormalActionNoise(np.zeros(motors), np.full(motors, sigma))
    given = built.get("policy_kwargs") or {}
    if not isinstance(given, Mapping):
        raise ValueError(f"policy_kwargs is {given!r}; it must be a mapping")
    policy = dict(given)
    if taken := sorted(policy.keys() & _TAKEN):
        raise ValueError(f"policy_kwargs has {', '.join(taken)}; net_arch and distance_scales say these")
    if isinstance(activation := policy.get("activation_fn"), str):
        check_choice("activation_fn", activation, torch.nn.modules.activation.__all__)
        policy["activation_fn"] = getattr(torch.nn, activation)
    return built | {"policy_kwargs": policy}


def _train_freq(value: Any) -> tuple[int, str]:
    """A number of steps, or one with its unit, which YAML gives as a list."""
    count, unit = value if isinstance(value, list | tuple) and len(value) == 2 else (value, "step")
    check_number("train_freq", count, least=1, whole=True)
    check_choice("the unit of train_freq", unit, ("step", "episode"))
    return int(count), unit


def policy_name(algorithm: Algorithm, flat: bool) -> str:
    """The name of an algorithm's policy for flat observations, or for those by key.

    Raises:
        ValueError: It has none.
    """
    wanted = ("MlpPolicy", "MlpLstmPolicy") if flat else ("MultiInputPolicy", "MultiInputLstmPolicy")
    for name in wanted:
        if name in algorithm.policy_aliases:
            return name
    raise ValueError(f"{algorithm.__name__} has no policy for observations by key, which hindsight needs")
