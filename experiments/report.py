"""A finished suite as one HTML page, one Markdown page and figures."""

import json
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from experiments import figures, records
from experiments.config import ScenarioConfig, Suite
from experiments.folder import (
    DONE,
    FAILED,
    LOG,
    VERSIONS,
    folder_of,
    is_done,
    read_json,
    read_suite,
    refuse_foreign,
    write_whole,
)
from experiments.pages import Section, Table, html_page, markdown_page
from experiments.plan import RunSpec, runs_of
from experiments.summary import Cell, held_out_curve, moments, training_curve, with_cost

RESULTS = "results.parquet"

_MOMENTS = ("before", "right after", "at the end")

_HOW_TO_READ = (
    "Before: the last held-out trials before a run's first perturbation. Right after: the first ones in "
    "the perturbed world. Worlds: runs that finished and came to that moment; lifetime motions: the "
    "fewest and the most among them. Success: all their trials, with the 95 % Wilson interval of trials "
    "in these very worlds. Motions per reach: each world's mean, a failed trial counting as the cap; "
    "interquartile mean over worlds, with a 95 % bootstrap over worlds. Distance: median true distance "
    "at the end of a trial. A run that did not finish counts as no success and as the cap; it has no "
    "distance."
)


@dataclass(frozen=True, slots=True)
class Finished:
    """A suite's folder, read back."""

    out: Path
    suite: Suite
    command: str
    runs: list[RunSpec]
    outcomes: dict[str, dict[str, Any]]
    results: pd.DataFrame


def write_report(out: Path) -> Path:
    """Writes `results.parquet`, `report.html`, `report.md` and `figures/` into a suite's folder.

    All are made from the finished runs of the suite that was run there last, so they are right also
    where it was interrupted.

    Returns:
        The path of the HTML page.

    Raises:
        ConfigError: No suite was run in the folder, or its runs were made by different versions.
    """
    finished = _read(out)
    sections = [_failures(finished)] if _unfinished(finished) else []
    for scenario in finished.suite.scenarios:
        sections.append(_scenario_section(finished, scenario))
    sections += [_told(finished), _versions(finished), _provenance(finished)]
    title, question = finished.suite.name, finished.suite.question
    page = out / "report.html"
    write_whole(page, html_page(title, question, sections))
    write_whole(out / "report.md", markdown_page(title, question, sections))
    return page


def _read(out: Path) -> Finished:
    suite, command = read_suite(out)
    runs = runs_of(suite)
    finished = {folder: spec for spec in runs if is_done(folder := folder_of(out, spec.id))}
    for folder in list(finished)[:1]:
        refuse_foreign(out, suite, read_json(folder / VERSIONS))
    outcomes = {spec.id: read_json(folder / DONE) for folder, spec in finished.items()}
    records.compact(finished, out / RESULTS)
    return Finished(out, suite, command, runs, outcomes, pd.read_parquet(out / RESULTS))


def _unfinished(finished: Finished) -> list[RunSpec]:
    return [spec for spec in finished.runs if spec.id not in finished.outcomes]


def _failures(finished: Finished) -> Section:
    unfinished = _unfinished(finished)
    tails = []
    for spec in unfinished:
        folder = folder_of(finished.out, spec.id)
        report = folder / FAILED
        tail = ["(never finished)"]
        if report.exists():
            tail = read_json(report)["log_tail"]
        tails.append("\n".join([f"{spec.id}  ({folder / LOG})", *tail]))
    return Section(
        title=f"{len(unfinished)} of {len(finished.runs)} runs FAILED or did not finish",
        text="In every curve and table below they count as no success and as the most motions.",
        code="\n\n".join(tails),
        alarming=True,
    )


def _scenario_section(finished: Finished, scenario: ScenarioConfig) -> Section:
    rows = with_cost(finished.results, scenario)
    suite, cap = finished.suite, scenario.env.max_episode_steps
    labels = tuple(agent.label for agent in suite.agents)
    width = max(suite.evaluation.every, 2 * cap)
    perturbations = _perturbations(finished, scenario)
    held_out = figures.learning_curves(
        f"{scenario.name}: held-out trials, {suite.evaluation.trials} at each checkpoint",
        lambda agent, measure: held_out_curve(rows, agent, measure, suite.worlds, scenario),
        labels,
        cap,
        perturbations,
    )
    training = figures.learning_curves(
        f"{scenario.name}: the agents' own trials, mean of each {width:,} motions",
        lambda agent, measure: training_curve(rows, agent, measure, suite.worlds, scenario, width),
        labels,
        cap,
        perturbations,
    )
    folder = finished.out / "figures"
    return Section(
        title=f"Scenario {scenario.name}",
        text=_about(suite, scenario),
        figures={
            f"{scenario.name}-{what}": figures.save(figure, folder, f"{scenario.name}-{what}")
            for what, figure in (("held-out", held_out), ("training", training))
        },
        table=_summary_table(finished, scenario, rows),
        note=_HOW_TO_READ,
    )


def _about(suite: Suite, scenario: ScenarioConfig) -> str:
    env = scenario.env
    return (
        f"{env.id}, {env.world} worlds, cameras on the {env.camera_mount}, tolerance "
        f"{env.tolerance_px:g} px, {env.dynamics} dynamics, at most {env.max_episode_steps} "
        f"motions a trial, {scenario.motions:,} motions a life, {suite.worlds} worlds, the same "
        f"for every agent. Lines: mean over worlds; bands: 95 % bootstrap over worlds."
    )


def _perturbations(finished: Finished, scenario: ScenarioConfig) -> tuple[figures.Perturbation, ...]:
    """When the runs were perturbed, and how: a span where they were perturbed after different motions.

    Spans of the same perturbation that overlap, as where it comes at every trial, are one.
    """
    met: dict[tuple[str, int], list[int]] = {}
    for spec in finished.runs:
        if spec.scenario == scenario and spec.id in finished.outcomes:
            seen: Counter[str] = Counter()
            for motions, perturbation in finished.outcomes[spec.id]["perturbations"]:
                what = _in_words(_as_given(perturbation, scenario))
                met.setdefault((what, seen[what]), []).append(motions)
                seen[what] += 1
    spans: list[figures.Perturbation] = []
    for (what, _), motions in sorted(met.items(), key=lambda item: (item[0][0], min(item[1]))):
        first, last = min(motions), max(motions)
        if spans and spans[-1].what == what and first <= spans[-1].last:
            first, last = spans[-1].first, max(last, spans.pop().last)
        spans.append(figures.Perturbation(first, last, what))
    return tuple(sorted(spans, key=lambda span: span.first))


def _as_given(perturbation: dict[str, Any], scenario: ScenarioConfig) -> dict[str, Any]:
    """The perturbation as in the schedule, without what it drew (which differs from world to world)."""
    given = (entry["do"] for entry in scenario.perturbations)
    return next((do for do in given if do.items() <= perturbation.items()), perturbation)


def _short(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _in_words(perturbation: dict[str, Any]) -> str:
    given = ", ".join(f"{key} {_short(value)}" for key, value in perturbation.items() if key != "type")
    return f"{perturbation['type']} ({given})" if given else str(perturbation["type"])


def _summary_table(finished: Finished, scenario: ScenarioConfig, rows: pd.DataFrame) -> Table:
    suite, cap = finished.suite, scenario.env.max_episode_steps
    columns = ["when", "worlds", "lifetime motions", "success", "motions per reach", "distance (mm)"]
    table = Table(["agent", *columns], [])

    def of_worlds(count: int) -> str:
        return f"{count} of {suite.worlds}"

    for agent in suite.agents:
        found = moments(rows, agent.label, suite.worlds, cap)
        if not found:
            table.rows.append([agent.label, "no run finished", of_worlds(0), "–", "0 %", f"{cap}", "–"])
        for name in _MOMENTS:
            if name in found:
                moment = found[name]
                table.rows.append(
                    [
                        agent.label,
                        name,
                        of_worlds(moment.worlds),
                        _range(*moment.lifetime_motions),
                        _percent(moment.success),
                        _number(moment.motions_per_reach),
                        f"{moment.distance_mm:.1f}",
                    ]
                )
    return table


def _range(low: int, high: int) -> str:
    return f"{low:,}" if low == high else f"{low:,} – {high:,}"


def _percent(cell: Cell) -> str:
    return f"{cell.value:.0%} [{cell.low:.0%}, {cell.high:.0%}]".replace("%", " %")


def _number(cell: Cell) -> str:
    return f"{cell.value:.1f} [{cell.low:.1f}, {cell.high:.1f}]"


def _told(finished: Finished) -> Section:
    told: dict[str, str] = {}
    seconds: dict[str, float] = {}
    for spec in finished.runs:
        if outcome := finished.outcomes.get(spec.id):
            told[spec.agent.label] = ", ".join(outcome["told"]) or "nothing"
            spent = seconds.get(spec.agent.label, 0.0)
            seconds[spec.agent.label] = spent + outcome["wall_seconds"]
    rows = [
        [
            agent.label,
            agent.name,
            told.get(agent.label, "unknown: no run finished"),
            json.dumps(agent.settings) if agent.settings else "defaults",
            f"{seconds.get(agent.label, 0.0):,.0f}",
        ]
        for agent in finished.suite.agents
    ]
    header = ["agent", "kind", "told, beside the image points", "settings", "computing (s)"]
    return Section(title="What each agent was told", table=Table(header, rows))


def _versions(finished: Finished) -> Section:
    found: dict[str, set[str]] = {}
    for spec in finished.runs:
        made_by = folder_of(finished.out, spec.id) / VERSIONS
        if made_by.exists():
            for name, version in read_json(made_by).items():
                found.setdefault(name, set()).add(version)
    rows = [[name, ", ".join(sorted(versions))] for name, versions in found.items()]
    return Section(title="Versions", table=Table(["what", "version"], rows))


def _provenance(finished: Finished) -> Section:
    config = yaml.safe_dump(finished.suite.model_dump(mode="json"), sort_keys=False)
    return Section(
        title="How this was made",
        text="The command, and the whole configuration that it resolved to.",
        code=f"$ {finished.command}\n\n{config}",
    )
