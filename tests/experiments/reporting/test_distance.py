"""How far in the world trials end, against SciPy and pandas."""

import numpy as np
import pandas as pd
import pytest
import scipy.stats

from experiments.config.suite import SweepConfig
from experiments.reporting.by_trial import own_trials, trial_section
from experiments.reporting.finished_suite import FAR_MM, distances
from experiments.reporting.held_out import held_out, held_out_sections
from experiments.reporting.pages import Head, markdown_page
from experiments.reporting.sweep import sweep_sections, swept
from experiments.statistics import mean_share
from tests.experiments.reporting.made_up import finished_suite, results

WORLDS = 20
ENV = {"id": "CalFree/Reach-v0", "world": "wild", "dynamics": "kinematic"}
SUITE = {"name": "far", "question": "?", "worlds": WORLDS, "agents": ["paper_servo"], "evaluation": None}


@pytest.fixture
def trials():
    """Of worlds that differ: distances (worlds, trials)."""
    rng = np.random.default_rng(1)
    return rng.gamma(2.0, rng.uniform(0.5, 6.0, (WORLDS, 1)), (WORLDS, 10))


def rows(trials, **fixed):
    worlds, numbers = (each.ravel() for each in np.indices(trials.shape))
    data = np.column_stack([worlds, numbers, trials.ravel(), np.full(trials.size, 7)])
    fixed = {"agent": "paper_servo", "robot_seconds": 40.0, **fixed}
    return results("world trial distance_mm motions", data, **fixed)


def test_distances_are_those_of_all_trials_and_the_share_that_of_worlds(trials):
    found = distances(rows(trials))
    assert found.median == pytest.approx(scipy.stats.scoreatpercentile(trials, 50))
    assert found.most == pytest.approx(pd.Series(trials.ravel()).quantile(0.95))
    assert found.far == mean_share((trials > FAR_MM).mean(axis=1))
    assert found.worlds == WORLDS


def shown(sections):
    """The one table of distances, and whether the page says what it is."""
    (table,) = (each for section in sections for each in section.tables if each.name.endswith("-distance"))
    assert "true distance of gripper and object" in " ".join(each.note for each in sections)
    assert len(table.header) == 5
    return table.frame


def told(trials):
    """What a row says of them."""
    far = 100 * np.mean(trials > FAR_MM)
    return [f"{np.median(trials):.1f}", f"{np.quantile(trials, 0.95):.1f}", f"{far:.1f} %"]


def row(frame, at):
    *_, median, most, far = frame.iloc[at]
    return [median, most, far.partition(" [")[0]]


def test_held_out_trials_tell_how_far(trials, tmp_path, monkeypatch):
    scenario = {"name": "home", "env": ENV, "motions": 500}
    suite = SUITE | {"scenarios": [scenario], "evaluation": {"every": 500, "trials": 10}}
    monkeypatch.chdir(tmp_path)
    finished = finished_suite(suite, rows(trials, scenario="home", lifetime_motions=500))
    sections = held_out_sections(finished, held_out(finished, finished.suite.scenarios[0]), {})
    frame = shown(sections)
    assert frame.iloc[0, :2].tolist() == ["paper_servo", "at the end"]
    assert row(frame, 0) == told(trials)
    numbers = {each["measure"]: each["value"] for section in sections for each in section.summary}
    assert numbers["far"] == pytest.approx(np.mean(trials > FAR_MM))


@pytest.mark.parametrize("task", ["Reach", "Grasp"])
def test_own_trials_tell_how_far_in_each_block_where_the_task_is_to_reach(
    trials, task, tmp_path, monkeypatch
):
    env = ENV if task == "Reach" else {"id": "CalFree/Grasp-v0", "world": "wild"}
    agent = "paper_servo" if task == "Reach" else "grasp"
    knock = {"at": {"trial": 5}, "do": {"type": "camera_aim"}}
    scenario = {"name": "home", "env": env, "trials": 10, "perturbations": [knock]}
    monkeypatch.chdir(tmp_path)
    made = rows(trials, scenario="home", phase="train", agent=agent)
    finished = finished_suite(SUITE | {"scenarios": [scenario], "agents": [agent]}, made)
    section = trial_section(finished, own_trials(finished, finished.suite.scenarios[0]))
    if task == "Grasp":
        assert "-distance" not in " ".join(table.name for table in section.tables)
        return
    frame = shown([section])
    assert frame["trials"].tolist() == ["1–5", "6–10"]
    assert [row(frame, i) for i in range(2)] == [told(trials[:, :5]), told(trials[:, 5:])]


def test_sweeps_tell_how_far_at_each_value(trials, tmp_path, monkeypatch):
    do = {"type": "camera_nearer", "camera": "left"}
    sweep = {"name": "baseline", "env": ENV, "do": do, "vary": "share", "over": [0, 0.97]}
    monkeypatch.chdir(tmp_path)
    made = [
        rows(trials[:, [i]], scenario="baseline", phase="sweep", value=value)
        for i, value in enumerate(sweep["over"])
    ]
    finished = finished_suite(SUITE | {"sweeps": [sweep]}, pd.concat(made))
    sections = sweep_sections(finished, [swept(finished, SweepConfig(**sweep))])
    frame = shown(sections)
    assert [row(frame, i) for i in range(2)] == [told(trials[:, 0]), told(trials[:, 1])]
    assert "above 10 mm" in markdown_page(Head("far", "?"), sections)
