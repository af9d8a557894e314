"""Claims, judged by results that were made up so that the verdict is known."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from experiments.config.claims import Claim, Criterion, TrialsOf
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
    measured,
    verdict_of,
    verdicts_in_words,
)
from experiments.statistics import Estimate, mean_share, paired_motions

WORLDS, CAP = 20, 60


@pytest.fixture
def rng():
    return np.random.default_rng(5)


CONFIGS = Path(__file__).parents[3] / "configs"
ENV = {"id": "CalFree/Reach-v0", "world": "wild", "dynamics": "kinematic"}


def suite(claims=(), **changes):
    data = {
        "name": "made_up",
        "question": "?",
        "worlds": WORLDS,
        "scenarios": [
            {"name": "home", "env": ENV, "motions": 500},
            {"name": "away", "env": ENV, "trials": 50, "agents": ["paper_servo"]},
        ],
        "sweeps": [
            {"name": "aim", "env": ENV, "do": {"type": "camera_aim"}, "vary": "degrees", "over": [0, 5]}
        ],
        "evaluation": {"every": 100, "trials": 10},
        "agents": ["paper_servo", "unified_servo"],
        "claims": list(claims),
    }
    return Suite.model_validate({**data, **changes})


def rows(agent, motions, scenario="home", phase="eval", lifetime_motions=0, **columns):
    """One row a trial, of motions (worlds, trials); those of the cap ended without a rendezvous."""
    found = []
    for (world, trial), of_trial in np.ndenumerate(np.asarray(motions)):
        row = {
            "scenario": scenario,
            "agent": agent,
            "world": world,
            "phase": phase,
            "value": np.nan,
            "in_view": None,
            "lifetime_motions": lifetime_motions,
            "motions_since_perturbation": pd.NA,
            "trial": trial,
            "motions": of_trial,
            "robot_seconds": 5.0 * of_trial,
            "success": of_trial < CAP,
            "rendezvous": of_trial < CAP,
            "error_px": 1.0,
            "motions_to_4": of_trial if of_trial < CAP else np.nan,
            "motions_to_16": of_trial if of_trial < CAP else np.nan,
            "expected_px": np.nan,
        }
        found.append({**row, **columns})
    return pd.DataFrame(found)


def trials_of(agent="paper_servo", scenario="home", **when):
    return TrialsOf(agent=agent, scenario=scenario, **(when or {"motions": 0}))


def test_a_share_is_the_mean_over_worlds_with_its_interval(rng):
    motions = np.where(rng.random((WORLDS, 10)) < 0.8, 7, CAP)
    found = measured(
        rows("paper_servo", motions), suite(), Criterion(measure="rendezvous", of=trials_of(), above=0.5)
    )
    expected = mean_share((motions < CAP).mean(axis=1))
    assert found.estimate == expected
    assert found.worlds == WORLDS


def test_differences_are_paired_over_worlds(rng):
    of_world = rng.integers(3, 30, (WORLDS, 1))
    mine, others = of_world + np.zeros((1, 4), int), of_world + 2 + rng.integers(0, 2, (WORLDS, 4))
    results = pd.concat([rows("paper_servo", mine), rows("unified_servo", others)])
    test = Criterion(measure="motions", of=trials_of(), than=trials_of("unified_servo"), below=0)
    found = measured(results, suite(), test).estimate
    assert found == paired_motions(mine.mean(axis=1), others.mean(axis=1))
    assert found.high < -2  # although worlds differ by far more than that
    relative = measured(results, suite(), test.model_copy(update={"relative": True})).estimate
    assert relative.value == pytest.approx(mine.mean() / others.mean() - 1)


def test_trials_are_chosen_by_number_checkpoint_or_value():
    own = rows("paper_servo", np.tile([9, 8, 7, 6], (WORLDS, 1)), phase="train")
    checkpoints = [
        rows("paper_servo", np.full((WORLDS, 2), 10 * i), lifetime_motions=100 * i) for i in (1, 2, 3)
    ]
    at_5 = rows("paper_servo", np.full((WORLDS, 1), 4), "aim", "sweep", value=5.0, in_view=True)
    hidden = at_5.assign(motions=50, in_view=False)
    results = pd.concat([own, *checkpoints, at_5, hidden])
    for when, expected in (
        ({"trials": [2, 3]}, 7.5),
        ({"motions": 150}, 20),
        ({"motions": 200}, 20),
        ({"scenario": "aim", "value": 5}, 4),
    ):
        test = Criterion(
            measure="motions", of=TrialsOf(**{"agent": "paper_servo", "scenario": "home", **when}), below=1
        )
        assert measured(results, suite(), test).estimate.value == pytest.approx(expected)


def test_held_out_trials_at_a_change_are_those_before_it():
    before, after = (
        rows(
            "paper_servo",
            np.full((WORLDS, 2), motions),
            lifetime_motions=100,
            motions_since_perturbation=since,
        )
        for motions, since in ((5, pd.NA), (50, 0))
    )
    test = Criterion(measure="motions", of=trials_of(motions=100), below=9)
    assert measured(pd.concat([after, before]), suite(), test).estimate.value == 5


def test_without_all_its_runs_there_is_no_number():
    """On either side: it must not matter whom the missing runs would serve."""
    whole, part = (rows("unified_servo", np.full((worlds, 3), 1)) for worlds in (WORLDS, WORLDS - 1))
    criterion = Criterion(measure="success", of=trials_of("unified_servo"), above=0)
    assert measured(whole, suite(), criterion) is not None
    assert measured(part, suite(), criterion) is None
    both = Criterion(measure="motions", of=trials_of("unified_servo"), than=trials_of(), below=0)
    assert measured(whole, suite(), both) is None
    assert measured(pd.concat([whole, rows("paper_servo", np.full((3, 3), 60))]), suite(), both) is None


def test_the_papers_claims_need_results():
    of = load(CONFIGS / "paper.yaml")
    nothing = rows("nobody", np.empty((0, 0), int)).reindex(columns=rows("a", [[1]]).columns)
    assert {each.verdict for each in judge(nothing, of)} == {Verdict.UNTESTED}


def test_equal_agents_confirm_no_difference():
    same = [rows(agent, np.full((WORLDS, 3), 7)) for agent in ("paper_servo", "unified_servo")]
    faster = Criterion(measure="motions", of=trials_of(), than=trials_of("unified_servo"), below=0)
    assert verdict_of(faster, measured(pd.concat(same), suite(), faster)) is Verdict.NOT_CONFIRMED


def test_four_worlds_give_numbers_and_no_verdicts():
    works = claim(Criterion(measure="rendezvous", of=trials_of(), above=0.1))
    (judged,) = judge(rows("paper_servo", np.full((4, 5), 7)), suite([works.model_dump()], worlds=4))
    assert judged.verdict is Verdict.UNTESTED
    assert judged.found[0].estimate.value == pytest.approx(1)


def test_what_was_expected_is_held_against_what_came():
    """Trials of which nothing was told are left out."""
    came, expected = np.array([1, 1, 9, 9, 9]), np.array([3.0, 30.0, 3.0, 30.0, np.nan])
    results = rows("paper_servo", np.tile(came, (WORLDS, 1)), expected_px=0)
    results["expected_px"] = np.tile(expected, WORLDS)
    criterion = Criterion(measure="as_expected", of=trials_of(), above=0.9)
    assert measured(results, suite(), criterion).estimate.value == pytest.approx(0.5)
    assert measured(results.assign(expected_px=np.nan), suite(), criterion) is None


def test_only_trials_that_were_quick_can_be_kept():
    then, now = np.tile([1, 2, 9, 9], (WORLDS, 1)), np.tile([2, 5, 1, 9], (WORLDS, 1))
    results = pd.concat([rows("paper_servo", then), rows("paper_servo", now, lifetime_motions=100)])
    test = Criterion(measure="kept", of=trials_of(motions=100), than=trials_of(), above=0.9)
    assert measured(results, suite(), test).estimate.value == pytest.approx(0.5)
    never = pd.concat([rows("paper_servo", now * 0 + 9), rows("paper_servo", now, lifetime_motions=100)])
    assert measured(never, suite(), test) is None


def test_seconds_depend_on_the_look():
    results = rows("paper_servo", np.full((WORLDS, 3), 7), robot_seconds=40.0)  # eight looks of 4 s, and 8 s
    for look, expected in ((4, 40), (0.5, 12)):
        test = Criterion(measure="seconds", of=trials_of(), look=look, below=1)
        assert measured(results, suite(), test).estimate.value == pytest.approx(expected)


@pytest.mark.parametrize(
    ("low", "high", "bound", "expected"),
    [
        (0.96, 1.0, {"above": 0.95}, Verdict.CONFIRMED),
        (0.9, 1.0, {"above": 0.95}, Verdict.MIXED),
        (0.8, 0.94, {"above": 0.95}, Verdict.NOT_CONFIRMED),
        (1.0, 1.9, {"below": 2.0}, Verdict.CONFIRMED),
        (1.0, 2.1, {"below": 2.0}, Verdict.MIXED),
        (2.0, 3.0, {"below": 2.0}, Verdict.NOT_CONFIRMED),
    ],
)
def test_the_whole_interval_decides(low, high, bound, expected):
    test = Criterion(measure="success", of=trials_of(), **bound)
    estimate = Estimate((low + high) / 2, low, high)
    assert verdict_of(test, Measured(estimate, WORLDS)) is expected
    assert verdict_of(test, Measured(estimate, WORLDS - 1)) is Verdict.UNTESTED


OWN_TRIALS = {"agent": "paper_servo", "scenario": "home", "trials": [1, 2]}


def claim(*criteria, name="a_claim"):
    return Claim(name=name, section="1", words="It works.", criteria=criteria)


@pytest.mark.parametrize(
    ("verdicts", "expected"),
    [
        (["confirmed", "confirmed"], Verdict.CONFIRMED),
        (["confirmed", "mixed"], Verdict.MIXED),
        (["confirmed", "not confirmed"], Verdict.MIXED),
        (["not confirmed", "not confirmed"], Verdict.NOT_CONFIRMED),
        (["not confirmed", "untested"], Verdict.UNTESTED),
    ],
)
def test_a_claim_is_as_good_as_its_tests(verdicts, expected):
    test = Criterion(measure="success", of=trials_of(), above=0.5)
    assert JudgedClaim(claim(test, test), (None, None), tuple(map(Verdict, verdicts))).verdict is expected


def test_the_report_says_which_claims_stand():
    works = claim(Criterion(measure="rendezvous", of=trials_of(), above=0.8), name="it_works")
    learns = claim(
        Criterion(measure="motions", of=trials_of(motions=100), than=trials_of(), below=-1), name="it_learns"
    )
    unseen = claim(Criterion(measure="success", of=trials_of("unified_servo"), above=0.5), name="unseen")
    of = suite([each.model_dump() for each in (works, learns, unseen)])
    results = pd.concat(
        [
            rows("paper_servo", np.full((WORLDS, 5), 7)),
            rows("paper_servo", np.full((WORLDS, 5), 7), lifetime_motions=100),
            rows("unified_servo", np.full((WORLDS, 5), 7), scenario="away"),
        ]
    )
    judged = judge(results, of)
    assert [each.verdict for each in judged] == ["confirmed", "not confirmed", "untested"]
    (said,) = verdicts_in_words(judged)
    assert said == (
        "Of 3 claims of the paper 1 is confirmed (it works); 1 is not confirmed (it learns); "
        "1 is untested (unseen)."
    )
    asks = [replace(each, claim=each.claim.model_copy(update={"kind": "question"})) for each in judged[:1]]
    _, answered = verdicts_in_words([*judged[1:], *asks])
    assert answered == "Of 1 questions of the paper 1 is confirmed (it works)."
    section = claims_section(judged)
    assert section.text == " ".join(verdicts_in_words(judged))
    for table in section.tables:
        assert [row[-1] for row in table.rows] == ["confirmed", "not confirmed", "untested"]
    assert "rendezvous" in described(works.criteria[0])
    assert len(section.summary) == 3


@pytest.mark.parametrize(
    ("test", "said"),
    [
        ({"of": {"agent": "paper_servo", "scenario": "hom", "motions": 0}}, "hom"),
        ({"of": {"agent": "unified_servo", "scenario": "away", "trials": [1, 2]}}, "paper_servo"),
        ({"of": {"agent": "paper_servo", "scenario": "away", "trials": [1, 51]}}, "up to 50"),
        ({"of": {"agent": "paper_servo", "scenario": "home", "motions": 501}}, "up to 500"),
        ({"of": {"agent": "paper_servo", "scenario": "aim", "value": 4}}, "0, 5"),
        ({"of": {"agent": "paper_servo", "scenario": "home"}}, "one of trials, motions and value"),
        ({"of": {"agent": "paper_servo", "scenario": "home", "trials": [3, 2]}}, "first and the last"),
        ({"measure": "speed"}, "measure"),
        ({"measure": "seconds"}, "look"),
        ({"below": 0.9}, "above"),
        ({"relative": True}, "relative"),
        ({"measure": "kept"}, "kept"),
        (
            {"measure": "as_expected", "of": {"agent": "paper_servo", "scenario": "home", "trials": [1, 2]}},
            "held-out",
        ),
    ],
)
def test_wrong_claims_are_told(tmp_path, test, said):
    whole = {"measure": "success", "of": trials_of().model_dump(exclude_none=True), "above": 0.5, **test}
    (tmp_path / "claims.yaml").write_text(
        yaml.safe_dump([{"name": "c", "section": "1", "words": "w", "criteria": [whole]}])
    )
    data = suite().model_dump(mode="json", exclude={"claims"})
    (tmp_path / "suite.yaml").write_text(yaml.safe_dump({**data, "claims": "claims.yaml"}))
    with pytest.raises(ConfigError, match="claims") as error:
        load(tmp_path / "suite.yaml")
    assert said in str(error.value)
