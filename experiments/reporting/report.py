"""A finished suite as one HTML page, one Markdown page, figures and a summary of all numbers."""

import hashlib
import json
from pathlib import Path

import pandas as pd
import yaml

from experiments.reporting.by_trial import OwnTrials, arms_sections, many_arms, own_trials, trial_section
from experiments.reporting.claims import claims_section, judge, required_section
from experiments.reporting.figures import save
from experiments.reporting.finished_suite import FinishedSuite
from experiments.reporting.head import sentences, table_of
from experiments.reporting.held_out import HeldOut, held_out, held_out_sections
from experiments.reporting.learning_picture import learning_picture
from experiments.reporting.pages import MARKDOWN, PAGE, Drawing, Head, Section, html_page, markdown_page
from experiments.reporting.results_file import TIMES, gather, read_finished
from experiments.reporting.sweep import Swept, sweep_sections, swept
from experiments.reporting.tables import NOTHING, Table, show
from experiments.running.results_folder import FIGURES, LOG, folder_of, made_folder, write_whole

SUMMARY, TABLES = "summary.csv", "tables.json"
FILMS = ("film.gif", "film.png")
"""An agent at work, if one of these lies beside the results."""


def report(source: Path, out: Path | None) -> Path:
    """Prints the one table of a suite, and writes its report; returns the path of the HTML page.

    The source is its results folder, or the results.parquet of one, beside which the report stands if `out`
    is not given.
    """
    results = gather(source) if source.is_dir() or not source.suffix else source
    return write_report(read_finished(results, out or results.parent), show_head=True)


def write_report(finished: FinishedSuite, show_head: bool = False) -> Path:
    """Writes `report.html`, `report.md`, `tables.json`, `summary.csv` and `figures/` into the suite's folder.

    All are made from the finished runs alone, so they are right also where the suite was interrupted. Returns
    the path of the HTML page.
    """
    suite, of_head = finished.suite, finished.head_part
    held = {each.name: held_out(finished, each) for each in suite.scenarios if suite.evaluation_of(each)}
    own = {each.name: own_trials(finished, each) for each in suite.scenarios if each.trials}
    sweeps = {each.name: swept(finished, each) for each in suite.sweeps}
    found = own | held | sweeps
    tables = {part.name: table_of(finished, part, found[part.name]) for part in suite.parts}
    if show_head:
        show([tables[of_head.name]])
    out = made_folder(finished.out)
    comparison = _comparison(finished, held, own, sweeps)
    sections = [*comparison, agents_section(finished), computing_section(finished)]
    write_whole(out / SUMMARY, _summary(finished, sections).to_csv(index=False))
    kept = {
        "commit": finished.versions["commit"],
        "tables": [table.to_dict() for table in tables.values()],
        "details": [table.to_dict() for section in sections for table in section.tables],
    }
    write_whole(out / TABLES, json.dumps(kept, indent=1))
    head = head_of(finished, tables[of_head.name], held.get(of_head.name))
    failed = [_failures(finished)] if finished.unfinished else []
    versions = Table.of("versions", "Versions", ["what", "version"], list(finished.versions.items()))
    sections = [*failed, *sections, Section("Versions", tables=(versions,)), _provenance(finished)]
    write_whole(out / PAGE, html_page(head, sections))
    write_whole(out / MARKDOWN, markdown_page(head, sections))
    return out / PAGE


def head_of(finished: FinishedSuite, table: Table, held: HeldOut | None) -> Head:
    """What the report says in a minute: the table of its `head_part` and, of held-out trials, more."""
    figures = _drawn(finished, held) if held else {}
    said = sentences(finished, held) if held else []
    film = next(iter(films_in(finished.out)), None)
    return Head(finished.suite.name, finished.suite.question, figures, table, said, film)


def films_in(out: Path) -> list[Path]:
    """Films of an agent at work in a results folder; what only has the name of one is none."""
    found = [path for name in FILMS if (path := out / name).is_file() and not path.is_symlink()]
    return [path for path in found if path.read_bytes()[:4] in (b"GIF8", b"\x89PNG")]


def _drawn(finished: FinishedSuite, held: HeldOut) -> dict[str, Drawing]:
    """The figure of held-out trials, by the name of its files."""
    name = f"{held.scenario.name}-held-out"
    return {name: save(learning_picture(finished, held), finished.out / FIGURES, name)}


def _comparison(
    finished: FinishedSuite, held: dict[str, HeldOut], own: dict[str, OwnTrials], sweeps: dict[str, Swept]
) -> list[Section]:
    """All that was measured, part by part."""
    sections = []
    if finished.suite.claims:
        sections.append(claims_section(judge(finished.results, finished.suite)))
    if finished.suite.required:
        sections.append(required_section(finished.results, finished.suite))
    by_arm = many_arms(finished.suite.scenarios)
    sections += arms_sections(finished, [*own.values()]) if by_arm else []
    for scenario in finished.suite.scenarios:
        if scenario.name in held:
            above = scenario == finished.head_part  # which has it in the head
            figures = {} if above else _drawn(finished, held[scenario.name])
            sections += held_out_sections(finished, held[scenario.name], figures)
        if scenario.name in own and not by_arm:
            sections.append(trial_section(finished, own[scenario.name]))
    sections += sweep_sections(finished, [*sweeps.values()])
    return sections


def _failures(finished: FinishedSuite) -> Section:
    counted = "They count as no success and as the most motions, in every number and curve."
    tails = []
    for run in finished.unfinished:
        log = folder_of(Path(), run.id) / LOG
        tails.append("\n".join([f"{run.id}  ({log})", *finished.failures.get(run.id, ["(never finished)"])]))
    return Section(
        title=f"{len(finished.unfinished)} of {len(finished.runs)} runs FAILED or did not finish",
        text=counted,
        code="\n\n".join(tails),
        alarming=True,
    )


def agents_section(finished: FinishedSuite) -> Section:
    """What each agent must know, and how it was set."""
    rows = [
        [
            agent.label,
            agent.name,
            finished.must_know(agent),
            json.dumps(agent.settings) if agent.settings else "defaults",
        ]
        for agent in finished.suite.agents
    ]
    columns = ["agent", "kind", "what it must know", "settings"]
    return Section(title="What each agent must know", tables=(Table.of("agents", "Agents", columns, rows),))


def computing_section(finished: FinishedSuite) -> Section:
    """What each agent took to compute."""
    rows = []
    for agent in finished.suite.agents:
        mine = finished.timings[finished.timings["run"].isin(finished.runs_of(agent))]
        seconds = f"{mine['wall_seconds'].sum():,.0f}" if len(mine) else NOTHING
        rows.append([agent.label, seconds, *(_milliseconds(mine[what]) for what in ("decision", "learning"))])
    columns = ["agent", "all runs (s)", "decision (ms)", "learning (ms a motion)"]
    return Section(
        title="Computing time",
        tables=(Table.of("computing", "Computing time", columns, rows),),
        note="All runs: wall-clock time, with simulation and evaluation. Decision, learning: CPU time a "
        "motion without the simulation, median over runs; learning includes the decision. These are of "
        f"this repetition, and stand in {TIMES}; all other numbers are the same in each.",
    )


def _milliseconds(seconds: "pd.Series[float]") -> str:
    """The median over runs."""
    middle = seconds.astype(float).median()
    return NOTHING if pd.isna(middle) else f"{1000 * middle:.2g}"


def _summary(finished: FinishedSuite, sections: list[Section]) -> pd.DataFrame:
    """Every number of the report's tables: what it is of, its interval, and what made it."""
    numbers = pd.DataFrame([row for section in sections for row in section.summary])
    if numbers.empty:
        return numbers
    suite = finished.suite
    kinds = {agent.label: agent.name for agent in suite.agents}
    known = {agent.label: finished.must_know(agent) for agent in suite.agents}
    config = hashlib.sha256(json.dumps(suite.model_dump(mode="json"), sort_keys=True).encode())
    numbers = numbers.assign(
        kind=numbers["agent"].map(kinds),
        must_know=numbers["agent"].map(known),
        config=config.hexdigest()[:12],
    )
    for what, version in finished.versions.items():
        numbers[what] = version
    return numbers


def _provenance(finished: FinishedSuite) -> Section:
    config = yaml.safe_dump(finished.suite.model_dump(mode="json"), sort_keys=False)
    return Section(
        title="How this was made",
        text="The command, and the whole configuration that it resolved to.",
        code=f"$ {finished.command}\n\n{config}",
    )
