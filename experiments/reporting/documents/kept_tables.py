"""Kept results (`experiments/results/NAME/`) as tables of README.md and docs/.

A suite keeps `tables.json`: under "tables" one a scenario or sweep, under "details" all others of its report.
A benchmark keeps JSON of the same form.
"""

import json
from functools import cache
from pathlib import Path
from typing import Any

import pandas as pd

import agents
from calfree_gym.errors import near_misses
from experiments.config.environment import EnvironmentConfig
from experiments.config.requirements import requirements
from experiments.config.suite import AgentConfig
from experiments.errors import ConfigError
from experiments.reporting.pages.markdown import tables_markdown
from experiments.reporting.tables import Table, must_know
from experiments.running.versions import REPOSITORY

KEPT = REPOSITORY / "experiments" / "results"
AGENTS = "agents"
"""The one table that is made from the code alone."""


def tables_named(name: str, kept: Path = KEPT) -> str:
    """The Markdown of a table of README.md or docs/.

    Args:
        name: "agents", a folder of kept results such as "quick", or one table in it, as "quick/wild".
        kept: Holds the folders of kept results.

    Raises:
        ConfigError: Nothing is kept under that name; says what is.
    """
    if name == AGENTS:
        return _agents().markdown()
    folder, _, chosen = name.partition("/")
    allowed = [AGENTS, *sorted(path.name for path in kept.glob("*") if _files(path))]
    if folder not in allowed:
        hint = near_misses(folder, allowed)
        raise ConfigError(f"no results are kept as {folder!r}{hint}; allowed: {', '.join(allowed)}")
    parts = []
    names: dict[str, None] = {}
    for path in _files(kept / folder):
        tables, details, commit = read_kept(path)
        names |= dict.fromkeys(table.name for table in (*tables, *details))
        shown = [table for table in (*tables, *details) if table.name == chosen] if chosen else tables
        if shown:
            source = f"*Made from `experiments/results/{folder}`, code of commit {commit}.*"
            parts += [*tables_markdown(shown), source]
    if not parts:
        hint = near_misses(chosen, list(names))
        raise ConfigError(f"{folder} keeps no table {chosen!r}{hint}; allowed: {', '.join(names)}")
    return "\n\n".join(parts)


def read_kept(path: Path) -> tuple[list[Table], list[Table], str]:
    """The tables in a kept file, the details among them, and the commit that made it.

    Raises:
        ConfigError: The file is damaged.
    """
    try:
        kept: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        tables, details = (
            [Table.from_dict(table) for table in each] for each in (kept["tables"], kept.get("details", ()))
        )
        return tables, details, kept["commit"]
    except (KeyError, ValueError) as error:
        raise ConfigError(f"{path} is damaged or no kept result: {error!r}") from None


def _files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.json"))


@cache
def _agents() -> Table:
    nominal = {"id": "CalFree/Reach-v0", "world": "nominal", "camera_mount": "stand"}
    env = EnvironmentConfig.model_validate(nominal)
    rows = []
    for name in agents.names():
        required = requirements(AgentConfig(name=name, label=name), env)
        rows.append((f"`{name}`", must_know(required.privileged, required.prior_knowledge)))
    return Table(AGENTS, "Agents", pd.DataFrame(rows, columns=["agent", "what it must know"]))
