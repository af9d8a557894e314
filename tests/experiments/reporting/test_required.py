"""Numbers that a suite requires: whether they are met, and what cannot be required."""

import pandas as pd
import pytest

from experiments.config.claims import Requirement
from experiments.config.loading import load
from experiments.errors import ConfigError
from experiments.reporting.claims import required_section
from experiments.running.run import runs_of

SUITE = {
    "name": "asked",
    "question": "Is it as it should be?",
    "first_world": 7,
    "worlds": 2,
    "sweeps": [
        {
            "name": "noise",
            "env": {"id": "CalFree/Reach-v0", "world": "wild", "dynamics": "kinematic"},
            "do": {"type": "point_noise"},
            "vary": "px",
            "over": [0.5],
        }
    ],
    "evaluation": None,
    "agents": ["oracle"],
}
OF = {"agent": "oracle", "scenario": "noise", "value": 0.5}


@pytest.fixture
def asked(write_config):
    """A suite with one requirement."""
    return lambda **required: load(write_config({**SUITE, "required": [{"of": OF, **required}]}))


@pytest.fixture
def results():
    """One trial in each of two worlds: the second fails."""
    return pd.DataFrame(
        {
            "scenario": "noise",
            "agent": "oracle",
            "phase": "sweep",
            "value": 0.5,
            "in_view": True,
            "world": [0, 1],
            "trial": 0,
            "motions": [2, 60],
            "success": [True, False],
            "rendezvous": [True, False],
            "error_px": [1.0, 16.0],
        }
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
def test_a_number_is_met_whatever_its_interval(asked, results, required, measured, bound, met):
    (table,) = required_section(results, asked(**required)).tables
    assert table.frame.iloc[0, 1:].tolist() == [measured, bound, met]


def test_what_has_not_finished_is_said(asked, results):
    (table,) = required_section(results[:1], asked(measure="motions", at_most=3)).tables
    assert table.frame["met"].tolist() == ["unfinished"]


@pytest.mark.parametrize(
    ("required", "said"),
    [
        ({"measure": "motions"}, "one of at_least and at_most is the bound"),
        ({"measure": "motions", "at_least": 1, "at_most": 2}, "one of at_least and at_most is the bound"),
        (
            {"measure": "worst_world", "at_most": 2, "than": OF},
            "worst_world compares nothing",
        ),
        ({"measure": "motions", "at_most": 2, "of": {**OF, "value": 1}}, "found value 1.0; allowed: 0.5"),
        ({"measure": "motions", "at_most": 2, "of": {**OF, "agent": "orakel"}}, "did you mean oracle"),
    ],
)
def test_what_cannot_be_required(asked, required, said):
    with pytest.raises(ConfigError, match=said):
        asked(**required)


def test_worlds_have_the_seeds_from_the_first_on_and_older_suites_are_told_as_before(asked):
    suite = asked(measure="motions", at_most=3)
    assert runs_of(suite)[0].world_seeds == (7, 8)
    assert suite.told()["first_world"] == 7
    assert Requirement(**suite.told()["required"][0]) == suite.required[0]
    plain = suite.model_copy(update={"first_world": None, "required": ()})
    assert not {"first_world", "required"} & plain.told().keys()
