"""Claims and requirements, judged by results that were made up so that the verdict is known."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from pydantic import ValidationError

from experiments.config.claims import Claim, Criterion, Number, Requirement, TrialsOf
from experiments.config.loading import load
from experiments.config.suite import Suite
from experiments.errors import ConfigError
from experiments.reporting.claims import (
    JudgedClaim,
    Measured,
    Verdict,
    claims_section,
    described,
    judge,
    margin,
    measured,
    required_section,
    verdict_of,
    verdicts_in_words,
)
from experiments.running.run import runs_of
from experiments.statistics import Estimate, mean_share, paired_motions
from tests.experiments.reporting.made_up import CAP, results

WORLDS = 20
AGENTS = ["paper_servo", "unified_servo"]
ENV = {"id": "CalFree/Reach-v0", "world": "wild", "dynamics": "kinematic"}
SUITE = {
    "name": "made_up",
    "question": "?",
    "worlds": WORLDS,
    "scenarios": [
        {"name": "home", "env": ENV, "motions": 500},
        {"name": "away", "env": ENV, "trials": 50, "agents": ["paper_servo"]},
    ],
    "sweeps": [{"name": "aim", "env": ENV, "do": {"type": "camera_aim"}, "vary": "degrees", "over": [0, 5]}],
    "evaluation": {"every": 100, "trials": 10},
    "agents": AGENTS,
}


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def rows(agent, motions, **columns):
    """One row a trial, of motions (worlds, trials); those of the cap ended without a rendezvous."""
    motions = np.asarray(motions)
    worlds, trials = (each.ravel() for each in np.indices(motions.shape))
    data = np.column_stack([worlds, trials, motions.ravel()])
    found = results("world trial motions", data, **{"agent": agent, "scenario": "home", **columns})
    reached = found["motions"] < CAP
    to = dict.fromkeys(("motions_to_4", "motions_to_16"), found["motions"].where(reached))
    seconds = columns.get("robot_seconds", 5.0 * found["motions"])
    return found.assign(success=reached, rendezvous=reached, robot_seconds=seconds, **to)


def trials_of(agent="paper_servo", scenario="home", **when):
    return TrialsOf(agent=agent, scenario=scenario, **(when or {"motions": 0}))


def found_in(rows, measure, of=None, **number):
    """What is measured, by default of the paper's servo at the beginning."""
    return measured(
        rows, Suite.model_validate(SUITE), Number(measure=measure, of=of or trials_of(), **number)
    )


def test_a_share_is_the_mean_over_worlds_with_its_interval(rng):
    motions = np.where(rng.random((WORLDS, 10)) < 0.8, 7, CAP)
    expected = mean_share((motions < CAP).mean(axis=1))
    assert found_in(rows("paper_servo", motions), "rendezvous") == Measured(expected, WORLDS)


def test_differences_are_paired_over_worlds(rng):
    of_world = rng.integers(3, 30, (WORLDS, 1))
    mine, others = of_world + np.zeros((1, 4), int), of_world + 2 + rng.integers(0, 2, (WORLDS, 4))
    both = pd.concat([rows("paper_servo", mine), rows("unified_servo", others)])
    than = trials_of("unified_servo")
    found = found_in(both, "motions", than=than).estimate
    assert found == paired_motions(mine.mean(axis=1), others.mean(axis=1))
    assert found.high < -2  # although worlds differ by far more than that
    relative = found_in(both, "motions", than=than, relative=True).estimate
    assert relative.value == pytest.approx(mine.mean() / others.mean() - 1)
    never = pd.concat([both[:80], both[80:].assign(success=False)])
    assert found_in(never, "success", than=than, relative=True) is None, "it changes from nothing"


def test_of_twenty_trials_one_may_need_more_motions_than_95_percent():
    motions = np.array([[3]] * (WORLDS - 1) + [[CAP]])
    assert found_in(rows("paper_servo", motions), "most_motions").estimate.value == 3


def test_trials_are_chosen_by_number_checkpoint_or_value():
    at = [rows("paper_servo", np.full((WORLDS, 2), 10 * i), lifetime_motions=100 * i) for i in (1, 2, 3)]
    own = rows("paper_servo", np.tile([9, 8, 7, 6], (WORLDS, 1)), phase="train")
    swept = rows("paper_servo", np.full((WORLDS, 1), 4), scenario="aim", phase="sweep", value=5.0)
    every = pd.concat([own, *at, swept, swept.assign(motions=50, in_view=False)])
    for when, expected in (
        ({"trials": [2, 3]}, 7.5),
        ({"motions": 150}, 20),
        ({"motions": 200}, 20),
        ({"scenario": "aim", "value": 5}, 4),
    ):
        assert found_in(every, "motions", trials_of(**when)).estimate.value == pytest.approx(expected)


def test_held_out_trials_at_a_change_are_those_before_it():
    after, before = (
        rows(
            "paper_servo", np.full((WORLDS, 2), motions), lifetime_motions=100, motions_since_perturbation=to
        )
        for motions, to in ((50, 0), (5, pd.NA))
    )
    assert found_in(pd.concat([after, before]), "motions", trials_of(motions=100)).estimate.value == 5


def test_without_all_its_runs_there_is_no_number():
    """On either side: it must not matter whom the missing runs would serve."""
    whole, part = (rows("unified_servo", np.full((worlds, 3), 1)) for worlds in (WORLDS, WORLDS - 1))
    of = trials_of("unified_servo")
    assert found_in(whole, "success", of) is not None
    assert found_in(part, "success", of) is None
    for others in ([], [rows("paper_servo", np.full((3, 3), 60))]):
        assert found_in(pd.concat([whole, *others]), "motions", of, than=trials_of()) is None


@pytest.mark.parametrize(
    ("worlds", "mine", "null", "verdict"),
    [
        (WORLDS, 1.0, 0.0, Verdict.CONFIRMED),
        (WORLDS, 1.0, 1.0, Verdict.VACUOUS),
        (WORLDS, 1.0, 0.5, Verdict.MIXED),
        (WORLDS, 0.0, 0.0, Verdict.NOT_CONFIRMED),
        (8, 0.0, 0.0, Verdict.NOT_CONFIRMED),
        (8, 1.0, 0.0, Verdict.UNTESTED),
        (7, 0.0, 0.0, Verdict.UNTESTED),
    ],
)
def test_a_claim_stands_where_its_null_agent_falls(worlds, mine, null, verdict):
    """Shares of worlds in which every trial reaches; eight worlds can only tell that it falls."""
    works = claim(Criterion(measure="rendezvous", of=trials_of(), above=0.5, null_agent="random"))
    suite = {**SUITE, "worlds": worlds, "claims": [works.model_dump()], "agents": [*AGENTS, "random"]}
    made = [
        rows(agent, np.where(np.arange(worlds)[:, None] < share * worlds, [7] * 3, CAP))
        for agent, share in (("paper_servo", mine), ("random", null))
    ]
    (judged,) = judge(pd.concat(made), Suite.model_validate(suite))
    assert judged.verdict is verdict
    (found,), (others,) = judged.found, judged.nulls
    assert (found.estimate.value, others.estimate.value) == pytest.approx((mine, null))


def test_the_null_agent_takes_the_place_of_the_agent_on_either_side():
    faster = {"measure": "motions", "of": trials_of(motions=100), "below": 0, "null_agent": "random"}
    own = Criterion(**faster, than=trials_of()).by_null()
    assert [each.agent for each in own.trials()] == ["random", "random"]
    beside = Criterion(**faster, than=trials_of("unified_servo")).by_null()
    assert [each.agent for each in beside.trials()] == ["random", "unified_servo"]


def test_pairs_are_over_the_worlds_of_both(rng):
    mine, others = rng.integers(3, 30, (8, 4)), rng.integers(3, 30, (WORLDS, 4))
    both = pd.concat([rows("paper_servo", mine), rows("unified_servo", others)])
    agents = [{"name": "paper_servo", "worlds": 8}, "unified_servo"]
    number = Number(measure="motions", of=trials_of(), than=trials_of("unified_servo"))
    found = measured(both, Suite.model_validate(SUITE | {"agents": agents}), number)
    assert found.worlds == 8
    assert found.estimate.value == np.median(mine.mean(axis=1) - others[:8].mean(axis=1))
    assert measured(both, Suite.model_validate(SUITE), number) is None  # twelve runs are missing


def test_far_and_quickly_are_shares_of_all_trials():
    made = rows("paper_servo", np.tile([1, 3, CAP], (WORLDS, 1)))
    made["distance_mm"] = np.tile([10.0, 10.1, 300.0], WORLDS)
    assert found_in(made, "far").estimate.value == pytest.approx(2 / 3)
    assert found_in(made, "quickly", within=1).estimate.value == pytest.approx(1 / 3)
    assert found_in(made, "quickly", within=CAP).estimate.value == pytest.approx(2 / 3)


def test_what_was_expected_is_held_against_what_came():
    """Trials of which nothing was told are left out."""
    came, expected = np.array([1, 1, 9, 9, 9]), np.array([3.0, 30.0, 3.0, 30.0, np.nan])
    told = rows("paper_servo", np.tile(came, (WORLDS, 1))).assign(expected_px=np.tile(expected, WORLDS))
    assert found_in(told, "as_expected").estimate.value == pytest.approx(0.5)
    assert found_in(told.assign(expected_px=np.nan), "as_expected") is None


def test_only_trials_that_were_quick_can_be_kept():
    then, now = np.tile([1, 2, 9, 9], (WORLDS, 1)), np.tile([2, 5, 1, 9], (WORLDS, 1))
    later = rows("paper_servo", now, lifetime_motions=100)
    kept = {"of": trials_of(motions=100), "than": trials_of()}
    found = found_in(pd.concat([rows("paper_servo", then), later]), "kept", **kept)
    assert found.estimate.value == pytest.approx(0.5)
    assert found_in(pd.concat([rows("paper_servo", now * 0 + 9), later]), "kept", **kept) is None


def test_seconds_depend_on_the_look():
    eight_looks = rows("paper_servo", np.full((WORLDS, 3), 7), robot_seconds=40.0)  # of 4 s, and 8 s
    for look, expected in ((4, 40), (0.5, 12)):
        assert found_in(eight_looks, "seconds", look=look).estimate.value == pytest.approx(expected)


def test_seconds_go_on_to_the_cap_of_their_own_scenario():
    failed = np.full((WORLDS, 2), CAP)
    both = [rows("paper_servo", failed), rows("paper_servo", failed, scenario="away", phase="train")]
    home, away = SUITE["scenarios"]
    suite = {**SUITE, "scenarios": [home, {**away, "env": {**ENV, "max_episode_steps": 2 * CAP}}]}
    number = Number(measure="seconds", of=trials_of(), than=trials_of(**AWAY), look=4)
    found = measured(pd.concat(both), Suite.model_validate(suite), number)
    assert found.estimate.value == -5 * CAP


@pytest.mark.parametrize(
    ("low", "high", "bound", "half_intervals", "expected"),
    [
        (0.96, 1.0, {"above": 0.95}, 1.5, Verdict.CONFIRMED),
        (0.9, 1.0, {"above": 0.95}, 0, Verdict.MIXED),
        (0.8, 0.94, {"above": 0.95}, -8 / 7, Verdict.NOT_CONFIRMED),
        (1.0, 1.9, {"below": 2.0}, 0.55 / 0.45, Verdict.CONFIRMED),
        (1.0, 2.1, {"below": 2.0}, 0.45 / 0.55, Verdict.MIXED),
        (2.0, 3.0, {"below": 2.0}, -1, Verdict.NOT_CONFIRMED),
        (0.0, 0.0, {"below": 0.0}, -np.inf, Verdict.NOT_CONFIRMED),
        (-1.0, -1.0, {"below": 0.0}, np.inf, Verdict.CONFIRMED),
        (-0.4, -0.4 + 1e-16, {"below": 0.25}, np.inf, Verdict.CONFIRMED),
    ],
)
def test_the_whole_interval_decides(low, high, bound, half_intervals, expected):
    test = Criterion(measure="success", of=trials_of(), **bound)
    estimate, failed = Estimate((low + high) / 2, low, high), Measured(Estimate(*failure(bound)), WORLDS)
    assert margin(test, Measured(estimate, WORLDS)) == pytest.approx(half_intervals)
    assert verdict_of(test, Measured(estimate, WORLDS), failed) is expected
    few = Verdict.NOT_CONFIRMED if expected is Verdict.NOT_CONFIRMED else Verdict.UNTESTED
    assert verdict_of(test, Measured(estimate, WORLDS - 1), failed) is few


def failure(bound):
    """A number, and the limits of its interval, on the wrong side."""
    ((side, threshold),) = bound.items()
    return (threshold + 2, threshold + 1, threshold + 3) if side == "below" else (threshold - 1,) * 3


def test_the_margin_is_in_halves_of_the_interval_that_point_to_the_threshold():
    skewed = Measured(Estimate(0.9, 0.5, 0.95), WORLDS)
    for bound, expected in ((0.7, 0.5), (0.92, -0.4)):
        of = Criterion(measure="success", of=trials_of(), above=bound)
        assert margin(of, skewed) == pytest.approx(expected)
    assert np.isnan(margin(of, None))


def claim(*criteria, name="a_claim"):
    return Claim(name=name, section="1", words="It works.", criteria=criteria)


@pytest.mark.parametrize(
    ("verdicts", "expected"),
    [
        (["confirmed", "confirmed"], Verdict.CONFIRMED),
        (["confirmed", "mixed"], Verdict.MIXED),
        (["confirmed", "not confirmed"], Verdict.MIXED),
        (["not confirmed", "not confirmed"], Verdict.NOT_CONFIRMED),
        (["confirmed", "untested"], Verdict.UNTESTED),
        (["not confirmed", "untested"], Verdict.MIXED),
        (["vacuous", "vacuous"], Verdict.VACUOUS),
    ],
)
def test_a_claim_is_as_good_as_its_tests(verdicts, expected):
    test, none = Criterion(measure="success", of=trials_of(), above=0.5), (None, None)
    assert JudgedClaim(claim(test, test), none, none, tuple(map(Verdict, verdicts))).verdict is expected


def test_the_report_says_which_claims_stand():
    null = {"null_agent": "random"}
    faster = Criterion(measure="motions", of=trials_of(motions=100), than=trials_of(), below=-1, **null)
    works = claim(Criterion(measure="rendezvous", of=trials_of(), above=0.8, **null), name="it_works")
    learns = claim(faster, name="it_learns")
    other = trials_of("unified_servo")
    unseen = claim(Criterion(measure="success", of=other, above=0.5, **null), name="unseen")
    claims = [each.model_dump() for each in (works, learns, unseen)]
    seven = np.full((WORLDS, 5), 7)
    at = [rows("paper_servo", seven, lifetime_motions=motions) for motions in (0, 100)]
    at.append(rows("random", np.full((WORLDS, 5), CAP)))
    judged = judge(
        pd.concat([*at, rows("unified_servo", seven, scenario="away")]),
        Suite.model_validate({**SUITE, "claims": claims, "agents": [*AGENTS, "random"]}),
    )
    assert [each.verdict for each in judged] == ["confirmed", "not confirmed", "untested"]
    (said,) = verdicts_in_words(judged)
    assert said == (
        "Of 3 claims 1 is confirmed (it works); 1 is not confirmed (it learns); 1 is untested (unseen)."
    )
    asks = [replace(each, claim=each.claim.model_copy(update={"kind": "question"})) for each in judged[:1]]
    _, answered = verdicts_in_words([*judged[1:], *asks])
    assert answered == "Of 1 question 1 is confirmed (it works)."
    section = claims_section(judged)
    assert section.text == said
    for table in section.tables:
        assert [row[-1] for row in table.rows] == ["confirmed", "not confirmed", "untested"]
    assert "rendezvous" in described(works.criteria[0])
    assert [row["agent"] for row in section.summary[:2]] == ["paper_servo", "random"]
    first = section.tables[1].frame.iloc[0]
    assert first["criterion"].endswith("rendezvous: above 80 %")
    assert first["measured"] == "100 % [89 %, 100 %] (+1.8)"
    assert first["null agent"] == "random: 0 % [0 %, 11 %] (-7.2)"


AWAY = {"scenario": "away", "trials": [1, 2]}


@pytest.mark.parametrize(
    ("of", "test", "said"),
    [
        ({"scenario": "hom", "motions": 0}, {}, "hom"),
        (AWAY | {"agent": "unified_servo"}, {"null_agent": "paper_servo"}, "allowed: paper_servo"),
        (AWAY | {"trials": [1, 51]}, {}, "up to 50"),
        ({"motions": 501}, {}, "up to 500"),
        ({"scenario": "aim", "value": 4}, {}, "0, 5"),
        ({}, {}, "one of trials, motions and value"),
        ({"trials": [3, 2]}, {}, "first and the last"),
        ({"motions": 0}, {"measure": "speed"}, "measure"),
        ({"motions": 0}, {"measure": "seconds"}, "look"),
        ({"motions": 0}, {"measure": "quickly"}, "within"),
        ({"motions": 0}, {"null_agent": None}, "no null agent, which should fail; allowed: unified_servo"),
        ({"motions": 0}, {"null_agent": "paper_servo"}, "another agent than paper_servo"),
        ({"motions": 0}, {"null_agent": "unified"}, "did you mean unified_servo"),
        (AWAY, {}, "unified_servo"),
        ({"motions": 0}, {"below": 0.9}, "above"),
        ({"motions": 0}, {"relative": True}, "relative"),
        ({"motions": 0}, {"measure": "kept"}, "kept"),
        ({"trials": [1, 2]}, {"measure": "as_expected"}, "held-out"),
    ],
)
def test_wrong_claims_are_told(tmp_path, write_config, refused, of, test, said):
    trials = {"agent": "paper_servo", "scenario": "home", **of}
    criterion = {"measure": "success", "of": trials, "above": 0.5, "null_agent": "unified_servo", **test}
    wrong = write_config([{"name": "c", "section": "1", "words": "w", "criteria": [criterion]}])
    wrong.rename(tmp_path / "claims.yaml")
    found = refused({**SUITE, "claims": "claims.yaml"})
    assert "claims" in found
    assert said in found


def test_success_and_rendezvous_are_not_mixed_in_a_claim():
    both = [Criterion(measure=each, of=trials_of(), above=0.5) for each in ("success", "rendezvous")]
    with pytest.raises(ValidationError, match="a_claim mixes success and rendezvous"):
        claim(*both)


OF = {"agent": "oracle", "scenario": "noise", "value": 0.5}


@pytest.fixture
def asked(write_config):
    """A suite with one requirement."""
    noise = {"name": "noise", "env": ENV, "do": {"type": "point_noise"}, "vary": "px", "over": [0.5]}
    suite = {"name": "asked", "question": "?", "first_world": 7, "worlds": 2, "sweeps": [noise]}
    suite |= {"evaluation": None, "agents": ["oracle"]}
    return lambda **required: load(write_config({**suite, "required": [{"of": OF, **required}]}))


TWO = results(
    "world motions success error_px",
    [(0, 2, True, 1.0), (1, 60, False, 16.0)],
    **{"agent": "oracle", "scenario": "noise", "value": 0.5, "phase": "sweep"},
)


@pytest.mark.parametrize(
    ("required", "measured", "bound", "met"),
    [
        ({"measure": "rendezvous", "at_least": 0.5}, "50 %", "at least 50 %", "yes"),
        ({"measure": "rendezvous", "at_least": 0.995}, "50 %", "at least 99.5 %", "NO"),
        ({"measure": "near", "at_least": 1}, "100 %", "at least 100 %", "yes"),
        ({"measure": "motions", "at_most": 31}, "31.0", "at most 31", "yes"),
        ({"measure": "motions", "at_most": 30}, "31.0", "at most 30", "NO"),
        ({"measure": "most_motions", "at_most": 12}, "60.0", "at most 12", "NO"),
        ({"measure": "worst_world", "at_most": 60}, "60.0", "at most 60", "yes"),
    ],
)
def test_a_number_is_met_whatever_its_interval(asked, required, measured, bound, met):
    suite = asked(**required)
    (table,) = required_section(TWO, suite).tables
    assert table.frame.iloc[0, 1:].tolist() == [measured, bound, met]
    (unfinished,) = required_section(TWO[:1], suite).tables
    assert unfinished.frame["met"].tolist() == ["unfinished"]


@pytest.mark.parametrize(
    ("required", "said"),
    [
        ({}, "one of at_least and at_most is the bound"),
        ({"at_least": 1, "at_most": 2}, "one of at_least and at_most is the bound"),
        ({"measure": "worst_world", "at_most": 2, "than": OF}, "worst_world compares nothing"),
        ({"at_most": 2, "of": {**OF, "value": 1}}, "found value 1.0; allowed: 0.5"),
        ({"at_most": 2, "of": {**OF, "agent": "orakel"}}, "did you mean oracle"),
    ],
)
def test_what_cannot_be_required(asked, required, said):
    with pytest.raises(ConfigError, match=said):
        asked(**{"measure": "motions", **required})


def test_worlds_have_the_seeds_from_the_first_on_and_older_suites_are_told_as_before(asked):
    suite = asked(measure="motions", at_most=3)
    assert runs_of(suite)[0].world_seeds == (7, 8)
    assert suite.told()["first_world"] == 7
    assert Requirement(**suite.told()["required"][0]) == suite.required[0]
    plain = suite.model_copy(update={"first_world": None, "required": ()})
    assert not {"first_world", "required"} & plain.told().keys()
