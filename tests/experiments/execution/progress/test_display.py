"""What is shown of a suite under way: a line where runs have ended, or a bar where somebody can see it."""

import io

import pytest
from rich.console import Console

from experiments.execution.progress.display import AtWork, Bar, Lines, Standing

AT_WORK = (AtWork("ppo in knocked, world 2", 1_000, 4_000, "motions"), AtWork("sac in aim", 3, 5, "trials"))


def test_lines_are_one_where_runs_have_ended(capsys):
    with Lines() as lines:
        for over in (0, 0, 3, 3, 36):
            lines.show(Standing(over, 36, 240.0, AT_WORK))
    assert capsys.readouterr().out == "3 of 36, about 4 min left\n36 of 36\n"


@pytest.mark.parametrize("width", [50, 120])
def test_a_bar_tells_what_each_worker_does(width):
    shown = io.StringIO()
    with Bar(Console(file=shown, force_terminal=True, width=width, color_system=None)) as bar:
        bar.say("36 runs")
        bar.show(Standing(3, 36, 240.0, AT_WORK))
    for text in ("36 runs", "3 of 36, about 4 min left", "ppo in knocked, world 2", "1,000 of 4,000 motions"):
        assert text in shown.getvalue()
