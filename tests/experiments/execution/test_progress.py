"""What is shown of a suite under way: a line where runs have ended, or a bar where somebody can see it."""

import io

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from experiments.execution.progress import KEPT, AtWork, Bar, KeptTimes, Lines, Standing, TimeLeft, in_words
from experiments.reporting.results_file import RESULTS, read_finished
from tests.experiments.fakes import runs

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


@given(
    st.lists(st.floats(1, 300), min_size=1, max_size=12),
    st.integers(1, 4),
    st.floats(0.3, 5),
)
def test_told_and_made_agree_where_all_runs_take_the_same_factor(seconds, at_once, factor):
    expected = {f"{i}": each for i, each in enumerate(sorted(seconds, reverse=True))}
    now, begun, waiting = 0.0, {}, list(expected)
    left = TimeLeft(dict(expected), at_once, lambda: now)
    told = [(now, left.seconds())]
    while waiting or begun:
        while waiting and len(begun) < at_once:
            begun[waiting[0]] = now
            left.has_made(waiting.pop(0), 0.0)
        over = min(begun, key=lambda run: begun[run] + factor * expected[run])
        now = begun.pop(over) + factor * expected[over]
        left.ends(over, factor * expected[over])
        for run, since in begun.items():
            left.has_made(run, (now - since) / (factor * expected[run]))
        told.append((now, left.seconds()))
    assert told[0][1] * factor == pytest.approx(now)
    assert told[-1][1] == 0
    for at, seconds_left in told:  # by a pace between the kept one and this machine's
        lowest, highest = sorted([now - at, (now - at) / factor])
        assert lowest * 0.999 - 1e-6 <= seconds_left <= highest * 1.001 + 1e-6


def test_a_run_under_way_shows_the_pace():
    now = 0.0
    left = TimeLeft({"long": 100.0, "short": 10.0}, 1, lambda: now)
    left.has_made("long", 0.0)
    now = 200.0
    assert left.seconds() == pytest.approx(110)  # nothing is known of this machine
    left.has_made("long", 0.5)
    assert left.seconds() == pytest.approx((50 + 10) * (20 + 200) / (20 + 50))


@pytest.mark.parametrize(
    ("seconds", "words"), [(0, "10 s"), (34, "30 s"), (56, "1 min"), (239, "4 min"), (7_000, "1.9 h")]
)
def test_times_are_rounded(seconds, words):
    assert in_words(seconds) == words


@pytest.mark.parametrize("suite", ["others", "quick"])
def test_kept_runs_are_expected_to_take_what_they_took(suite, tmp_path):
    kept, finished = KeptTimes(), read_finished(KEPT / suite / RESULTS, tmp_path)
    took = finished.timings.set_index("run")["wall_seconds"]
    expected = pd.Series({run.id: kept.seconds(run) for run in finished.runs})
    assert expected.sum() == pytest.approx(took.sum(), rel=0.6)
    assert expected.corr(took, "spearman") > 0.7  # so the longest come first


def test_without_kept_results_there_is_still_an_order(tmp_path, suite_data):
    agents = ["random", {"name": "unified_servo", "motions": 400}]
    short, _, long, _ = map(KeptTimes(tmp_path).seconds, runs(suite_data, agents=agents))
    assert 0 < short < long
