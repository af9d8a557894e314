"""Kept results (`experiments/results/NAME/`) as tables: `summary.csv` of a suite, JSON of benchmarks."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from calfree_gym.errors import near_misses
from experiments.errors import ConfigError
from experiments.reporting.by_arm.section import BY_ARM, arms_table
from experiments.reporting.claims.section import claims_section, verdict_table
from experiments.reporting.claims.verdicts import judge
from experiments.reporting.documents.agents_table import agents_table
from experiments.reporting.finished_suite import MOTIONS, RENDEZVOUS, SUCCESS
from experiments.reporting.held_out.section import MOMENTS
from experiments.reporting.report import SUMMARY
from experiments.reporting.results_file import RESULTS, read_finished
from experiments.reporting.tables import Table, number, percent
from experiments.running.versions import REPOSITORY
from experiments.statistics import Estimate

KEPT = REPOSITORY / "experiments" / "results"
AGENTS = "agents"
"""The one table that is made from the code alone."""


def tables_named(name: str, kept: Path = KEPT) -> str:
    """The Markdown of a table of README.md or docs/.

    Args:
        name: "agents", a folder of kept results such as "quick", or one table in it, as "quick/wild"; then,
            where not all columns are to be shown, those that are, as "quick/wild: agent, success".
        kept: Holds the folders of kept results.

    Raises:
        ConfigError: Nothing is kept under that name, or it has no such column; says what there is.
    """
    if name == AGENTS:
        return agents_table().markdown()
    name, _, columns = name.partition(": ")
    folder, _, chosen = name.partition("/")
    allowed = [AGENTS, *sorted(path.name for path in kept.glob("*") if _files(path))]
    if folder not in allowed:
        hint = near_misses(folder, allowed)
        raise ConfigError(f"no results are kept as {folder!r}{hint}; allowed: {', '.join(allowed)}")
    found = [(table, commit) for path in _files(kept / folder) for table, commit in _read(path)]
    names = list(dict.fromkeys(table.name for table, _ in found))
    if chosen and chosen not in names:
        hint = near_misses(chosen, names)
        raise ConfigError(f"{folder} keeps no table {chosen!r}{hint}; allowed: {', '.join(names)}")
    shown = [(_chosen(table, columns), commit) for table, commit in found if chosen in ("", table.name)]
    return "\n\n".join(_shown(table, commit, folder, len(shown) > 1) for table, commit in shown)


def _chosen(table: Table, columns: str) -> Table:
    """The table with these columns alone, separated by commas; with all where none are named."""
    wanted = columns.split(", ") if columns else table.header
    for column in wanted:
        if column not in table.header:
            hint = near_misses(column, table.header)
            raise ConfigError(
                f"{table.name} has no column {column!r}{hint}; allowed: {', '.join(table.header)}"
            )
    return replace(table, frame=table.frame[wanted])


def _shown(table: Table, commit: str, folder: str, with_title: bool) -> str:
    source = f"*Made from `experiments/results/{folder}`, code of commit {commit}.*"
    title = f"**{table.title}**" if with_title else ""
    return "\n\n".join(part for part in (title, table.markdown(), table.note, source) if part)


def _files(folder: Path) -> list[Path]:
    return [*folder.glob(SUMMARY), *sorted(folder.glob("*.json"))]


def _read(path: Path) -> Iterator[tuple[Table, str]]:
    """The tables in a kept file, each with the commit that made it."""
    try:
        if path.suffix == ".csv":
            text = {"moment": str, "commit": str}
            summary = pd.read_csv(path, dtype=text, keep_default_na=False, na_values=[""])
            commit = summary["commit"].iloc[0]
            for (scenario, kind), rows in summary.groupby(["scenario", "table"], sort=False):
                if kind in _MAKERS:
                    yield _MAKERS[kind](str(scenario), rows), commit
            if len(by_arm := summary[summary["table"] == BY_ARM]):
                yield arms_table(by_arm), commit
            if "claims" in set(summary["table"]):
                finished = read_finished(path.with_name(RESULTS), path.parent)
                judged = judge(finished.results, finished.suite)
                claims = claims_section(judged).table
                assert claims is not None
                yield from ((table, commit) for table in (verdict_table(judged), claims))
        else:
            kept = json.loads(path.read_text(encoding="utf-8"))
            for table in kept["tables"]:
                yield Table.from_dict(table), kept["commit"]
    except (KeyError, IndexError, ValueError) as error:
        raise ConfigError(f"{path} is damaged or no kept result: {error!r}") from None


def _held_out(scenario: str, rows: pd.DataFrame) -> Table:
    """One row an agent: rendezvous and interquartile mean of motions at each moment, success at the end.

    Results of older code have no rendezvous, and their motions per reach are the interquartile mean.
    """
    numbers = {
        (row.agent, row.moment, row.measure): Estimate(row.value, row.low, row.high)
        for row in rows.itertuples()
    }
    has = set(rows["measure"])
    share = RENDEZVOUS if RENDEZVOUS in has else SUCCESS
    middle = f"{MOTIONS}_iqm" if f"{MOTIONS}_iqm" in has else MOTIONS
    moments = [moment for moment in MOMENTS if moment in set(rows["moment"])]
    known = rows.groupby("agent", sort=False)["must_know"].first()
    lines = [
        [
            f"`{agent}`",
            must_know,
            *(
                f"{_tight(numbers[agent, moment, share])}; {number(numbers[agent, moment, middle])}"
                if (agent, moment, share) in numbers
                else "–"
                for moment in moments
            ),
            _tight(numbers[last]) if (last := (agent, moments[-1], SUCCESS)) in numbers else "–",
        ]
        for agent, must_know in known.items()
    ]
    columns = [
        "agent",
        "what it must know",
        *(f"{moment}: {share}; {_NAMES[middle]}" for moment in moments),
        f"{moments[-1]}: {SUCCESS}",
    ]
    return Table(scenario, f"Scenario {scenario}", pd.DataFrame(lines, columns=columns))


_NAMES = {MOTIONS: "motions per reach", f"{MOTIONS}_iqm": "interquartile mean of motions"}


def _tight(share: Estimate) -> str:
    """A share with its interval where there is little room."""
    return percent(share).replace(" %", "%")


def _checkpoints(scenario: str, rows: pd.DataFrame) -> Table:
    """Agents and measures by checkpoints."""
    title = f"Scenario {scenario}, after so many motions (since the last perturbation)"
    return _by(["agent", "measure"], "moment", f"{scenario}-checkpoints", title, rows)


def _by_trial(scenario: str, rows: pd.DataFrame) -> Table:
    """Motions per reach in blocks of trials."""
    cells = _cells(rows[rows["measure"] == MOTIONS], lambda found: number(found, 2))
    return Table(scenario, f"Scenario {scenario}, motions per reach in trials", cells)


def _sweep(scenario: str, rows: pd.DataFrame) -> Table:
    """Success at each value."""
    cells = _cells(rows[rows["measure"] == SUCCESS], percent)
    return Table(scenario, f"Sweep {scenario}, success", cells)


def _profile(scenario: str, rows: pd.DataFrame) -> Table:
    """Share of trials that end within each threshold."""
    title = f"Scenario {scenario}, trials that end within"
    return Table(f"{scenario}-profile", title, _cells(rows, percent))


def _beside(scenario: str, rows: pd.DataFrame) -> Table:
    title = f"Scenario {scenario}, differences from the first agent in the same worlds"
    return _by_measure(f"{scenario}-comparison", title, rows)


def _threshold(scenario: str, rows: pd.DataFrame) -> Table:
    title = f"Scenario {scenario}, motions to 95 % rendezvous, and medians of the last checkpoints"
    return _by_measure(f"{scenario}-threshold", title, rows)


def _by_measure(name: str, title: str, rows: pd.DataFrame) -> Table:
    """Agents and moments by measures."""
    return _by(["agent", "moment"], "measure", name, title, rows)


def _by(keys: list[str], columns: str, name: str, title: str, rows: pd.DataFrame) -> Table:
    """A number with its interval in each cell."""
    cells = [
        (percent if row.measure.startswith(_SHARES) else number)(Estimate(row.value, row.low, row.high))
        for row in rows.itertuples()
    ]
    wide = rows.assign(cell=cells).pivot(index=keys, columns=columns, values="cell")
    wide = wide.reindex(index=pd.MultiIndex.from_frame(rows[keys].drop_duplicates()))
    wide = wide.reindex(columns=rows[columns].unique()).fillna("–")
    return Table(name, title, wide.rename_axis(columns=None).reset_index())


_SHARES = (SUCCESS, RENDEZVOUS, "fewer")
"""How the names of measures begin that are shares."""
_MAKERS = {
    "held_out": _held_out,
    "checkpoints": _checkpoints,
    "by_trial": _by_trial,
    "sweep": _sweep,
    "profile": _profile,
    "comparison": _beside,
    "threshold": _threshold,
}
"""By what `summary.csv` calls the table."""


def _cells(rows: pd.DataFrame, text: Any) -> pd.DataFrame:
    """Agents by moments, each number with its interval."""
    found = [
        "–" if np.isnan(row.value) else text(Estimate(row.value, row.low, row.high))
        for row in rows.itertuples()
    ]
    wide = rows.assign(cell=found).pivot(index="agent", columns="moment", values="cell")
    wide = wide.reindex(index=rows["agent"].unique(), columns=rows["moment"].unique())
    known = rows.groupby("agent", sort=False)["must_know"].first()
    wide.insert(0, "what it must know", known.reindex(wide.index))
    return wide.rename_axis(columns=None).reset_index()
