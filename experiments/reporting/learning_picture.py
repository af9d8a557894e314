"""The one picture of a comparison."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from experiments.config.suite import ScenarioConfig
from experiments.reporting.finished_suite import MOTIONS, FinishedSuite, places, with_cost, worlds_of
from experiments.reporting.held_out.estimates import held_out_curve
from experiments.reporting.pages.style import STYLE, draw_logarithmic, legend_below, line_of


def learning_picture(finished: FinishedSuite, scenario: ScenarioConfig) -> Figure:
    """Motions a reach of the median world in held-out trials, against motions lived."""
    rows = with_cost(finished.results, scenario)
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(7.6, 4.3), layout="constrained")
        for label, index in places(finished.suite, scenario).items():
            curve = held_out_curve(rows, label, MOTIONS, worlds_of(finished.suite, label), scenario)
            at = np.maximum(curve.motions, 1)
            axes.plot(at, [each.value for each in curve.estimates()], label=label, **line_of(index))
        draw_logarithmic(axes)
        axes.set_xscale("log")
        axes.set_xlabel("motions lived")
        axes.set_ylabel("motions a reach")
        legend_below(figure, [axes], "Lines: the median world.")
    return figure
