"""The sentences at the head of a report, of tables whose best agent is known."""

import numpy as np
import pandas as pd
import pytest

from experiments.config.suite import Suite
from experiments.reporting.finished_suite import MOTIONS, RENDEZVOUS, FinishedSuite
from experiments.reporting.pages.headline import in_words
from experiments.running.plan import runs_of

AGENTS = ["oracle", "random", "unified_servo", "memory", "paper_servo"]


@pytest.fixture
def said(suite_data, tmp_path):
    """What is said of each agent's value in each world, at the end."""

    def said(worlds, measure, **scores):
        suite = Suite.model_validate({**suite_data, "worlds": worlds, "agents": AGENTS})
        runs = runs_of(suite)
        told = {"oracle": ["object_registers"], "memory": ["joint_angles"]}
        outcomes = {run.id: {"privileged": told.get(run.agent.name, [])} for run in runs}
        finished = FinishedSuite(tmp_path, suite, "", runs, outcomes, {}, {}, pd.DataFrame(), pd.DataFrame())
        moments = {"at the end": {agent: pd.Series(values, dtype=float) for agent, values in scores.items()}}
        return in_words(finished, suite.scenarios[0], measure, moments)

    return said


def around(mean, spread, seed):
    """Twenty worlds with exactly this mean."""
    drawn = np.random.default_rng(seed).normal(size=20)
    return mean + spread * (drawn - drawn.mean())


def test_who_is_best_is_named_with_who_cannot_be_told_apart(said):
    best, rest = said(
        20,
        MOTIONS,
        oracle=[1.0] * 20,
        random=[20.0] * 20,
        unified_servo=around(5, 0.5, 1),
        memory=around(5.1, 2, 2),
        paper_servo=around(9, 0.5, 3),
    )
    assert best.startswith("At the end, unified_servo needs the fewest motions a reach, 5.0 [")
    assert best.endswith("; memory cannot be told apart from it.")
    assert rest.startswith("Not ranked, at the end: oracle, which is told where to go (1.0 [1.0, ")
    assert "and random, the floor (20.0 [" in rest


def test_where_all_differ_the_best_one_is_alone(said):
    best, _ = said(20, MOTIONS, random=[20.0] * 20, memory=[2.0] * 20, paper_servo=around(9, 0.5, 3))
    assert best.startswith("At the end, memory needs the fewest")
    assert best.endswith("; it can be told apart from every other agent.")


def test_equal_agents_cannot_be_told_apart(said):
    (best,) = said(20, MOTIONS, unified_servo=[5.0] * 20, memory=[5.0] * 20, paper_servo=[5.0] * 20)
    assert best.endswith("but no other agent can be told apart from it.")


def test_nobody_wins_who_is_no_better_than_the_floor(said):
    best, _ = said(20, MOTIONS, random=around(15, 2, 1), memory=around(14.9, 2, 2), paper_servo=[20.0] * 20)
    assert best.endswith(", but cannot be told apart from random, the floor.")
    nothing, _ = said(20, MOTIONS, random=[20.0] * 20, memory=[20.0] * 20)
    assert nothing == "At the end, no agent reaches."


def test_of_shares_the_highest_is_best(said):
    best, rest = said(
        20,
        RENDEZVOUS,
        oracle=[1.0] * 20,
        unified_servo=[0.2] * 20,
        memory=[1.0] * 20,
        paper_servo=[0.95] * 19 + [0.9],
    )
    assert best.startswith("At the end, memory has the highest share of rendezvous, 100 % [")
    assert "unified_servo" not in best
    assert (
        "paper_servo cannot be told apart from it" in best
    )  # a world where memory fails may not have been met
    assert rest.startswith("Not ranked, at the end: oracle, which is told where to go (100 % [")


def test_of_four_worlds_only_points_are_told_in_the_order_of_the_suite(said):
    head, points = said(4, MOTIONS, oracle=[1.0] * 4, unified_servo=[9.0] * 4, memory=[2.0] * 4)
    assert head == "With 4 worlds no ranking is claimed; means over worlds of motions a reach."
    (head, _) = said(1, MOTIONS, memory=[2])
    assert head == "With 1 world no ranking is claimed; means over worlds of motions a reach."
    assert points == "At the end: oracle 1.0, unified_servo 9.0, memory 2.0."


def test_agents_are_ranked_in_the_worlds_in_which_all_were_scored(said):
    (few,) = said(20, MOTIONS, unified_servo=[9.0] * 20, memory=[2.0] * 9)
    assert few.startswith("At the end: unified_servo 9.0, memory 2.0; no ranking: all were scored in 9")
