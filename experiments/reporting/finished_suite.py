"""A suite's folder, read back, and what several parts of the report need of its scenarios."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from calfree_gym.perturbations.undo import Undo
from experiments.config.suite import AgentConfig, ScenarioConfig, Suite, SweepConfig
from experiments.reporting.prior_knowledge import must_know
from experiments.running import trial_log
from experiments.running.plan import LifetimeRun, Run, runs_of
from experiments.running.results_folder import (
    DONE,
    SUITE,
    TIMINGS,
    VERSIONS,
    folder_of,
    is_done,
    read_json,
    read_suite,
    refuse_foreign,
)

RESULTS = "results.parquet"
SUCCESS, RENDEZVOUS, MOTIONS, SECONDS = "success", "rendezvous", "motions_per_reach", "robot_seconds"
"""What is measured in a trial; one without an observed rendezvous counts as the cap in motions per reach."""
ENOUGH_WORLDS = 20
"""With fewer, each world is drawn, and no ranking is claimed."""


@dataclass(frozen=True, slots=True)
class FinishedSuite:
    """What a suite has come to so far.

    Attributes:
        out: Its folder.
        suite: What was run.
        command: What the user typed.
        runs: All runs of the suite.
        outcomes: What the finished ones say about themselves, by their ids.
        versions: The commit, and what else made the finished ones; several versions where they differ.
        results: All rows of the finished ones.
    """

    out: Path
    suite: Suite
    command: str
    runs: list[Run]
    outcomes: dict[str, dict[str, Any]]
    versions: dict[str, str]
    results: pd.DataFrame

    @property
    def unfinished(self) -> list[Run]:
        """Runs that failed, or were never finished."""
        return [run for run in self.runs if run.id not in self.outcomes]

    def outcomes_of(self, agent: AgentConfig) -> list[dict[str, Any]]:
        """What the finished runs of an agent say about themselves."""
        return [self.outcomes[run.id] for run in self.runs if run.agent == agent and run.id in self.outcomes]

    def timings_of(self, agent: AgentConfig) -> list[dict[str, Any]]:
        """What the finished runs of an agent took."""
        mine = [run.id for run in self.runs if run.agent == agent and run.id in self.outcomes]
        return [read_json(folder_of(self.out, run) / TIMINGS) for run in mine]

    def must_know(self, agent: AgentConfig) -> str:
        """The privileged observations of an agent, and what it is built on."""
        for outcome in self.outcomes_of(agent):
            return must_know(outcome["privileged"], outcome["prior_knowledge"])
        return "unknown: no run finished"


def read_finished(out: Path) -> FinishedSuite:
    """Reads a folder, and writes `results.parquet` into it.

    Raises:
        ConfigError: No suite was run in the folder, or its runs were made by different versions.
    """
    suite, command = read_suite(out)
    runs = runs_of(suite)
    done = {folder: run for run in runs if is_done(folder := folder_of(out, run.id))}
    for folder in list(done)[:1]:
        refuse_foreign(out, suite, read_json(folder / VERSIONS))
    outcomes = {run.id: read_json(folder / DONE) for folder, run in done.items()}
    trial_log.compact(done, out / RESULTS)
    return FinishedSuite(
        out, suite, command, runs, outcomes, _versions(out, runs), pd.read_parquet(out / RESULTS)
    )


def _versions(out: Path, runs: list[Run]) -> dict[str, str]:
    found: dict[str, set[str]] = {"commit": {read_json(out / SUITE).get("commit", "unknown")}}
    for run in runs:
        made_by = folder_of(out, run.id) / VERSIONS
        if made_by.exists():
            for name, version in read_json(made_by).items():
                found.setdefault(name, set()).add(version)
    return {name: ", ".join(sorted(versions)) for name, versions in found.items()}


def with_cost(results: pd.DataFrame, scenario: ScenarioConfig | SweepConfig) -> pd.DataFrame:
    """The rows of one scenario or sweep, with motions per reach.

    A trial without a rendezvous counts as the cap. Older code noted no rendezvous, and allowed successes an
    error that grew with the noise. Its trials are judged by what it did note: one that ended before the cap
    had an observed rendezvous, and a final error within the tolerance is a success.
    """
    rows = results[results["scenario"] == scenario.name].copy()
    cap = scenario.env.max_episode_steps
    older = rows["rendezvous"].isna()
    rows[RENDEZVOUS] = rows["rendezvous"].where(~older, rows["motions"] < cap).astype(float)
    if older.any():
        rows[SUCCESS] = rows["success"].where(~older, rows["error_px"] <= scenario.env.tolerance_px)
    rows[SUCCESS] = rows["success"].astype(float)
    rows[MOTIONS] = rows["motions"].where(rows[RENDEZVOUS] == 1, cap).astype(float)
    return rows


def few_worlds(suite: Suite) -> str:
    """What fewer worlds than are enough do not show."""
    if suite.worlds >= ENOUGH_WORLDS:
        return ""
    return (
        f" With {suite.worlds} worlds, fewer than {ENOUGH_WORLDS}, no ranking of agents is claimed: the thin "
        "lines of the figures are single worlds."
    )


def about(suite: Suite, scenario: ScenarioConfig) -> str:
    """What the runs of a scenario have in common, in words."""
    env = scenario.env
    length, of = scenario.length
    return (
        f"{env.id}, {env.world} worlds, cameras on the {env.camera_mount}, tolerance "
        f"{env.tolerance_px:g} px, {env.dynamics} dynamics, at most {env.max_episode_steps} "
        f"motions a trial, {length:,} {of} a lifetime, {suite.worlds} worlds, the same "
        f"for every agent." + few_worlds(suite)
    )


def where_it_stands(finished: FinishedSuite, scenario: ScenarioConfig | SweepConfig, trials: str) -> str:
    """What a figure needs beside it: threshold, unit of resampling, number of worlds, what agents know."""
    suite = finished.suite
    drawn = (
        "bands: 95 % intervals over worlds"
        if suite.worlds >= ENOUGH_WORLDS
        else "thin lines: single worlds; no ranking is claimed"
    )
    known = "; ".join(f"{agent.label}: {finished.must_know(agent)}" for agent in suite.agents_in(scenario))
    return (
        f"Tolerance {scenario.env.tolerance_px:g} px of 512. {suite.worlds} worlds, {trials}; lines: "
        f"all worlds; {drawn}.\nBuilt on, beyond observations: {known}."
    )


@dataclass(frozen=True, slots=True)
class Perturbation:
    """How the world changed, and between which lifetime motions (or trials) it did so in the runs."""

    first: int
    last: int
    what: str


def perturbations_met(finished: FinishedSuite, scenario: ScenarioConfig, of: str) -> tuple[Perturbation, ...]:
    """After how many motions, or trials (`of`), the runs were perturbed, and how; a span where they differ.

    Spans of the same perturbation that overlap, as where it comes at every trial, are one.
    """
    met: dict[tuple[str, int], list[int]] = {}
    for spec in finished.runs:
        if (
            isinstance(spec, LifetimeRun)
            and spec.scenario.name == scenario.name
            and spec.id in finished.outcomes
        ):
            seen: Counter[str] = Counter()
            for motions, trials, perturbation in finished.outcomes[spec.id]["perturbations"]:
                what = _in_words(perturbation, scenario)
                met.setdefault((what, seen[what]), []).append(motions if of == "motions" else trials)
                seen[what] += 1
    spans: list[Perturbation] = []
    for (what, _), counts in sorted(met.items(), key=lambda item: (item[0][0], min(item[1]))):
        first, last = min(counts), max(counts)
        if spans and spans[-1].what == what and first <= spans[-1].last:
            first, last = spans[-1].first, max(last, spans.pop().last)
        spans.append(Perturbation(first, last, what))
    return tuple(sorted(spans, key=lambda span: span.first))


def _in_words(perturbation: dict[str, Any], scenario: ScenarioConfig) -> str:
    """A perturbation as in the schedule, without what it drew (which differs from world to world)."""
    schedule = scenario.perturbations
    if perturbation["type"] == Undo.type:
        return f"undo: {_named(schedule[perturbation['event']]['do'])}"
    given = (entry for entry in schedule if "do" in entry)
    entry = next((e for e in given if e["do"].items() <= perturbation.items()), {"do": perturbation})
    drift = "drift" in {**entry, **entry.get("at", {})}
    return ("drift: " if drift else "") + _named(entry["do"])


def _short(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _named(perturbation: dict[str, Any]) -> str:
    given = ", ".join(f"{key} {_short(value)}" for key, value in perturbation.items() if key != "type")
    return f"{perturbation['type']} ({given})" if given else str(perturbation["type"])
