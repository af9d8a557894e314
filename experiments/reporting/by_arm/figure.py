"""Motions per reach of each agent with each arm: a row an arm, a point an agent."""

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator

from experiments.config.suite import AgentConfig
from experiments.reporting.agents_in_words import in_words
from experiments.reporting.pages.style import STYLE, Line, say
from experiments.statistics import Array


def arms_figure(
    motors: Mapping[str, int],
    moments: Mapping[str, str],
    found: Mapping[tuple[str, str, str], Array],
    agents: Sequence[tuple[AgentConfig, Line]],
    cap: int,
    said: str,
) -> Figure:
    """A panel for each moment; arms of few motors above. Points: the median world.

    Args:
        motors: By the arm's name, how many it has.
        moments: By the panel's title, the block of trials.
        found: By arm, agent and block: motions per reach in each world.
        agents: With their lines.
        cap: The most motions.
        said: Stands below the panels.
    """
    rows = sorted(motors, key=lambda arm: motors[arm])
    with plt.rc_context(STYLE):
        figure, panels = plt.subplots(
            1, len(moments), figsize=(9.4, 1.2 + 0.3 * len(rows)), sharey=True, layout="constrained"
        )
        for axes, (title, block) in zip(panels, moments.items(), strict=True):
            for i, (agent, line) in enumerate(agents):
                shift = 0.6 * ((i + 0.5) / len(agents) - 0.5)
                axes.plot(
                    [np.median(found[arm, agent.label, block]) for arm in rows],
                    [row + shift for row in range(len(rows))],
                    **{**line, "linestyle": "", "marker": _MARKERS[i % len(_MARKERS)], "markersize": 5},
                    label=in_words(agent.label, agent.name),
                )
            axes.set_xscale("log")
            axes.set_xlim(0.9, 1.1 * cap)
            axes.xaxis.set_major_locator(FixedLocator([1, 2, 5, 10, 20, cap]))
            axes.xaxis.set_minor_locator(NullLocator())
            axes.xaxis.set_major_formatter("{x:g}")
            axes.set_xlabel("motions per reach")
            axes.set_title(title)
        panels[0].set_yticks(range(len(rows)), [f"{arm} ({motors[arm]} motors)" for arm in rows])
        panels[0].set_ylim(len(rows) - 0.5, -0.5)
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right upper")
        say(figure, f"Motions per reach with each arm (a failure counts as {cap})", said)
    return figure


_MARKERS = "osD^vPX"
