"""A finished suite as one HTML page, one Markdown page, figures and a summary of all numbers."""

import hashlib
import json
from pathlib import Path

import pandas as pd
import yaml

from experiments.config.suite import ScenarioConfig
from experiments.reporting.by_arm.section import arms_sections, many_arms
from experiments.reporting.by_trial.section import trial_section
from experiments.reporting.claims.section import claims_section
from experiments.reporting.claims.verdicts import judge
from experiments.reporting.finished_suite import FinishedSuite
from experiments.reporting.held_out.section import scenario_sections
from experiments.reporting.learning_picture import learning_picture
from experiments.reporting.pages import Head, Section
from experiments.reporting.pages.head_table import head_part, head_table, table_of
from experiments.reporting.pages.html import html_page
from experiments.reporting.pages.markdown import markdown_page
from experiments.reporting.pages.sentences import sentences
from experiments.reporting.pages.style import save
from experiments.reporting.required import required_section
from experiments.reporting.results_file import gather, read_finished
from experiments.reporting.sweep.section import sweep_sections
from experiments.reporting.tables import NOTHING, Table, show
from experiments.running.finished import TIMES
from experiments.running.results_folder import LOG, folder_of, made_folder, write_whole

SUMMARY, TABLES, PAGE, MARKDOWN = "summary.csv", "tables.json", "report.html", "report.md"
FILMS = ("film.gif", "film.png")
"""An agent at work, if one of these lies beside the results."""


def report(source: Path, out: Path | None) -> Path:
    """Prints the one table of a suite, and writes its report.

    Args:
        source: Its results folder, or the results.parquet of one.
        out: Where the report shall stand, if not beside the results.

    Returns:
        The path of the HTML page.

    Raises:
        ConfigError: There are no results, or they are damaged.
    """
    results = gather(source) if source.is_dir() or not source.suffix else source
    finished = read_finished(results, out or results.parent)
    show([head_table(finished)])
    return write_report(finished)


def write_report(finished: FinishedSuite) -> Path:
    """Writes `report.html`, `report.md`, `tables.json`, `summary.csv` and `figures/` into the suite's folder.

    All are made from the finished runs alone, so they are right also where the suite was interrupted.

    Args:
        finished: The suite.

    Returns:
        The path of the HTML page.
    """
    out = made_folder(finished.out)
    sections = [*_comparison(finished), agents_section(finished), computing_section(finished)]
    write_whole(out / SUMMARY, _summary(finished, sections).to_csv(index=False))
    of_parts = {part.name: table_of(finished, part) for part in finished.suite.parts}
    tables = {
        "commit": finished.versions["commit"],
        "tables": [table.to_dict() for table in of_parts.values()],
        "details": [table.to_dict() for section in sections for table in section.tables],
    }
    write_whole(out / TABLES, json.dumps(tables, indent=1))
    head = head_of(finished, of_parts[head_part(finished).name])
    failed = [_failures(finished)] if finished.unfinished else []
    sections = [*failed, *sections, _versions(finished), _provenance(finished)]
    page = out / PAGE
    write_whole(page, html_page(head, sections))
    write_whole(out / MARKDOWN, markdown_page(head, sections))
    return page


def head_of(finished: FinishedSuite, table: Table) -> Head:
    """What the report says in a minute, with the table of `head_part`."""
    suite, part = finished.suite, head_part(finished)
    held_out = isinstance(part, ScenarioConfig) and suite.evaluation_of(part) is not None
    figures = {}
    if isinstance(part, ScenarioConfig) and held_out:
        name = f"{part.name}-held-out"
        figures[name] = save(learning_picture(finished, part), finished.out / "figures", name)
    film = next((path for name in FILMS if (path := finished.out / name).exists()), None)
    said = sentences(finished, part) if isinstance(part, ScenarioConfig) and held_out else []
    return Head(suite.name, suite.question, figures, table, said, film)


def _comparison(finished: FinishedSuite) -> list[Section]:
    """All that was measured, part by part."""
    sections = []
    if finished.suite.claims:
        sections.append(claims_section(judge(finished.results, finished.suite)))
    if finished.suite.required:
        sections.append(required_section(finished.results, finished.suite))
    by_arm = many_arms(finished.suite.scenarios)
    sections += arms_sections(finished) if by_arm else []
    for scenario in finished.suite.scenarios:
        if finished.suite.evaluation_of(scenario):
            sections += scenario_sections(finished, scenario)
        if scenario.trials and not by_arm:
            sections.append(trial_section(finished, scenario))
    sections += sweep_sections(finished)
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
    frame = pd.DataFrame(rows, columns=["agent", "kind", "what it must know", "settings"])
    return Section(title="What each agent must know", tables=(Table("agents", "Agents", frame),))


def computing_section(finished: FinishedSuite) -> Section:
    """What each agent took to compute."""
    rows = []
    for agent in finished.suite.agents:
        mine = finished.timings[finished.timings["run"].isin(finished.runs_of(agent))]
        seconds = f"{mine['wall_seconds'].sum():,.0f}" if len(mine) else NOTHING
        rows.append([agent.label, seconds, *(_milliseconds(mine[what]) for what in ("decision", "learning"))])
    columns = ["agent", "all runs (s)", "decision (ms)", "learning (ms a motion)"]
    frame = pd.DataFrame(rows, columns=columns)
    return Section(
        title="Computing time",
        tables=(Table("computing", "Computing time", frame),),
        note="All runs: wall-clock time, with simulation and evaluation. Decision, learning: CPU time a "
        "motion without the simulation, median over runs; learning includes the decision. These are of "
        f"this repetition, and stand in {TIMES}; all other numbers are the same in each.",
    )


def _milliseconds(seconds: "pd.Series[float]") -> str:
    """The median over runs."""
    middle = seconds.astype(float).median()
    return NOTHING if pd.isna(middle) else f"{1000 * middle:.2g}"


def _versions(finished: FinishedSuite) -> Section:
    frame = pd.DataFrame(finished.versions.items(), columns=["what", "version"])
    return Section(title="Versions", tables=(Table("versions", "Versions", frame),))


def _summary(finished: FinishedSuite, sections: list[Section]) -> pd.DataFrame:
    """Every number of the report's tables: what it is of, its interval, and what made it."""
    numbers = pd.DataFrame([row for section in sections for row in section.summary])
    if numbers.empty:
        return numbers
    suite = finished.suite
    kinds = {agent.label: agent.name for agent in suite.agents}
    known = {agent.label: finished.must_know(agent) for agent in suite.agents}
    config = hashlib.sha256(json.dumps(suite.model_dump(mode="json"), sort_keys=True).encode())
    return numbers.assign(
        kind=numbers["agent"].map(kinds),
        must_know=numbers["agent"].map(known),
        config=config.hexdigest()[:12],
        **finished.versions,
    )


def _provenance(finished: FinishedSuite) -> Section:
    config = yaml.safe_dump(finished.suite.model_dump(mode="json"), sort_keys=False)
    return Section(
        title="How this was made",
        text="The command, and the whole configuration that it resolved to.",
        code=f"$ {finished.command}\n\n{config}",
    )
