"""Perturbations, schedules and sweeps as people read them."""

import re

import numpy as np
import pytest

from calfree_gym.perturbations import TYPES
from experiments.config.in_words import (
    Knock,
    again_and_again,
    axis_in_words,
    in_words,
    knocks,
    schedule_in_words,
)
from experiments.config.suite import ScenarioConfig, SweepConfig

AIM = {"type": "camera_aim", "camera": "left", "degrees": 20}
ENV = {"id": "CalFree/Reach-v0", "world": "wild"}


def scenario(*events, **length):
    return ScenarioConfig(name="s", env=ENV, perturbations=events, **(length or {"motions": 100}))


@pytest.mark.parametrize(
    ("do", "words"),
    [
        (AIM, "left camera turned by 20°"),
        ({"type": "camera_roll", "camera": "right"}, "right camera rolled by any angle"),
        ({"type": "camera_replace"}, "a camera replaced"),
        ({"type": "motor_sign"}, "a motor reversed"),
        ({"type": "motor_gain", "motor": "J2", "factor": 0.8371}, "motor J2's gain times 0.837"),
        ({"type": "motor_gain"}, "another gain of a motor"),
        ({"type": "camera_shift", "camera": "right", "metres": -0.052}, "right camera moved by 0.052 m"),
        ({"type": "dead_zone", "words": 0.1}, "a motor ignores words up to 0.1"),
        ({"type": "dead_zone"}, "dead zone"),
        ({"type": "undo", "event": 0}, "all as before change 1"),
        ({"type": "image_fog", "camera": "left", "share": 1 / 3}, "image fog (camera left, share 0.333)"),
    ],
)
def test_a_perturbation_is_named(do, words):
    assert in_words(do) == words


@pytest.mark.parametrize("kind", TYPES)
def test_every_type_has_words_with_and_without_settings(kind):
    drawn = TYPES[kind]().drawn(np.random.default_rng(0)).to_dict()
    words = in_words(drawn)
    assert all(
        drawn[part] in words for part in ("camera", "motor", "joint", "link", "wheel") if part in drawn
    )
    assert re.fullmatch(r"[\w .,:=°'-]+", words), "no name of a setting"
    assert len(words) < 50
    assert re.fullmatch(r"[\w .,:=°'-]+", in_words({"type": kind}))


def test_knocks_stand_in_the_order_of_a_life():
    replace = {"at": {"motion": 80}, "do": {"type": "camera_replace", "camera": "left"}}
    reverse = {"at": {"motion": 80}, "do": {"type": "motor_sign"}}
    found = knocks(scenario(replace, {"at": {"motion": 40}, "do": AIM}, reverse))
    assert found == [
        Knock(None, "after 40 motions", "left camera turned by 20°"),
        Knock(None, "after 80 motions", "left camera replaced, a motor reversed"),
    ]
    back = {"at": {"trial": 6}, "undo": 0}
    found = knocks(scenario({"at": {"trial": 4}, "do": AIM}, back, trials=8))
    assert found == [
        Knock(4, "before trial 5", "left camera turned by 20°"),
        Knock(6, "before trial 7", "undone: left camera turned by 20°"),
    ]
    assert knocks(scenario()) == []
    by_trials = {"at": {"trial": 5}, "do": {"type": "motor_sign"}}
    assert knocks(scenario({"at": {"motion": 10}, "do": AIM}, by_trials)) is None, (
        "nobody knows which is first"
    )


def test_a_schedule_says_when_everything_changes():
    noise = {"at": {"motion": 0}, "do": {"type": "point_noise", "px": 2}}
    roll = {"every": {"motion": 12}, "do": {"type": "camera_roll", "camera": "left"}}
    replace = {"at": {"share": 0.25}, "do": {"type": "camera_replace", "camera": "left"}}
    assert schedule_in_words(scenario(roll, replace, noise)) == (
        "from the beginning: image noise of 2 px; after 25 % of a life: left camera replaced; "
        "every 12 motions: left camera rolled by any angle"
    )
    assert schedule_in_words(scenario()) == ""


def test_what_changes_all_the_time_is_no_knock():
    roll = {"type": "camera_roll", "camera": "left"}
    always = scenario(
        {"every": {"motion": 12}, "do": roll},
        {"every": {"motion": 12}, "do": roll | {"camera": "right"}},
        {"drift": {"per": "trial"}, "do": AIM},
        trials=8,
    )
    assert knocks(always) is None
    assert again_and_again(always) == (
        "every 12 motions: left camera rolled by any angle, right camera rolled by any angle; "
        "in every trial: left camera turned by 20°"
    )


def test_axes_have_units():
    roll = SweepConfig(
        name="r", env=ENV, do={"type": "camera_roll", "camera": "left"}, vary="degrees", over=(0,)
    )
    assert axis_in_words(roll) == "roll of the left camera (degrees)"
    late = SweepConfig(name="l", env=ENV, do={"type": "latency"}, vary="motions", over=(0, 1))
    assert axis_in_words(late) == "latency: motions"
