"""Motions per reach of each agent with each arm: a row an arm, a point an agent."""

from collections.abc import Mapping

import matplotlib.pyplot as plt
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from experiments.reporting.pages.style import STYLE, legend_below, line_of
from experiments.statistics import Estimate


def arms_figure(
    motors: Mapping[str, int],
    moments: Mapping[str, str],
    found: Mapping[tuple[str, str, str], Estimate],
    places: Mapping[str, int],
    cap: int,
    said: str,
) -> Figure:
    """A panel for each moment; arms of few motors above.

    Args:
        motors: By the arm's name, how many it has.
        moments: By the panel's title, the block of trials.
        found: Motions per reach by arm, agent and block.
        places: By each agent's label, which colour it has.
        cap: The most motions.
        said: Stands below the panels.
    """
    rows = sorted(motors, key=lambda arm: motors[arm])
    with plt.rc_context({**STYLE, "axes.titlepad": 6}):
        figure, panels = plt.subplots(
            1, len(moments), figsize=(9, 1.6 + 0.36 * len(rows)), sharey=True, layout="constrained"
        )
        for axes, (title, block) in zip(panels, moments.items(), strict=True):
            for agent, index in places.items():
                of_arms = [found[arm, agent, block] for arm in rows]
                shift = 0.6 * ((index + 0.5) / len(places) - 0.5)
                line = {**line_of(index), "linestyle": "", "elinewidth": 1}
                axes.errorbar(
                    [each.value for each in of_arms],
                    [row + shift for row in range(len(rows))],
                    xerr=[
                        [each.value - each.low for each in of_arms],
                        [each.high - each.value for each in of_arms],
                    ],
                    label=agent,
                    **line,
                )
            axes.set_xscale("log")
            axes.set_xlim(0.9, 1.1 * cap)
            axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axes.xaxis.set_major_formatter("{x:g}")
            axes.xaxis.set_minor_formatter(NullFormatter())
            axes.set_xlabel("motions per reach")
            axes.set_title(title)
        panels[0].set_yticks(range(len(rows)), [f"{arm} ({motors[arm]} motors)" for arm in rows])
        panels[0].set_ylim(len(rows) - 0.5, -0.5)
        figure.suptitle("Agents by arms", x=0.01, ha="left", fontweight="bold")
        legend_below(figure, [panels[0]], said, columns=4)
    return figure
