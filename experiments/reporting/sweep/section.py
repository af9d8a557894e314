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
)
from experiments.reporting.pages import Drawing, Section, SummaryRow, summary_row
from experiments.reporting.pages.headline import in_words
from experiments.reporting.pages.style import save
from experiments.reporting.sweep.estimates import Point, points, rendezvous_shares
from experiments.reporting.sweep.figure import Curves, sweep_figure, sweeps_figure
from experiments.reporting.tables import Table, counted, number, percent

_SHOWN = 5
"""Values that stand in the table; the figure has all."""

_ALL = "_all"

_HOW_TO_READ = (
    "In view: trials in whose first observation both cameras see gripper and object, the same for "
    "every agent; the others are excluded. Success: the share whose true error at the end is within "
    "the tolerance. Rendezvous: the share that ends with an observed one; in brackets the share that "
    "its first motion brings there, if any. Motions per reach: mean, a trial without a rendezvous "
    "counting as the cap; among reached: median of those with one, where at least a tenth has one. 95 "
    "% intervals over worlds, one trial in each."
)


def sweep_sections(finished: FinishedSuite) -> list[Section]:
    """Where there are several sweeps, all in one figure; then each with a figure and a table."""
    suite, sweeps = finished.suite, finished.suite.sweeps
    curves = {
        sweep.name: {
            agent.label: points(finished.results, sweep, agent.label, suite.worlds)
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
        return where_it_stands(sweep, "One trial at each value", suite.worlds)

    def saved(name: str, figure: Figure) -> dict[str, Drawing]:
        return {name: save(figure, finished.out / "figures", name)}

    each = [
        Section(
            title=f"Sweep {sweep.name}",
            said=in_words(finished, sweep, RENDEZVOUS, _decisive(finished, sweep)),
            text=_about(finished, sweep),
            figures=saved(sweep.name, sweep_figure(sweep, drawn[sweep.name], said(sweep))),
            table=_table(curves[sweep.name], sweep),
            note=_HOW_TO_READ,
            summary=_summary(curves[sweep.name], sweep),
        )
        for sweep in sweeps
    ]
    if len(sweeps) < 2:
        return each
    together = saved(_ALL, sweeps_figure(sweeps, drawn, said(sweeps[0])))
    return [Section(title="All sweeps", figures=together), *each]


def _decisive(finished: FinishedSuite, sweep: SweepConfig) -> dict[str, dict[str, "pd.Series[float]"]]:
    """Each world's share of rendezvous over all values, and at the first and the last one."""
    labels = [agent.label for agent in finished.suite.agents_in(sweep)]
    chosen = {"over all values": sweep.over}
    chosen |= {f"at {sweep.vary} {each:g}": (each,) for each in (sweep.over[0], sweep.over[-1])}
    return {
        when: {label: rendezvous_shares(finished.results, sweep, label, values) for label in labels}
        for when, values in chosen.items()
    }


def _about(finished: FinishedSuite, sweep: SweepConfig) -> str:
    do = sweep.do
    settings = [f"{key} {value}" for key, value in do.items() if key != "type"]
    settings += [f"any {key}" for key in TYPES[do["type"]].settings() if key not in (*do, sweep.vary)]
    settings.append(f"{sweep.vary} from {sweep.over[0]:g} to {sweep.over[-1]:g}")
    return (
        f"{do['type']} ({', '.join(settings)}) before the first trial; {about_environment(sweep.env)}, "
        f"at most {sweep.env.max_episode_steps} motions. At each value every agent, without learning, makes "
        f"one trial in each of {counted(finished.suite.worlds, 'world')}, the same for all agents and values."
        + few_worlds(finished.suite)
    )


def _table(found: dict[str, list[Point]], sweep: SweepConfig) -> Table:
    indices = np.unique(np.linspace(0, len(sweep.over) - 1, _SHOWN).round().astype(int))
    first = next(iter(found.values()))
    rows = [["trials in view", "", *(f"{first[i].trials} of {first[i].worlds}" for i in indices)]]
    for label, curve in found.items():
        cells = [_cells(curve[i]) for i in indices]
        heads = (label, "", "", "")
        rows += [
            [head, what, *(of[what] for of in cells)] for head, what in zip(heads, cells[0], strict=True)
        ]
    columns = ["agent", sweep.vary, *(f"{sweep.over[i]:g}" for i in indices)]
    return Table("sweep", sweep.name, pd.DataFrame(rows, columns=columns))


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


def _cells(point: Point) -> dict[str, str]:
    at_once = f" ({point.at_once:.0%})".replace("%", " %") if point.at_once else ""
    return {
        "success": percent(point.success) if point.success else "–",
        "rendezvous": percent(point.rendezvous) + at_once if point.rendezvous else "–",
        "motions per reach": number(point.motions) if point.motions else "–",
        "among reached": f"{point.among_reached.value:g}" if point.among_reached else "–",
    }
