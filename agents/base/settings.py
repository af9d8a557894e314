"""Settings of agents: what makes them takes, and tuned defaults."""

from __future__ import annotations

from collections.abc import Callable
from inspect import signature
from pathlib import Path
from typing import Any


def named_settings(maker: Callable[..., Any]) -> dict[str, Any]:
    """Parameters of what makes an agent, with their defaults (`Parameter.empty`, where there is none)."""
    parameters = signature(maker).parameters.values()
    return {p.name: p.default for p in parameters if p.kind is not p.VAR_KEYWORD and p.name != "env"}


def tuned_settings(name: str) -> dict[str, Any]:
    """The settings in configs/agents/NAME.yaml; a wheel holds these files within the package.

    They are the defaults of learners of stable-baselines3. Other agents take theirs where they are given, as
    suites do by `settings: agents/NAME.yaml`.
    """
    from calfree_gym.errors.yaml_values import read

    package = Path(__file__).parents[1]
    folders = (package / "configs", package.parent / "configs" / "agents")
    folder = next(folder for folder in folders if folder.is_dir())
    settings: dict[str, Any] = read((folder / f"{name}.yaml").read_text(encoding="utf-8"))
    return settings
