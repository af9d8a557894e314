"""What a film says in words."""

import re

import gymnasium as gym
import numpy as np
import pytest

from calfree_gym.perturbations import TYPES
from experiments.film.recorder import Status, announcement, caption, told


def test_a_knock_is_told_in_words():
    knock = {"type": "camera_aim", "camera": "left", "degrees": 15.0, "direction": 40.0}
    assert announcement(knock) == "left camera turned by 15 degrees"
    assert announcement({**knock, "degrees": -15.0}) == "left camera turned by 15 degrees"
    shift = {"type": "camera_shift", "camera": "right", "metres": -0.052, "azimuth": 0.0, "elevation": 0.0}
    assert announcement(shift) == "right camera moved by 5 cm"
    assert announcement({"type": "undo", "event": 0}) == "all as before change 1"


@pytest.mark.parametrize("name", TYPES)
def test_every_perturbation_is_told_with_what_it_hit(name):
    drawn = TYPES[name]().drawn(np.random.default_rng(0)).to_dict()
    words = announcement(drawn)
    for part in ("camera", "motor", "joint", "link"):
        assert part not in drawn or drawn[part] in words
    assert re.fullmatch(r"[\w .,=%'-]+", words)
    assert len(words) < 50


def test_one_without_words_of_its_own_is_told_by_its_settings():
    assert announcement({"type": "image_fog", "camera": "left", "share": 1 / 3}) == (
        "image fog: camera left, share 0.333"
    )
    assert announcement({"type": "image_fog"}) == "image fog"


def told_at(status):
    return caption("someone", status)


def test_the_caption_says_where_a_trial_is():
    status = Status(3, 1, {"truth": {"error_px": 35.4}})
    assert told_at(status) == "someone · trial 3 · motion 1 · 35 px off"
    reached = status._replace(success=True, over=True)
    assert told_at(reached) == "someone · trial 3 · reached in 1 motion · 35 px off"
    missed = status._replace(motions=60, over=True)
    assert told_at(missed) == "someone · trial 3 · not reached in 60 motions · 35 px off"
    assert told(status._replace(motions=0)) == "reach 3: begins"
    assert told(reached) == "reach 3: 1 motion"
    assert told(missed) == "reach 3: 60 motions, in vain"


@pytest.mark.parametrize(
    ("info", "said"),
    [
        ({"truth": {"error_px": 9, "lifted_mm": 0.0}}, "not held"),
        ({"truth": {"error_px": 9, "lifted_mm": -0.1}}, "held"),
        ({"truth": {"error_px": 9, "lifted_mm": 81.7}}, "held, 82 mm up"),
        ({"truth": {"error_px": 9, "depth_mm": -20.0, "lateral_mm": 1.0}}, "peg outside the hole"),
        ({"truth": {"error_px": 9, "depth_mm": 12.2, "lateral_mm": 30.0}}, "peg outside the hole"),
        ({"truth": {"error_px": 9, "depth_mm": 12.2, "lateral_mm": 1.0}}, "peg 12 mm in the hole"),
        ({"truth": {"error_px": 9}, "contacts": 0, "peak_force": 0.0}, "9 px off · touches nothing"),
        ({"truth": {"error_px": 9}, "contacts": 2, "peak_force": 8.6}, "9 px off · touches with 9 N"),
    ],
)
def test_each_task_tells_what_is_true_of_it(info, said):
    assert told_at(Status(1, 9, info)) == f"someone · trial 1 · motion 9 · {said}"


@pytest.mark.parametrize("name", ["Reach", "SafeReach", "Grasp", "Insert"])
def test_every_environment_tells_it(name):
    env = gym.make(f"CalFree/{name}-v0")
    info = env.reset(seed=0)[1]
    words = told_at(Status(1, 0, info, success=True))
    done = {"Grasp": "lifted", "Insert": "inserted"}.get(name, "reached")
    assert f" · {done} in 0 motions · " in words
    outcome = {"Grasp": "not held", "Insert": "peg outside the hole", "SafeReach": "touches nothing"}
    assert words.endswith(outcome.get(name, "px off"))
    env.close()
