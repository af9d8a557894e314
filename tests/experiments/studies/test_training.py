"""Training over worlds: who is looked at, when and where, and the figure of it."""

import pandas as pd
import pytest

from experiments.studies import training
from experiments.studies.training import KNOWN, MINUTES, UNSEEN


@pytest.fixture
def one_process(monkeypatch):
    side_by_side = training.side_by_side
    monkeypatch.setattr(training, "side_by_side", lambda: side_by_side(1))


@pytest.mark.slow
def test_each_run_is_looked_at_when_it_has_had_its_cpu_time(one_process):
    (table,) = training.tables(minutes=(0.02, 0.04), runs=2, trials=2)
    of_runs = table.frame[table.frame[MINUTES] > 0]
    assert sorted(set(of_runs["agent"])) == [
        f"{name}, run {run}" for name in ("ppo", "recurrent_ppo") for run in (1, 2)
    ]
    assert (of_runs.groupby("agent")["motions"].diff().dropna() > 0).all()
    assert table.frame[[KNOWN, UNSEEN]].stack().between(1, 60).all()
    servo = table.frame.set_index("agent").loc["unified_servo"]
    assert servo[KNOWN] < 20 > servo[UNSEEN]


def test_the_figure_has_a_thin_line_a_run_and_a_thick_one_where_half_of_them_are():
    rows = [("random", 0, 0, 60, 59), ("unified_servo", 0, 0, 7, 6)]
    for name in training.LEARNERS:
        rows += [(f"{name}, run {run}", t, 64, 5, 10 * run - t) for run in (1, 2, 3) for t in (1, 2)]
    frame = pd.DataFrame(rows, columns=["agent", MINUTES, "motions", KNOWN, UNSEEN])
    axes = training.figure([training.Table("training", "", frame)]).axes[0]
    on_axes = [line.get_ydata().tolist() for line in axes.lines if line.get_transform() == axes.transData]
    thin = [[9, 8], [19, 18], [29, 28]]
    assert on_axes == [[59, 59], [6, 6], *thin, thin[1], *thin, thin[1]]
