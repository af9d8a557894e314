"""Settings of agents that were tuned."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def tuned_settings(name: str) -> dict[str, Any]:
    """The settings in configs/agents/NAME.yaml: the one place of an agent's tuned defaults.

    A wheel holds these files within the package.
    """
    import yaml

    package = Path(__file__).parents[1]
    folders = (package / "configs", package.parent / "configs" / "agents")
    folder = next(folder for folder in folders if folder.is_dir())
    settings: dict[str, Any] = yaml.safe_load((folder / f"{name}.yaml").read_text(encoding="utf-8"))
    return settings
