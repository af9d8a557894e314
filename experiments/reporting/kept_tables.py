"""Kept results (`experiments/results/NAME/`) as tables of README.md and docs/.

A suite keeps `tables.json`: under "tables" one a scenario or sweep, under "details" all others of its report.
A benchmark keeps JSON of the same form.

A page shows a table between two markers, `<!-- table: NAME -->` and `<!-- end of table -->`, or some columns:
`<!-- table: NAME: COLUMN, COLUMN -->`, or all rows but some: `<!-- table: NAME without ROW, ROW -->`. A row
is called by its first cell, as far as a colon.
"""

import json
import re
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import agents
from agents.base.registration import AGENTS as REGISTERED
from calfree_gym.errors import near_misses
from experiments.config.environment import EnvironmentConfig
from experiments.config.loading import read_mapping
from experiments.config.requirements import requirements
from experiments.config.suite import AgentConfig
from experiments.errors import ConfigError
from experiments.reporting.pages import tables_markdown, without_tags
from experiments.reporting.results_file import TIMES, read_times
from experiments.reporting.tables import Table, must_know
from experiments.running.versions import KEPT, REPOSITORY

AGENTS, BUDGETS = "agents", "budgets"
"""Tables that no result keeps: one is made from the code alone, one from the times of all kept suites."""
CORES = 2
"""On which kept results are made."""
SESSION = 150
"""Minutes: a group of suites takes no longer, where none of them does."""
_MARKER = re.compile(r"^<!-- (?:table: (?P<name>\S.*?)|(?P<end>end of table)) -->$", re.MULTILINE)


def tables_named(name: str, kept: Path = KEPT) -> str:
    """The Markdown of a table of README.md or docs/.

    Args:
        name: "agents", "budgets", a folder of kept results such as "quick", or one table in it, as
            "quick/wild"; then, where not all columns are to be shown, those that are, as "quick/wild: agent,
            success"; or which rows are not, as "quick/wild without oracle".
        kept: Holds the folders of kept results.

    Raises:
        ConfigError: Nothing is kept under that name, or it has no such column or row; says what there is.
    """
    if name == AGENTS:
        return agents_table().markdown()
    if name == BUDGETS:
        return budgets_table(kept).markdown()
    name, _, columns = name.partition(": ")
    name, _, without = name.partition(" without ")
    folder, _, chosen = name.partition("/")
    allowed = [AGENTS, BUDGETS, *sorted(path.name for path in kept.glob("*") if _files(path))]
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
            parts += [*tables_markdown([_chosen(table, columns, without) for table in shown]), source]
    if not parts:
        hint = near_misses(chosen, list(names))
        raise ConfigError(f"{folder} keeps no table {chosen!r}{hint}; allowed: {', '.join(names)}")
    return "\n\n".join(parts)


@cache
def agents_table() -> Table:
    """What each agent does, and what it must know, from the code alone."""
    nominal = {"id": "CalFree/Reach-v0", "world": "nominal", "camera_mount": "stand"}
    env = EnvironmentConfig.model_validate(nominal)
    rows = []
    for name in agents.names():
        required = requirements(AgentConfig(name=name, label=name), env)
        known = must_know(required.privileged, required.prior_knowledge)
        rows.append((f"[`{name}`](agent-settings.md#{name})", REGISTERED[name].does, known))
    return Table.of(AGENTS, "Agents", ["agent", "what it does", "what it must know"], rows)


def budgets_table(kept: Path = KEPT) -> Table:
    """How long each suite that keeps its times has taken, what it is for, and what is made with it."""
    minutes = {
        times.parent.name: read_times(times)["wall_seconds"].sum() / 60 / CORES
        for times in kept.glob(f"*/{TIMES}")
    }
    sums: list[float] = []
    rows = []
    for suite in sorted(minutes, key=lambda suite: -minutes[suite]):
        group = next((i for i, found in enumerate(sums) if found + minutes[suite] <= SESSION), len(sums))
        if group == len(sums):
            sums.append(0.0)
        sums[group] += minutes[suite]
        question = read_mapping(REPOSITORY / "configs" / f"{suite}.yaml")["question"]
        rows.append((group + 1, f"`{suite}`", f"{minutes[suite]:.0f}", question))
    return Table.of(
        BUDGETS, "Budgets", ["group", "suite", "minutes on two cores", "what it asks"], sorted(rows)
    )


def _chosen(table: Table, columns: str, without: str) -> Table:
    """The table with these columns alone, separated by commas, if any are named, and without these rows."""
    rows = table.frame.iloc[:, 0].map(lambda cell: str(cell).partition(":")[0])
    for row in (unwanted := without.split(", ") if without else []):
        if row not in rows.tolist():
            hint = near_misses(row, rows.tolist())
            raise ConfigError(f"{table.name} has no row {row!r}{hint}; allowed: {', '.join(rows)}")
    table = replace(table, frame=table.frame[~rows.isin(unwanted)])
    wanted = columns.split(", ") if columns else table.header
    for column in wanted:
        if column not in table.header:
            hint = near_misses(column, table.header)
            raise ConfigError(
                f"{table.name} has no column {column!r}{hint}; allowed: {', '.join(table.header)}"
            )
    return replace(table, frame=table.frame[wanted])


def read_kept(path: Path) -> tuple[list[Table], list[Table], str]:
    """The tables in a kept file, the details among them, and the commit that made it."""
    try:
        kept: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        tables, details = (
            [Table.from_dict(table) for table in each] for each in (kept["tables"], kept.get("details", ()))
        )
        return tables, details, str(kept["commit"])
    except (AttributeError, KeyError, RecursionError, TypeError, ValueError) as error:
        raise ConfigError(f"{path} is damaged or no kept result: {error!r}") from None


def _files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.json"))


def pages() -> list[Path]:
    """README.md and the pages of docs/, of its folders too."""
    return [REPOSITORY / "README.md", *sorted((REPOSITORY / "docs").rglob("*.md"))]


def outdated(paths: Iterable[Path], table: Callable[[str], str]) -> dict[Path, str]:
    """The pages that differ from what the code makes of the tables they name, and what they should be."""
    found = {}
    for path in paths:
        text = path.read_text(encoding="utf-8")
        if (filled := _filled(path, text, table)) != text:
            found[path] = filled
    return found


def _filled(path: Path, text: str, table: Callable[[str], str]) -> str:
    """A page with all its tables made anew."""
    parts, position, opened = [], 0, None
    for marker in _MARKER.finditer(text):
        where = f"{path.name}, line {text.count(chr(10), 0, marker.start()) + 1}"
        if (marker["name"] is None) == (opened is None):
            raise ConfigError(f"{where}: {marker[0]} without its other half")
        if marker["name"] is None:
            opened, position = None, marker.start()
            continue
        opened = where
        try:
            made = table(marker["name"])
        except ConfigError as error:
            raise ConfigError(f"{where}: {error}") from None
        parts.append(f"{text[position : marker.end()]}\n\n{made}\n\n")
    if opened:
        raise ConfigError(f"{opened}: the table has no <!-- end of table -->")
    return "".join(parts) + text[position:]


def page_of(measured: Path, title: str) -> str:
    """The tables of a kept JSON file, and its figure, as a page of Markdown to read."""
    tables, _, commit = read_kept(measured)
    parts = [f"# {title}", f"Code of commit {commit}."]
    if (figure := measured.with_suffix(".png")).exists():
        parts.append(f"![{measured.stem}]({figure.name})")
    try:
        for table in tables:
            parts += [f"## {table.title}", *tables_markdown([table])]
    except ValueError as error:
        raise ConfigError(f"{measured} is damaged or no kept result: {error!r}") from None
    return without_tags("\n\n".join(parts)) + "\n"
