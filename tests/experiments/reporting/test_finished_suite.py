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
        spec.id: {"perturbations": [(motions, 0, "lens") for motions in of_run]}
        for spec, of_run in zip(runs, met, strict=False)
    }
    finished = FinishedSuite(tmp_path, suite, "", runs, outcomes, {}, {}, pd.DataFrame(), pd.DataFrame())
    assert perturbations_met(finished, suite.scenarios[0], "motions") == tuple(
        Perturbation(*s, "lens") for s in spans
    )


def test_a_summary_has_every_number_of_the_report(finished_once):
    summary = pd.read_csv(finished_once / "summary.csv")
    moments = summary[summary["table"] == "held_out"]
    motions = {f"motions_per_reach{of}" for of in ("", "_iqm", "_worst_decile", "_among_reached")}
    assert set(moments["measure"]) == {"success", "rendezvous", "distance_mm", *motions}
    assert len(moments) == 2 * 3 * 7
    assert set(summary["table"]) == {"held_out", "checkpoints", "profile", "threshold", "comparison"}
    assert summary[["config", "commit", "code", "mujoco"]].notna().all(axis=None)
    results = pd.read_parquet(finished_once / "results.parquet")
    end = results[(results["agent"] == "unified_servo") & (results["lifetime_motions"] == 90)]
    of_end = moments[(moments["agent"] == "unified_servo") & (moments["moment"] == "at the end")]
    of_end = of_end.set_index("measure")
    held_out = end[end["phase"] == "eval"]
    assert of_end.loc["success", "value"] == held_out["success"].mean()
    assert of_end.loc["success", "n"] == held_out["world"].nunique() == 2
    assert of_end.loc["distance_mm", "value"] == held_out["distance_mm"].median()
