"""A scenario's part of the report."""

from collections import Counter
from typing import Any

import pandas as pd

from calfree_gym.perturbations.undo import Undo
from experiments.config.suite import EvaluationConfig, ScenarioConfig, Suite
from experiments.reporting.held_out import figure as figures
from experiments.reporting.held_out.summary import held_out_curve, moments, training_curve, with_cost
from experiments.reporting.pages import Section, Table, number, percent
from experiments.reporting.results import Finished
from experiments.running.plan import LifeRun

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


def scenario_section(finished: Finished, scenario: ScenarioConfig, evaluation: EvaluationConfig) -> Section:
    """The learning curves of one scenario, and the table of their moments."""
    rows = with_cost(finished.results, scenario)
    suite, cap = finished.suite, scenario.env.max_episode_steps
    labels = tuple(agent.label for agent in suite.agents)
    width = max(evaluation.every, 2 * cap)
    perturbations = perturbations_met(finished, scenario, "motions")
    held_out = figures.learning_curves(
        f"{scenario.name}: held-out trials, {evaluation.trials} at each checkpoint",
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
        text=about(suite, scenario),
        figures={
            f"{scenario.name}-{what}": figures.save(figure, folder, f"{scenario.name}-{what}")
            for what, figure in (("held-out", held_out), ("training", training))
        },
        table=_summary_table(finished, scenario, rows),
        note=_HOW_TO_READ,
    )


def about(suite: Suite, scenario: ScenarioConfig) -> str:
    """What the runs of a scenario have in common, in words."""
    env = scenario.env
    length, of = scenario.length
    return (
        f"{env.id}, {env.world} worlds, cameras on the {env.camera_mount}, tolerance "
        f"{env.tolerance_px:g} px, {env.dynamics} dynamics, at most {env.max_episode_steps} "
        f"motions a trial, {length:,} {of} a life, {suite.worlds} worlds, the same "
        f"for every agent. Lines: mean over worlds; bands: 95 % bootstrap over worlds."
    )


def perturbations_met(
    finished: Finished, scenario: ScenarioConfig, of: str
) -> tuple[figures.Perturbation, ...]:
    """After how many motions, or trials (`of`), the runs were perturbed, and how; a span where they differ.

    Spans of the same perturbation that overlap, as where it comes at every trial, are one.
    """
    met: dict[tuple[str, int], list[int]] = {}
    for spec in finished.runs:
        if isinstance(spec, LifeRun) and spec.scenario == scenario and spec.id in finished.outcomes:
            seen: Counter[str] = Counter()
            for motions, trials, perturbation in finished.outcomes[spec.id]["perturbations"]:
                what = _in_words(perturbation, scenario)
                met.setdefault((what, seen[what]), []).append(motions if of == "motions" else trials)
                seen[what] += 1
    spans: list[figures.Perturbation] = []
    for (what, _), counts in sorted(met.items(), key=lambda item: (item[0][0], min(item[1]))):
        first, last = min(counts), max(counts)
        if spans and spans[-1].what == what and first <= spans[-1].last:
            first, last = spans[-1].first, max(last, spans.pop().last)
        spans.append(figures.Perturbation(first, last, what))
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
                        percent(moment.success),
                        number(moment.motions_per_reach),
                        f"{moment.distance_mm:.1f}",
                    ]
                )
    return table


def _range(low: int, high: int) -> str:
    return f"{low:,}" if low == high else f"{low:,} – {high:,}"
