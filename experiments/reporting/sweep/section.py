"""A sweep's part of the report."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from calfree_gym.perturbations import TYPES
from experiments.config.suite import SweepConfig
from experiments.reporting.agents_in_words import lines_of
from experiments.reporting.finished_suite import (
    MOTIONS,
    RENDEZVOUS,
    SUCCESS,
    FinishedSuite,
    about_environment,
    few_worlds,
    where_it_stands,
    worlds_of,
)
from experiments.reporting.pages import Drawing, Section, SummaryRow, summary_row
from experiments.reporting.pages.style import save
from experiments.reporting.sweep.estimates import Point, points
from experiments.reporting.sweep.figure import Curves, sweep_figure, sweeps_figure
from experiments.reporting.tables import NOTHING, Table, counted, number, percent

_SHOWN = 5
"""Values that stand in the table; the figure has all."""

_ALL = "_all"

_HOW_TO_READ = (
    "Of the trials in whose first observation both cameras see gripper and object, the same for every "
    "agent. Success: the share whose true error at the end is within the tolerance. Rendezvous: the share "
    "that ends with an observed one. Motions: the median of those with one, where at least a tenth has "
    "one. Brackets: 95 % intervals over worlds, one trial in each."
)


def sweep_sections(finished: FinishedSuite) -> list[Section]:
    """Where there are several sweeps, all in one figure; then each with a figure and a table."""
    suite, sweeps = finished.suite, finished.suite.sweeps
    curves = {
        sweep.name: {
            agent.label: points(finished.results, sweep, agent.label, worlds_of(suite, agent.label))
            for agent in suite.agents_in(sweep)
        }
        for sweep in sweeps
    }

    lines = lines_of(suite.agents)
    drawn: dict[str, Curves] = {
        sweep.name: [
            (agent, curves[sweep.name][agent.label], lines[agent.label]) for agent in suite.agents_in(sweep)
        ]
        for sweep in sweeps
    }

    def said(sweep: SweepConfig) -> str:
        worlds = (worlds_of(suite, agent.label) for agent in suite.agents_in(sweep))
        return where_it_stands(sweep, "One trial at each value", *worlds)

    def saved(name: str, figure: Figure) -> dict[str, Drawing]:
        return {name: save(figure, finished.out / "figures", name)}

    each = [
        Section(
            title=f"Sweep {sweep.name}",
            text=_about(finished, sweep),
            figures=saved(sweep.name, sweep_figure(sweep, drawn[sweep.name], said(sweep))),
            tables=(_table(curves[sweep.name], sweep),),
            note=_HOW_TO_READ,
            summary=_summary(curves[sweep.name], sweep),
        )
        for sweep in sweeps
    ]
    if len(sweeps) < 2:
        return each
    together = saved(_ALL, sweeps_figure(sweeps, drawn, said(sweeps[0])))
    return [Section(title="All sweeps", figures=together), *each]


def _about(finished: FinishedSuite, sweep: SweepConfig) -> str:
    do = sweep.do
    settings = [f"{key} {value}" for key, value in do.items() if key != "type"]
    settings += [f"any {key}" for key in TYPES[do["type"]].settings() if key not in (*do, sweep.vary)]
    settings.append(f"{sweep.vary} from {sweep.over[0]:g} to {sweep.over[-1]:g}")
    return (
        f"{do['type']} ({', '.join(settings)}) before the first trial; {about_environment(sweep.env)}, at "
        f"most {sweep.env.max_episode_steps} motions. At each value every agent, without learning, makes "
        f"one trial in each of {counted(finished.fewest_worlds(sweep), 'world')}, the same for all agents "
        f"and values.{few_worlds(finished, sweep)}"
    )


def _table(found: dict[str, list[Point]], sweep: SweepConfig) -> Table:
    indices = np.unique(np.linspace(0, len(sweep.over) - 1, _SHOWN).round().astype(int))
    rows = [
        [
            label,
            f"{curve[i].value:g}",
            percent(point.rendezvous) if (point := curve[i]).rendezvous else NOTHING,
            number(point.among_reached) if point.among_reached else NOTHING,
            percent(point.success) if point.success else NOTHING,
        ]
        for label, curve in found.items()
        for i in indices
    ]
    columns = ["agent", sweep.vary, "rendezvous", "motions of those that reached", "success"]
    return Table(sweep.name, f"Sweep {sweep.name}", pd.DataFrame(rows, columns=columns))


def _summary(found: dict[str, list[Point]], sweep: SweepConfig) -> list[SummaryRow]:
    return [
        summary_row(sweep.name, "sweep", agent, f"{point.value:g}", measure, number, point.trials)
        for agent, of_agent in found.items()
        for point in of_agent
        for measure, number in (
            (SUCCESS, point.success),
            (RENDEZVOUS, point.rendezvous),
            ("rendezvous_at_once", point.at_once),
            (MOTIONS, point.motions),
            ("median_motions", point.among_reached),
        )
    ]
