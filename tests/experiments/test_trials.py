"""Lifetimes counted in trials: their configuration, their blocks, and one from a YAML file to the report."""

import json
import re

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from experiments.__main__ import main
from experiments.config.suite import ScenarioConfig
from experiments.reporting.by_trial import (
    COARSE,
    FINE,
    LOOKS,
    OwnTrials,
    edges_of,
    seconds_at,
    seconds_per_reach,
    slowest_seconds,
    span,
    trial_picture,
    with_seconds,
)
from experiments.reporting.finished_suite import MOTIONS, SUCCESS, with_cost
from tests.experiments.reporting.made_up import finished_suite

AIM = {"at": {"trial": 4}, "do": {"type": "camera_aim", "camera": "left", "degrees": 10}}
BACK = {"at": {"trial": 6}, "undo": 0}


@pytest.fixture
def in_trials(suite_data):
    """The suite of seconds, its lifetimes counted in trials and without held-out ones."""
    del suite_data["scenarios"][0]["motions"]
    suite_data["scenarios"][0] |= {"trials": 8, "perturbations": [AIM, BACK]}
    return suite_data | {"evaluation": None, "agents": ["unified_servo", "grid_table"]}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"motions": 90}, "scenarios.0.trials: found 8: .* trials; both are given"),
        ({"trials": None}, "scenarios.0.trials: found None: .* trials; neither is given"),
        ({"trials": 0}, r"scenarios.0.trials: found 0: .*greater than 0"),
        ({"trials": 6}, "perturbations.1.at.trial is 6: never, in a lifetime of 6 trials"),
        (
            {"trials": None, "motions": 90},
            "scenario 'aimed' has 90 motions: only lifetimes counted in trials",
        ),
        ({"perturbations": [AIM, BACK | {"undo": 1}]}, "scenarios.0.perturbations.1.undo is 1; it must be"),
    ],
)
def test_a_lifetime_has_one_length(in_trials, refused, change, said):
    in_trials["scenarios"][0] |= change
    assert re.search(said, refused(in_trials))


def test_held_out_trials_are_never_rarer_than_a_lifetime_is_long(in_trials, refused):
    in_trials["evaluation"] = {"every": 161, "trials": 2}
    assert "scenario 'aimed' has at most 160 motions" in refused(in_trials)
    del in_trials["evaluation"]
    assert "evaluation.every is 1000; scenario 'aimed'" in refused(in_trials), "by default too"


def scenario(trials, *at):
    events = [{"at": {"trial": trial}, "do": {"type": "lens"}} for trial in at]
    env = {"id": "CalFree/Reach-v0", "world": "wild", "max_episode_steps": 20}
    return ScenarioConfig(name="s", env=env, trials=trials, perturbations=events)


def test_blocks_begin_anew_after_each_event():
    assert list(edges_of(scenario(60), FINE)) == [0, 1, 5, 10, 25, 50, 60]
    assert list(edges_of(scenario(20, 7, 12), FINE)) == [0, 1, 5, 7, 8, 12, 13, 17, 20]
    assert list(edges_of(scenario(400), COARSE)) == [0, 25, 50, 100, 150, 300, 400]
    assert list(edges_of(scenario(1), FINE)) == [0, 1]
    assert [span(0, 1), span(1, 5), span(1_000, 2_000)] == ["1", "2–5", "1,001–2,000"]


def own_trials(of, worlds, *rows):
    """From (world, trial, motions, success); a motion takes 3 s without its look, and the way home none."""
    data = pd.DataFrame(rows, columns=["world", "trial", "motions", "success"])
    data = data.assign(scenario=of.name, agent="servo", phase="train", rendezvous=data["success"])
    data = data.assign(robot_seconds=3.0 * data["motions"] + 4.0 * (data["motions"] + 1))
    return OwnTrials(of, with_seconds(with_cost(data, of), of), {"servo": worlds, "sac": worlds})


def test_blocks_are_means_of_trials_in_each_run():
    of = scenario(6)
    first = [(0, trial, motions, True) for trial, motions in enumerate([9, 4, 4, 2, 2, 1])]
    other = [(1, 0, 11, True), (1, 1, 10, False), *((1, trial, 2, True) for trial in (2, 3, 4, 5))]
    own = own_trials(of, 2, *first, *other)
    edges = edges_of(of, FINE)
    assert list(edges) == [0, 1, 5, 6]

    motions = own.blocks("servo", MOTIONS, edges)
    np.testing.assert_array_equal(motions.runs, [[9, 3, 1], [11, (20 + 3 * 2) / 4, 2]])
    found = motions.estimates()
    assert [each.value for each in found] == [10, 4.75, 1.5]

    for look in LOOKS:
        seconds = own.blocks("servo", seconds_at(look), edges)
        np.testing.assert_allclose(seconds.runs[0], 3 * motions.runs[0] + look * (motions.runs[0] + 1))
    assert seconds.runs[1, 1] == (2 * (30 + 4 * 11) + 3 * (6 + 12)) / 4  # the failed one goes on to 20
    success = own.blocks("servo", SUCCESS, edges)
    np.testing.assert_array_equal(success.runs, [[1, 1, 1], [1, 0.75, 1]])


def test_a_trial_that_ends_at_once_counts_no_more_than_the_slowest():
    """Its way home would count as often as its only motion."""
    accident = pd.DataFrame({"motions": [1], "rendezvous": [False], "robot_seconds": [14.0]})
    assert seconds_per_reach(accident, 60, 4.0).tolist() == [slowest_seconds(60, 4.0)]


def test_runs_without_a_row_are_worst():
    of = scenario(2)
    own, edges = own_trials(of, 2, (0, 0, 5, True), (0, 1, 4, True)), edges_of(of, FINE)
    worst = {SUCCESS: 0, MOTIONS: 20, seconds_at(4.0): 21 * (4 + 2 * np.pi / 0.7)}
    for measure, value in worst.items():
        np.testing.assert_allclose(own.blocks("servo", measure, edges).runs[1], value)
        np.testing.assert_allclose(own.blocks("sac", measure, edges).runs, np.full((2, 2), value))


def test_the_figure_draws_each_block_in_its_middle_and_events_between_trials():
    of = scenario(6, 3)
    own, edges = own_trials(of, 1, *((0, trial, 6 - trial, True) for trial in range(6))), edges_of(of, FINE)
    agents = [{"name": "memory", "label": "servo"}]
    suite = {"name": "s", "question": "?", "worlds": 1, "evaluation": None, "agents": agents}
    figure = trial_picture(finished_suite({**suite, "scenarios": [of.model_dump()]}), own)
    (axes,) = figure.axes
    alone, curve, event, *_ = axes.lines
    assert figure.get_suptitle().splitlines() == ["Motions per reach (a failure counts as 20)"]
    np.testing.assert_array_equal(alone.get_xydata(), curve.get_xydata())
    assert list(edges) == [0, 1, 3, 4, 6]
    np.testing.assert_array_equal(curve.get_xydata(), [[0.5, 6], [1.5, 4.5], [2.5, 3], [3.5, 1.5]])
    assert list(event.get_xdata()) == [2, 2]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["1", "2–3", "4", "5–6"]
    assert [text.get_text() for text in axes.texts] == ["a camera: another\nlens", "servo"]
    plt.close(figure)


@pytest.mark.slow
def test_a_lifetime_in_trials_from_configuration_to_report(in_trials, write_config, tmp_path, capsys):
    config, out = write_config(in_trials), tmp_path / "out"
    assert main(["validate", str(config)]) == 0
    assert "4 runs, 32 trials" in capsys.readouterr().out
    assert main(["run", str(config), "--out", str(out), "--jobs", "2"]) == 0

    results = pd.read_parquet(out / "results.parquet")
    assert set(results["phase"]) == {"train"}
    assert all(list(of_run["trial"]) == list(range(8)) for _, of_run in results.groupby("run"))
    for done in out.glob("runs/*/DONE.json"):
        met = json.loads(done.read_text())["perturbations"]
        assert [(trial, what["type"]) for _, trial, what in met] == [(4, "camera_aim"), (6, "undo")]

    page = (out / "report.html").read_text()
    assert "8 trials a life" in page
    assert page.count("<figure>") == 1
    assert "undone: left" in page
    assert (out / "figures" / "aimed-trials.png").exists()
    assert re.search(r"<td[^>]*>5–6</td><td>grid_<wbr>table</td>", page)
    capsys.readouterr()
    assert main(["status", str(out)]) == 0
    assert "8 trials" in capsys.readouterr().out
    assert main(["run", str(config), "--out", str(out)]) == 0
    assert "4 runs, 4 of them finished already" in capsys.readouterr().out


@pytest.mark.slow
def test_lifetimes_in_trials_may_have_held_out_trials_too(in_trials, write_config, tmp_path):
    in_trials |= {"worlds": 1, "agents": ["unified_servo"], "evaluation": {"every": 10, "trials": 2}}
    out = tmp_path / "out"
    assert main(["run", str(write_config(in_trials)), "--out", str(out)]) == 0
    results = pd.read_parquet(out / "results.parquet")
    assert len(results[results["phase"] == "train"]) == 8
    assert len(results[results["phase"] == "eval"]) >= 6
    assert (out / "report.html").read_text().count("<figure>") == 2
    (log,) = out.glob("runs/*/log.txt")
    assert log.read_text().splitlines()[-1].startswith("trials 8/8: ")
