import pandas as pd
import pytest

from experiments.config.suite import Suite
from experiments.reporting.finished_suite import FinishedSuite, Perturbation, perturbations_met
from experiments.running.plan import runs_of


@pytest.mark.parametrize(
    ("met", "spans"),
    [
        ([[50], [50], [50], [50]], [(50, 50)]),
        ([[50], [70], [60], []], [(50, 70)]),
        ([[50, 200], [70, 210]], [(50, 70), (200, 210)]),
        ([[50, 60, 90], [70, 95, 100]], [(50, 100)]),  # overlapping: 50-70, 60-95, 90-100
        ([], []),
    ],
)
def test_perturbations_are_marked_where_the_runs_met_them(suite_data, tmp_path, met, spans):
    suite = Suite.model_validate(suite_data)
    runs = runs_of(suite)
    outcomes = {
        spec.id: {"perturbations": [(motions, 0, {"type": "lens"}) for motions in of_run]}
        for spec, of_run in zip(runs, met, strict=False)
    }
    finished = FinishedSuite(tmp_path, suite, "", runs, outcomes, {}, pd.DataFrame())
    assert perturbations_met(finished, suite.scenarios[0], "motions") == tuple(
        Perturbation(*s, "lens") for s in spans
    )
