"""A finished suite as one HTML page, one Markdown page and figures."""

import json
from pathlib import Path

import yaml

from experiments.reporting.by_trial.section import trial_section
from experiments.reporting.held_out.section import scenario_section
from experiments.reporting.pages import Section, Table, html_page, markdown_page
from experiments.reporting.results import Finished, read
from experiments.reporting.sweep.section import sweep_sections
from experiments.running.results_folder import FAILED, LOG, VERSIONS, folder_of, read_json, write_whole


def write_report(out: Path) -> Path:
    """Writes `results.parquet`, `report.html`, `report.md` and `figures/` into a suite's folder.

    All are made from the finished runs of the suite that was run there last, so they are right also
    where it was interrupted.

    Returns:
        The path of the HTML page.

    Raises:
        ConfigError: No suite was run in the folder, or its runs were made by different versions.
    """
    finished = read(out)
    sections = [_failures(finished)] if finished.unfinished else []
    evaluation = finished.suite.evaluation
    for scenario in finished.suite.scenarios:
        if evaluation:
            sections.append(scenario_section(finished, scenario, evaluation))
        if scenario.trials:
            sections.append(trial_section(finished, scenario))
    sections += sweep_sections(finished)
    sections += [_told(finished), _versions(finished), _provenance(finished)]
    title, question = finished.suite.name, finished.suite.question
    page = out / "report.html"
    write_whole(page, html_page(title, question, sections))
    write_whole(out / "report.md", markdown_page(title, question, sections))
    return page


def _failures(finished: Finished) -> Section:
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
