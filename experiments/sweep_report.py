"""A sweep's part of the report."""

import numpy as np

from experiments import figures
from experiments.config import SweepConfig
from experiments.finished import Finished
from experiments.pages import Section, Table, percent
from experiments.sweep_figure import sweep_figure
from experiments.sweep_summary import Point, points

_SHOWN = 5
"""Values that stand in the table; the figure has all."""

_HOW_TO_READ = (
    "In view: trials in whose first look both cameras show gripper and object, the same for every agent; "
    "the others stand apart, and are in no other number. Success: the share that reaches by the noise-free "
    "truth, with the 95 % Wilson interval. Then the median motions of those that reach; in brackets the "
    "share that its first motion brings there."
)


def sweep_section(finished: Finished, sweep: SweepConfig) -> Section:
    """The curves of one sweep, and a table at some of its values."""
    labels = [agent.label for agent in finished.suite.agents]
    found = {label: points(finished.results, sweep, label, finished.suite.worlds) for label in labels}
    figure = sweep_figure([sweep], lambda _, label: found[label], labels)
    return Section(
        title=f"Sweep {sweep.name}",
        text=_about(finished, sweep),
        figures={sweep.name: figures.save(figure, finished.out / "figures", sweep.name)},
        table=_table(found, sweep, finished.suite.worlds),
        note=_HOW_TO_READ,
    )


def _about(finished: Finished, sweep: SweepConfig) -> str:
    env = sweep.env
    given = ", ".join(f"{key} {value}" for key, value in sweep.do.items() if key != "type")
    return (
        f"{sweep.do['type']}{f' ({given})' if given else ''} with {sweep.vary} from {sweep.over[0]:g} to "
        f"{sweep.over[-1]:g}, before the first trial; {env.id}, {env.world} worlds, cameras on the "
        f"{env.camera_mount}, tolerance {env.tolerance_px:g} px, {env.dynamics} dynamics, at most "
        f"{env.max_episode_steps} motions. At each value every agent, untaught, makes one trial in each of "
        f"{finished.suite.worlds} worlds, the same for all agents and values."
    )


def _table(found: dict[str, list[Point]], sweep: SweepConfig, worlds: int) -> Table:
    indices = np.unique(np.linspace(0, len(sweep.over) - 1, _SHOWN).round().astype(int))
    counts = next(iter(found.values()))
    in_view = [f"{counts[i].trials} of {worlds} in view" for i in indices]
    rows = [[label, *(_cell(curve[i]) for i in indices)] for label, curve in found.items()]
    return Table([sweep.vary, *(f"{sweep.over[i]:g}" for i in indices)], [["trials", *in_view], *rows])


def _cell(point: Point) -> str:
    if point.success is None:
        return "–"
    if point.motions is None:
        return percent(point.success)
    return f"{percent(point.success)}: {point.motions.value:g} ({point.at_once:.0%})"
