"""A finished suite as one HTML page, one Markdown page, figures and a summary of all numbers."""

import hashlib
import json
from pathlib import Path
from statistics import median
from typing import Any

import pandas as pd
import yaml

from experiments.cpu_time import CPU
from experiments.reporting.by_trial.section import trial_section
from experiments.reporting.claims.section import claims_section
from experiments.reporting.claims.verdicts import judge
from experiments.reporting.finished_suite import FinishedSuite, read_finished
from experiments.reporting.held_out.section import scenario_sections
from experiments.reporting.pages import Section, html_page, markdown_page
from experiments.reporting.sweep.section import sweep_sections
from experiments.reporting.tables import Table
from experiments.running.results_folder import FAILED, LOG, folder_of, read_json, write_whole

SUMMARY = "summary.csv"


def write_report(out: Path) -> Path:
    """Writes `results.parquet`, `summary.csv`, `report.html`, `report.md` and `figures/` into a folder.

    All are made from the finished runs of the suite that was run there last, so they are right also
    where it was interrupted.

    Returns:
        The path of the HTML page.

    Raises:
        ConfigError: No suite was run in the folder, or its runs were made by different versions.
    """
    finished = read_finished(out)
    sections = [_failures(finished)] if finished.unfinished else []
    if finished.suite.claims:
        sections.append(claims_section(judge(finished.results, finished.suite)))
    for scenario in finished.suite.scenarios:
        if evaluation := finished.suite.evaluation_of(scenario):
            sections += scenario_sections(finished, scenario, evaluation)
        if scenario.trials:
            sections.append(trial_section(finished, scenario))
    sections += sweep_sections(finished)
    sections += [_agents(finished), _versions(finished), _provenance(finished)]
    write_whole(out / SUMMARY, _summary(finished, sections).to_csv(index=False))
    title, question = finished.suite.name, finished.suite.question
    page = out / "report.html"
    write_whole(page, html_page(title, question, sections))
    write_whole(out / "report.md", markdown_page(title, question, sections))
    return page


def _failures(finished: FinishedSuite) -> Section:
    unfinished = finished.unfinished
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


def _agents(finished: FinishedSuite) -> Section:
    rows = []
    for agent in finished.suite.agents:
        times = finished.timings_of(agent)
        rows.append(
            [
                agent.label,
                agent.name,
                finished.must_know(agent),
                json.dumps(agent.settings) if agent.settings else "defaults",
                f"{sum(of_run['wall_seconds'] for of_run in times):,.0f}",
                *(_milliseconds(times, what) for what in ("decision", "learning")),
            ]
        )
    columns = ["agent", "kind", "what it must know", "settings", "computing (s)"]
    columns += ["decision (ms)", "learning (ms a motion)"]
    frame = pd.DataFrame(rows, columns=columns)
    return Section(
        title="What each agent must know",
        table=Table("agents", "Agents", frame),
        note="Computing: wall-clock time of all runs, with simulation and evaluation. Decision, learning: "
        "CPU time a motion without the simulation, median over runs; learning includes the decision.",
    )


def _milliseconds(timings: list[dict[str, Any]], what: str) -> str:
    """The median over runs; an agent that learns nothing has no time for it."""
    found = [of_run[CPU][what] for of_run in timings if what in of_run[CPU]]
    return f"{1000 * median(found):.2g}" if found else "–"


def _versions(finished: FinishedSuite) -> Section:
    frame = pd.DataFrame(finished.versions.items(), columns=["what", "version"])
    return Section(title="Versions", table=Table("versions", "Versions", frame))


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
