import pandas as pd

from experiments.config.suite import Suite
from experiments.reporting.finished_suite import (
    about,
    few_worlds,
)


def test_one_world_is_one_world(suite_data):
    alone, two = (Suite.model_validate({**suite_data, "worlds": worlds}) for worlds in (1, 2))
    assert few_worlds(alone).startswith(" With 1 world, fewer than 20,")
    assert few_worlds(two).startswith(" With 2 worlds, fewer than 20,")
    assert ", 1 world, the same for every agent" in about(alone, alone.scenarios[0])


def test_a_summary_has_every_number_of_the_report(finished_once):
    summary = pd.read_csv(finished_once / "summary.csv", dtype={"commit": str})
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
