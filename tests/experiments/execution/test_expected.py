"""How long runs are expected to take, by kept results."""

import pandas as pd
import pytest

from experiments.execution.progress import KEPT, KeptTimes
from experiments.reporting.results_file import RESULTS, read_finished
from tests.experiments.fakes import runs


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
