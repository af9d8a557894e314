"""Curves, tables and intervals over runs whose checkpoints fall at different motions, or that failed."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import scipy.stats

from experiments.config.suite import ScenarioConfig, SweepConfig
from experiments.reporting.by_trial import Blocks
from experiments.reporting.finished_suite import MOTIONS, RENDEZVOUS, SUCCESS, with_cost
from experiments.reporting.held_out import (
    HeldOut,
    comparison_section,
    differences,
    held_out_sections,
    moments,
    scores,
    shown_clocks,
    times_to_good,
    with_clocks,
)
from experiments.reporting.sweep import points
from experiments.reporting.tables import NOTHING
from tests.experiments.reporting.made_up import CAP, finished_suite, results


@pytest.fixture
def scenario(suite_data):
    (aimed,) = suite_data["scenarios"]
    env = aimed["env"] | {"max_episode_steps": CAP}
    return ScenarioConfig(**aimed | {"motions": 300, "env": env, "perturbations": []})


def table(scenario, *rows, own=()):
    """From (world, lifetime motions, motions since a perturbation, success, motions)."""
    names = "world lifetime_motions motions_since_perturbation success motions phase"
    data = results(names, [(*row, "eval") for row in rows] + [(*row, "train") for row in own])
    far = {"distance_mm": 10.0 * (data["world"] + 1), "error_px": np.where(data["success"], 3.0, 30.0)}
    return with_clocks(with_cost(data.assign(**far), scenario))


@pytest.fixture
def perturbed_at_different_motions(scenario):
    return table(
        scenario,
        (0, 0, None, True, 10),
        (0, 100, None, True, 10),
        (0, 121, 1, False, 60),
        (0, 300, 180, True, 20),
        (1, 0, None, True, 20),
        (1, 100, None, True, 20),
        (1, 161, 1, True, 40),
        (1, 300, 140, True, 40),
    )


def test_every_run_has_its_own_moments(perturbed_at_different_motions):
    found = moments(perturbed_at_different_motions, 2, CAP)
    assert list(found) == ["before", "right after", "at the end"]
    assert [m.motions.value for m in found.values()] == [15, 50, 30]
    assert [m.success.value for m in found.values()] == [1, 0.5, 1]
    assert [m.finished for m in found.values()] == [2, 2, 2]
    assert [m.among_reached.value for m in found.values()] == [15, 40, 30]


def test_failed_runs_are_worst_at_every_moment_but_have_no_distance(perturbed_at_different_motions):
    found = moments(perturbed_at_different_motions, 4, CAP)
    assert [m.success.value for m in found.values()] == [0.5, 0.25, 0.5]
    assert [m.finished for m in found.values()] == [2, 2, 2]
    assert found["at the end"].distances.median == 15
    assert found["before"].motions.value == (20 + CAP) / 2
    assert found["before"].among_reached.value == 15
    assert (found["before"].errors_px == [[3], [3], [np.inf], [np.inf]]).all()
    assert moments(perturbed_at_different_motions.iloc[:0], 4, CAP) == {}


def test_a_run_that_is_not_perturbed_has_only_an_end(perturbed_at_different_motions, scenario):
    calm = table(scenario, (2, 0, None, True, 10), (2, 300, None, True, 10))
    rows = pd.concat([perturbed_at_different_motions, calm])
    found = moments(rows, 3, CAP)
    assert [m.finished for m in found.values()] == [2, 2, 3]
    assert found["before"].success.value == 1
    assert list(moments(calm, 1, CAP)) == ["at the end"]


def test_what_a_lifetime_begins_with_is_no_change(scenario):
    noisy = [(0, 0, 0, True, 9), (0, 200, 200, True, 10)]
    assert list(moments(table(scenario, *noisy), 1, CAP)) == ["at the end"]
    found = moments(table(scenario, *noisy, (0, 200, 0, True, 50), (0, 300, 100, True, 20)), 1, CAP)
    assert [found[when].motions.value for when in ("before", "right after", "at the end")] == [10, 50, 20]


def test_a_trial_without_a_rendezvous_counts_as_the_cap(scenario):
    rows = [(0, 10, True, True), (0, 12, False, True), (1, 20, True, False)]
    found = with_cost(results("world motions success rendezvous", rows), scenario)
    assert list(found[SUCCESS]) == [1, 0, 1]
    assert list(found[RENDEZVOUS]) == [1, 1, 0]
    assert list(found[MOTIONS]) == [10, 12, CAP]


def test_differences_are_paired_by_world(perturbed_at_different_motions, scenario):
    rows = perturbed_at_different_motions
    slower = rows.assign(agent="slow", **{MOTIONS: rows[MOTIONS] + 5.0})
    servo, slow = (moments(each, 2, CAP)["before"] for each in (rows, slower))
    found = differences(slow, servo)
    assert found[MOTIONS].value == 5
    assert found["fewer_motions"].value == 0
    assert found[RENDEZVOUS].value == 0
    failed = moments(rows, 4, CAP)["before"]
    assert list(failed.worlds.index) == [0, 1, 2, 3]
    assert differences(failed, servo)[MOTIONS].value == 0


def test_motions_to_the_threshold_are_right_censored(scenario):
    rows = table(
        scenario,
        (0, 0, None, False, 60),
        (0, 100, None, True, 10),
        (0, 200, None, True, 10),
        (0, 221, 1, False, 60),
        (0, 300, 80, True, 20),
        (1, 0, None, False, 60),
        (1, 100, None, False, 60),
        (1, 261, 1, True, 40),
        (1, 300, 5, True, 40),  # after a second perturbation
    )
    found = times_to_good(rows, 3)
    times, reached, latest, _ = found["from the beginning"]
    assert latest == 200
    assert list(times) == [100, 100, 200]  # good, last looked at, failed
    assert list(reached) == [True, False, False]
    times, reached, latest, _ = found["after the first change"]
    assert list(times) == [80, 1, 80]
    assert list(reached) == [True, True, False]
    assert times_to_good(rows.iloc[:0], 3) == {}


def test_the_checkpoints_right_before_and_after_a_change_have_the_same_motions(scenario):
    """They are told apart by the motions since a change, the second time by those since the first."""
    at = [(0, None, 3), (100, None, 4), (100, 0, 50), (200, 100, 5), (200, 0, 40), (300, 100, 6)]
    lives = [(world, lived, since, True, motions) for world in (0, 1) for lived, since, motions in at]
    rows = table(scenario, *lives)
    found = moments(rows, 2, CAP)
    assert [found[when].motions.value for when in ("before", "right after", "at the end")] == [4, 50, 6]
    assert list(rows.loc[rows["world"] == 0, "stretch"]) == [0, 0, 1, 1, 2, 2]


def test_an_agent_in_fewer_worlds_is_compared_in_those(scenario):
    few = table(scenario, *((world, 0, None, True, 9 + world) for world in range(20)))
    many = table(scenario, *((world, 0, None, True, 3 + world) for world in range(50)))
    mine, reference = (moments(rows, n, CAP)["at the end"] for rows, n in ((few, 20), (many, 50)))
    found = differences(mine, reference)[MOTIONS]
    assert (found.value, found.low, found.high) == (6, 6, 6)
    assert mine.motions.has_interval


def test_checkpoints_are_shown_from_the_first_to_the_last_by_ratios():
    assert shown_clocks(np.array([0, 1, 10, 30, 100, 300, 1000])) == [0, 10, 100, 1000]
    assert shown_clocks(np.arange(0, 2001, 100)) == [0, 100, 200, 2000]
    assert shown_clocks(np.array([0.0, 0.0])) == [0]


def test_an_agent_of_which_no_run_finished_has_no_motions(scenario, suite_data):
    rows = table(scenario, (0, 0, None, True, 10), (1, 0, None, True, 20))
    found = {"servo": moments(rows, 3, CAP), "broken": {}}
    held = HeldOut(scenario, rows, {"servo": 3, "broken": 2}, found, {"servo": {}, "broken": {}})
    sections = held_out_sections(finished_suite(suite_data), held, {})
    (motions,) = next(each for each in sections if each.title == "aimed: after how many motions").tables
    assert motions.frame.to_numpy().tolist() == [["servo", "20.0 (10.0 – 60.0)"], ["broken", NOTHING]]


def test_a_run_that_is_evaluated_at_other_motions_is_shown_by_its_next_checkpoint(scenario):
    rows = [(0, 0, None, False, 60), (0, 128, None, True, 3), (1, 100, None, True, 4)]
    own = table(scenario, *rows)
    assert dict(scores(own, MOTIONS, 100)) == {0: 3, 1: 4}
    assert dict(scores(own, MOTIONS, 101)) == {0: 3}, "a life that has ended has come to no more"


def test_a_lucky_checkpoint_is_no_threshold(scenario):
    share = {0: 0, 100: 20, 200: 15, 300: 19, 400: 20}
    rows = [
        (0, motions, None, trial < reached, 3) for motions, reached in share.items() for trial in range(20)
    ]
    times, reached, latest, _ = times_to_good(table(scenario, *rows), 1)["from the beginning"]
    assert (times.tolist(), reached.tolist(), latest) == ([300], [True], 400)


def test_agents_that_came_to_a_moment_in_other_worlds_are_not_compared_there(scenario, suite_data):
    rows = table(scenario, (0, 0, None, True, 10), (1, 0, None, True, 20))
    at_the_end = moments(rows, 2, CAP)["at the end"]
    found = {
        agent: {"at the end": replace(at_the_end, worlds=at_the_end.worlds.loc[[world]])}
        for world, agent in enumerate(("one", "other"))
    }
    held = HeldOut(scenario, rows, {"one": 2, "other": 2}, found, {})
    assert comparison_section(finished_suite(suite_data), held).summary == []


def test_a_change_after_which_nothing_was_held_out_is_counted(scenario):
    """The agent's own trials tell of it."""
    rows = [(0, 0, None, True, 3), (0, 400, 50, True, 3), (0, 800, 100, True, 3)]
    own = [(0, 130, 30, True, 3), (0, 360, 10, True, 3), (0, 720, 20, True, 3)]
    held_out = table(scenario, *rows, own=own)
    assert list(held_out["stretch"]) == [0, 2, 3]
    assert list(held_out["clock"]) == [0, 50, 100]


# Every interval that the report shows is one of 95 %: of many worlds, that of SciPy.

WORLDS = 400
MOTIONS_OF_WORLD = 3 + np.minimum(np.random.default_rng(5).gamma(2, 4, WORLDS).round(), 50)


def is_of_the_median(estimate):
    exact = scipy.stats.quantile_test(MOTIONS_OF_WORLD, p=0.5).confidence_interval(0.95)
    assert (estimate.low, estimate.high) == (exact.low, exact.high)
    assert estimate.value == np.median(MOTIONS_OF_WORLD)


def is_of_successes_alone(estimate):
    """Its end lies between Wilson's interval of as many successes, and Clopper and Pearson's."""
    all_of = scipy.stats.binomtest(WORLDS, WORLDS)
    low, high = (all_of.proportion_ci(0.95, method=method).low for method in ("exact", "wilson"))
    assert low < estimate.low < max(high, low + 0.01)
    assert estimate.high == 1


def test_intervals_in_tables_of_moments_blocks_and_sweeps(scenario):
    of_worlds = [(world, 300, None, True, int(motions)) for world, motions in enumerate(MOTIONS_OF_WORLD)]
    moment = moments(table(scenario, *of_worlds), WORLDS, CAP)["at the end"]
    (block,) = Blocks(np.array([0.0, 1.0]), MOTIONS_OF_WORLD[:, None], shares=False).estimates()
    env = {"id": "CalFree/Reach-v0", "world": "nominal", "max_episode_steps": CAP}
    sweep = SweepConfig(name="aimed", env=env, do={"type": "camera_roll"}, vary="degrees", over=(0,))
    rows = results("world motions", enumerate(MOTIONS_OF_WORLD), value=0.0)
    (point,) = points(with_cost(rows, sweep), sweep, "servo", WORLDS)
    for found in (moment.motions, moment.among_reached, block, point.motions, point.among_reached):
        is_of_the_median(found)
    for found in (moment.success, point.success):
        is_of_successes_alone(found)
