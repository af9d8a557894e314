from pathlib import Path

import pandas as pd

from experiments.config.suite import Suite
from experiments.reporting.finished_suite import FinishedSuite, about, few_worlds
from experiments.running.run import runs_of


def of_suite(suite):
    return FinishedSuite(Path(), suite, "", runs_of(suite), {}, {}, {}, pd.DataFrame(), pd.DataFrame())


def test_one_world_is_one_world(suite_data):
    alone, two = (of_suite(Suite.model_validate({**suite_data, "worlds": worlds})) for worlds in (1, 2))
    assert few_worlds(alone, alone.suite.scenarios[0]).startswith(" 1 world, fewer than 20")
    assert few_worlds(two, two.suite.scenarios[0]).startswith(" 2 worlds, fewer than 20")
    assert ", 90 motions a life, 1 world, the same" in about(alone, alone.suite.scenarios[0])
    enough = of_suite(Suite.model_validate({**suite_data, "worlds": 20}))
    assert few_worlds(enough, enough.suite.scenarios[0]) == ""


def test_a_summary_has_every_number_of_the_report(finished_once):
    summary = pd.read_csv(finished_once / "summary.csv", dtype={"commit": str})
    moments = summary[summary["table"] == "held_out"]
    motions = {f"motions_per_reach{of}" for of in ("", "_among_reached")}
    assert set(moments["measure"]) == {"success", "rendezvous", "distance_mm", *motions}
    assert len(moments) == 2 * 3 * 5
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
