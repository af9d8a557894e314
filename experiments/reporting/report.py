"""A finished suite as one HTML page, one Markdown page, figures and a summary of all numbers."""

import hashlib
import json
from pathlib import Path

import pandas as pd
import yaml

from experiments.reporting.by_arm.section import arms_sections, many_arms
from experiments.reporting.by_trial.section import trial_section
from experiments.reporting.claims.section import claims_section
from experiments.reporting.claims.verdicts import judge
from experiments.reporting.finished_suite import FinishedSuite
from experiments.reporting.held_out.section import scenario_sections
from experiments.reporting.pages import Section
from experiments.reporting.pages.html import html_page
from experiments.reporting.pages.markdown import markdown_page
from experiments.reporting.results_file import TIMES
from experiments.reporting.sweep.section import sweep_sections
from experiments.reporting.tables import Table
from experiments.running.results_folder import LOG, folder_of, made_folder, write_whole

SUMMARY, PAGE, MARKDOWN = "summary.csv", "report.html", "report.md"


def write_report(finished: FinishedSuite) -> Path:
    """Writes `summary.csv`, `report.html`, `report.md` and `figures/` into the suite's folder.

    All are made from the finished runs alone, so they are right also where the suite was interrupted.

    Args:
        finished: The suite.

    Returns:
        The path of the HTML page.
    """
    out = made_folder(finished.out)
    sections = [_failures(finished)] if finished.unfinished else []
    if finished.suite.claims:
        sections.append(claims_section(judge(finished.results, finished.suite)))
    by_arm = many_arms(finished.suite.scenarios)
    sections += arms_sections(finished) if by_arm else []
    for scenario in finished.suite.scenarios:
        if finished.suite.evaluation_of(scenario):
            sections += scenario_sections(finished, scenario)
        if scenario.trials and not by_arm:
            sections.append(trial_section(finished, scenario))
    sections += sweep_sections(finished)
    sections += [agents_section(finished), _versions(finished), _provenance(finished)]
    write_whole(out / SUMMARY, _summary(finished, sections).to_csv(index=False))
    title, question = finished.suite.name, finished.suite.question
    page = out / PAGE
    write_whole(page, html_page(title, question, sections))
    write_whole(out / MARKDOWN, markdown_page(title, question, sections))
    return page


def _failures(finished: FinishedSuite) -> Section:
    counted = "They count as no success and as the most motions, in every number and curve."
    tails = []
    for run in finished.unfinished:
        log = folder_of(Path(), run.id) / LOG
        tails.append("\n".join([f"{run.id}  ({log})", *finished.failures.get(run.id, ["(never finished)"])]))
    return Section(
        title=f"{len(finished.unfinished)} of {len(finished.runs)} runs FAILED or did not finish",
        said=(counted,),
        text=counted,
        code="\n\n".join(tails),
        alarming=True,
    )


def agents_section(finished: FinishedSuite) -> Section:
    """What each agent must know, how it was set, and what it took to compute."""
    rows = []
    for agent in finished.suite.agents:
        mine = finished.timings[finished.timings["run"].isin(finished.runs_of(agent))]
        rows.append(
            [
                agent.label,
                agent.name,
                finished.must_know(agent),
                json.dumps(agent.settings) if agent.settings else "defaults",
                f"{mine['wall_seconds'].sum():,.0f}" if len(mine) else "–",
                *(_milliseconds(mine[what]) for what in ("decision", "learning")),
            ]
        )
    columns = ["agent", "kind", "what it must know", "settings", "computing (s)"]
    columns += ["decision (ms)", "learning (ms a motion)"]
    frame = pd.DataFrame(rows, columns=columns)
    return Section(
        title="What each agent must know",
        table=Table("agents", "Agents", frame),
        note="Computing: wall-clock time of all runs, with simulation and evaluation. Decision, learning: "
        "CPU time a motion without the simulation, median over runs; learning includes the decision. These "
        f"three are of this repetition, and stand in {TIMES}; all other numbers are the same in each.",
    )


def _milliseconds(seconds: "pd.Series[float]") -> str:
    """The median over runs."""
    middle = seconds.astype(float).median()
    return "–" if pd.isna(middle) else f"{1000 * middle:.2g}"


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
