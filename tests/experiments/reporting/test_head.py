"""The head of a report, of results that were made up so that its numbers are known."""

import numpy as np
import pandas as pd
import pytest

import agents
from experiments.reporting.by_trial import own_trials
from experiments.reporting.figures import in_words
from experiments.reporting.finished_suite import about, few_worlds
from experiments.reporting.head import sentences, table_of
from experiments.reporting.held_out import held_out
from tests.experiments.fakes import AIM
from tests.experiments.reporting.made_up import finished_suite, results

WORLDS, CAP = 20, 20
COLUMNS = [
    *("agent", "what it must know", "motions per reach before → right after the knock"),
    "trials that reach right after",
]


def life(agent, before, right_after, learned=0, again=10, worlds=WORLDS):
    """Held-out trials of each world, ten at each checkpoint: the world changes after 50 motions.

    All trials reach after `learned` motions, and `again` after the change.
    """
    checkpoints = (
        (0, pd.NA, before, learned == 0),
        (25, pd.NA, before, learned <= 25),
        (50, pd.NA, before, learned <= 50),
        (50, 0, right_after, again == 0),
        (60, 10, before, again <= 10),
        (90, 40, before, again <= 40),
    )
    rows = [
        (world, trial, lifetime, since, motions, (good or trial > 0) and motions < CAP)
        for world in range(worlds)
        for lifetime, since, motions, good in checkpoints
        for trial in range(10)
    ]
    names = "world trial lifetime_motions motions_since_perturbation motions success"
    return results(names, rows, agent=agent)


@pytest.fixture
def finished(suite_data):
    """The suite of some lives; those of other agents failed."""
    agents = ["oracle", "random", "unified_servo", "memory", "paper_servo"]
    return lambda *lives, worlds=WORLDS, **changes: finished_suite(
        {**suite_data, "worlds": worlds, "agents": agents, **changes}, pd.concat(lives)
    )


def five(worlds=WORLDS):
    return (
        life("oracle", 1, 1, again=0, worlds=worlds),
        life("random", CAP, CAP, learned=99, again=99, worlds=worlds),
        life("unified_servo", 4, 5, again=0, worlds=worlds),
        life("memory", 2, 6, learned=25, again=10, worlds=worlds),
        life("paper_servo", 9, 9, learned=99, again=99, worlds=worlds),
    )


WORDS = {name: in_words(name, name) for name in agents.names()}


def test_the_table_says_who_must_know_what_and_reaches_how_soon(finished):
    table = head_table(finished(*five()))
    assert table.header[:-1] == COLUMNS
    rows = {row[0]: row[1:] for row in table.rows}
    assert rows[WORDS["oracle"]] == ["where to go", "1.0 → 1.0", "100 %", "0 → 0"]
    assert rows[WORDS["random"]] == ["nothing", "20.0 → 20.0", "0 %", "not in 50 → not in 40"]
    assert rows[WORDS["unified_servo"]] == ["nothing", "4.0 → 5.0", "100 %", "0 → 0"]
    right_after = (9 * 6 + CAP) / 10  # one trial in ten fails
    assert rows[WORDS["memory"]] == ["nothing", f"2.0 → {right_after:.1f}", "90 %", "25 → 10"]
    assert "[" not in table.markdown()
    assert "The knock: left camera turned by 20°." in table.note


def test_worlds_of_which_agents_met_others_are_named(finished):
    of = finished(*five())
    (aimed,) = of.suite.scenarios
    assert "the same ones for every agent. After" in about(of, aimed), "results of before do not tell"
    for run in of.runs:
        of.outcomes[run.id]["met"] = f"world {run.where['world']}"
    assert "the same ones for every agent (they and their changes were equal)." in about(of, aimed)
    of.outcomes[of.runs[0].id]["met"] = "another"
    assert f"(but not all met the same in worlds {of.runs[0].where['world']})" in about(of, aimed)


def test_the_table_is_of_the_first_scenario_in_which_the_world_changes(finished, suite_data):
    (aimed,) = suite_data["scenarios"]
    calm = {**aimed, "name": "calm", "perturbations": []}
    of = finished(*five(), scenarios=[calm, aimed])
    assert of.head_part.name == "aimed"
    of = finished(*five(), scenarios=[calm])
    table = head_table(of)
    assert table.header[2] == "motions per reach at the end"
    assert {cell for row in table.rows for cell in row[2:4]} == {"–"}, "no run of it has finished"


def test_the_knock_is_not_what_lives_begin_with(finished, suite_data):
    (aimed,) = suite_data["scenarios"]
    noise = {"at": {"trial": 0}, "do": {"type": "point_noise", "px": 1}}
    noisy = {**aimed, "name": "noisy", "perturbations": [noise]}
    aimed["perturbations"].insert(0, noise)
    lives = pd.concat(five())
    since = lives["motions_since_perturbation"].fillna(lives["lifetime_motions"])
    of = finished(lives.assign(motions_since_perturbation=since), scenarios=[noisy, aimed])
    assert of.head_part.name == "aimed"
    table = head_table(of)
    assert [row[2] for row in table.rows if row[0] == WORDS["unified_servo"]] == ["4.0 → 5.0"]
    assert "The knock: left camera turned by 20°." in table.note


def test_of_a_drift_the_end_is_told(finished, suite_data):
    (aimed,) = suite_data["scenarios"]
    drift = {"drift": {"per": "motion"}, "do": {**AIM, "degrees": 0.01}}
    of = finished(*five(), scenarios=[{**aimed, "perturbations": [drift, *aimed["perturbations"]]}])
    table = head_table(of)
    assert table.header[2] == "motions per reach at the end"
    assert [row[2:] for row in table.rows if row[0] == WORDS["memory"]] == [["2.0", "100 %", "25"]]
    assert sentences(*both(of))[0].startswith("At the end, ")


def test_three_sentences_rank_those_who_can_be_told_apart(finished):
    best, cost, again = sentences(*both(finished(*five())))
    memory, unified, paper = (WORDS[name] for name in ("memory", "unified_servo", "paper_servo"))
    assert f"{memory} needs the fewest motions per reach, 2.0" in best
    assert f"{memory} loses most (2.0 → 7.4 " in cost
    assert f"{paper} least (10.1 → 10.1)" in cost
    assert again.index(unified) < again.index(f"{memory} last, within 10 motions") < again.index(paper)
    assert not any(WORDS[name] in best + cost + again for name in ("oracle", "random"))


def test_equal_agents_are_not_told_apart(finished):
    same = [life(agent, 3, 3) for agent in ("unified_servo", "memory", "paper_servo")]
    best, *_ = sentences(*both(finished(*same)))
    assert best.endswith("but no other agent can be told apart from it.")
    noisy = life("memory", 3, 3)
    noisy["motions"] += np.where(noisy["world"] % 2, 1, -1)
    best, *_ = sentences(*both(finished(same[0], noisy, life("paper_servo", 9, 9))))
    assert "cannot be told apart from it" in best
    assert WORDS["paper_servo"] not in best


def test_few_worlds_rank_nobody(finished):
    (best,) = sentences(*both(finished(*five(4), worlds=4)))
    assert f"2.0 ({WORDS['memory']}) to 10.1 ({WORDS['paper_servo']}) motions per reach" in best
    assert "fewest" not in best


def test_who_is_in_few_worlds_is_not_ranked_beside_the_others(finished):
    few = ["unified_servo", {"name": "memory", "worlds": 8}, "paper_servo"]
    lives = pd.concat(five())
    of = finished(lives[(lives["agent"] != "memory") | (lives["world"] < 8)], agents=few)
    assert few_worlds(of, of.head_part) == " memory is in fewer than 20 worlds: no intervals, and not ranked."
    said = " ".join(sentences(*both(of)))
    assert f"{WORDS['unified_servo']} needs the fewest motions per reach" in said
    assert WORDS["memory"] not in said


def test_who_met_the_change_in_few_worlds_is_not_ranked_by_them(finished):
    all_, memory = (life(agent, 4, 5, again=0) for agent in ("unified_servo", "memory"))
    fast = memory["world"] < 3  # in others its life ends before the world changes
    memory.loc[fast, "motions"] = 1
    met = memory[fast | memory["motions_since_perturbation"].isna()]
    of = finished(all_, met, life("paper_servo", 9, 9), agents=["unified_servo", "memory", "paper_servo"])
    said = " ".join(sentences(*both(of)))
    assert f"{WORDS['unified_servo']} needs the fewest motions per reach" in said
    assert WORDS["memory"] not in said
    rows = {row[0]: row[1:] for row in head_table(of).rows}
    assert rows[WORDS["memory"]][2] == "100 % in 3 of 20 worlds"


def test_own_trials_are_told_before_and_after_a_change(suite_data):
    (aimed,) = suite_data["scenarios"]
    aimed = {key: value for key, value in aimed.items() if key != "motions"} | {"trials": 8}
    knock = {"at": {"trial": 5}, "do": aimed["perturbations"][0]["do"]}
    rows = [(world, trial, 9 if trial == 5 else 2 + trial) for world in range(3) for trial in range(8)]
    rows = results("world trial motions", rows, agent="memory", phase="train", robot_seconds=9.0)
    told = {}
    for events in ([knock], []):
        suite = {**suite_data, "worlds": 3, "agents": ["memory"], "evaluation": None}
        of = finished_suite({**suite, "scenarios": [{**aimed, "perturbations": events}]}, rows)
        table = table_of(of, of.suite.scenarios[0], own_trials(of, of.suite.scenarios[0]))
        told[bool(events)] = (table.header[2], table.rows[0][2], table.note, about(of, of.suite.scenarios[0]))
    assert told[True][:2] == ("motions per reach in trials 2–5 → 6 → 7–8", "4.5 → 9.0 → 8.5")
    assert told[True][2].endswith("Before trial 6: left camera turned by 20°.")
    assert "Before trial 6: left camera turned by 20°." in told[True][3]
    assert told[False][:2] == ("motions per reach in trials 1 → 2–8", "2.0 → 6.3")
    assert "trial 6" not in told[False][2] + told[False][3]


def both(finished):
    return finished, held_out(finished, finished.suite.scenarios[0])


def head_table(finished):
    part = finished.head_part
    return table_of(finished, part, held_out(finished, part))


def test_one_world_is_one_world(suite_data):
    of = {worlds: finished_suite({**suite_data, "worlds": worlds}) for worlds in (1, 2, 20)}
    (aimed,) = of[1].suite.scenarios
    assert few_worlds(of[1], aimed).startswith(" 1 world, fewer than 20")
    assert few_worlds(of[2], aimed).startswith(" 2 worlds, fewer than 20")
    assert few_worlds(of[20], aimed) == ""
    assert ", 90 motions a life, 1 world, the same" in about(of[1], aimed)
