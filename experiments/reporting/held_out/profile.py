"""Performance profiles: the share of trials that end within so many pixels of the object."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator, PercentFormatter

from experiments.config.suite import ScenarioConfig
from experiments.evaluation import THRESHOLDS_PX
from experiments.reporting.finished_suite import ENOUGH_WORLDS, FinishedSuite, few_worlds, places
from experiments.reporting.held_out.estimates import Moment
from experiments.reporting.pages import Section, summary_row
from experiments.reporting.pages.style import STYLE, draw_band, legend_below, line_of, save
from experiments.reporting.tables import Table, percent
from experiments.statistics import Estimate, performance_profile

FINE_PX = tuple(np.geomspace(THRESHOLDS_PX[0], THRESHOLDS_PX[-1], 25))
_HOW_TO_READ = (
    "The share of held-out trials at the end of the lifetimes whose true error, the larger of both "
    "images', ended within so many pixels of 512: mean over worlds, with its 95 % interval over "
    "worlds. Errors count whether a rendezvous was observed or not. A run that did not finish has "
    "none within."
)


def profile_section(
    finished: FinishedSuite, scenario: ScenarioConfig, found: dict[str, dict[str, Moment]], said: str
) -> Section:
    """The profiles of all agents at the end of their lifetimes, as a figure and as a table.

    Args:
        finished: The suite.
        scenario: What the moments are of.
        found: By the agent's label.
        said: Stands below the figure.
    """
    ends = {agent: of["at the end"] for agent, of in found.items() if "at the end" in of}
    name, worlds = f"{scenario.name}-profile", finished.fewest_worlds(scenario)
    lines, summary = [], []
    for agent, moment in ends.items():
        profile = performance_profile(moment.errors_px, THRESHOLDS_PX)
        lines.append([agent, *map(percent, profile)])
        where = scenario.name, "profile", agent
        summary += [
            summary_row(*where, f"{px} px", "within", share, len(moment.worlds))
            for px, share in zip(THRESHOLDS_PX, profile, strict=True)
        ]
    columns = ["agent", *(f"within {px} px" for px in THRESHOLDS_PX)]
    title = f"{scenario.name}: true errors at the end of held-out trials"
    figure = _figure(title, ends, places(finished.suite, scenario), worlds, said)
    return Section(
        title=f"{scenario.name}: errors at the end",
        text=f"Performance profiles.{few_worlds(finished, scenario)}",
        figures={name: save(figure, finished.out / "figures", name)},
        tables=(Table(name, f"{scenario.name}, errors at the end", pd.DataFrame(lines, columns=columns)),),
        note=_HOW_TO_READ,
        summary=summary,
    )


def _figure(title: str, ends: dict[str, Moment], places: dict[str, int], worlds: int, said: str) -> Figure:
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(5, 5.6), layout="constrained")
        for agent, moment in ends.items():
            profile = performance_profile(moment.errors_px, FINE_PX)
            line = {**line_of(places[agent]), "marker": ""}
            alone = (moment.errors_px[:, :, None] <= FINE_PX).mean(axis=1) if worlds < ENOUGH_WORLDS else ()
            draw_band(axes, FINE_PX, *_edges(profile), label=agent, line=line, alone=alone)
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(FixedLocator(list(THRESHOLDS_PX)))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_xlabel("true error at the end, at most (px of 512)")
        axes.set_ylabel("trials (%)")
        axes.yaxis.set_major_formatter(PercentFormatter(1.0, symbol=""))
        axes.set_ylim(-0.03, 1.05)
        figure.suptitle(title, x=0.01, ha="left", fontweight="bold")
        legend_below(figure, [axes], said, columns=2)
    return figure


def _edges(found: list[Estimate]) -> tuple[list[float], list[float], list[float]]:
    return [e.value for e in found], [e.low for e in found], [e.high for e in found]
