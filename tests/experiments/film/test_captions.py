"""What a film says in words."""

import re

import numpy as np
import pytest

from calfree_gym.perturbations import TYPES
from experiments.film.captions import Status, announcement, caption


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


def test_the_caption_says_where_a_trial_is():
    status = Status("memory", 3, 1, {"error_px": 35.4})
    assert caption(status) == "memory · trial 3 · motion 1 · image error 35 px"
    reached = status._replace(success=True, over=True)
    assert caption(reached) == "memory · trial 3 · rendezvous after 1 motion · image error 35 px"
    missed = status._replace(motions=60, over=True)
    assert caption(missed) == "memory · trial 3 · no rendezvous in 60 motions · image error 35 px"


def test_a_grasp_tells_how_high_the_object_is():
    status = Status("grasp", 1, 9, {"error_px": 35.4, "lifted_mm": -0.2})
    assert caption(status) == "grasp · trial 1 · motion 9 · object 0 mm up"
    lifted = status._replace(motions=14, truth={"error_px": 3.0, "lifted_mm": 81.7}, success=True, over=True)
    assert caption(lifted) == "grasp · trial 1 · lift after 14 motions · object 82 mm up"
