"""What is told of an object that is pushed, and of a gripper that gets lost, against what was done."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.grasp.observation import NAMES, OBJECT, TIP, GraspObservation
from agents.grasp.seen import Lying
from agents.grasp.trial import InView
from calfree_gym.image import IMAGE_UNIT

NOISE_PX = 0.5
VARIANCE = (NOISE_PX * IMAGE_UNIT) ** 2


def seen(registers, object_=(0.1, 0.2, -0.1, 0.3), tip=True):
    points, visible = np.zeros((len(NAMES), 2, 2)), np.ones((len(NAMES), 2), bool)
    points[OBJECT], visible[TIP] = np.reshape(object_, (2, 2)), tip
    return GraspObservation(points, visible, np.asarray(registers, float), 1.0, False, np.zeros((2, 2)))


def lying(rng, slopes, looks=12):
    """Looks of an object in cameras that turn by so much for words of the arm (4, 3)."""
    first = seen(np.zeros(5), rng.normal([0.1, 0.2, -0.1, 0.3], NOISE_PX * IMAGE_UNIT))
    known = Lying(first)
    for _ in range(looks):
        known.look(look_at(rng, slopes, rng.uniform(-0.1, 0.1, 3)), VARIANCE, True)
    return known


def look_at(rng, slopes, registers, pushed=0.0):
    there = np.array([0.1, 0.2, -0.1, 0.3]) + slopes @ registers + pushed
    return seen([*registers, 0, 0], rng.normal(there, NOISE_PX * IMAGE_UNIT))


@given(st.integers(0, 10**6), st.sampled_from([0.0, 1.0]))
def test_what_lies_still_has_not_moved_and_what_was_pushed_has(seed, turns):
    rng = np.random.default_rng(seed)
    slopes = turns * rng.normal(size=(4, 3))
    known = lying(rng, slopes)
    assert not known.moved.any()
    by = np.array([20, -15, 10, 25]) * IMAGE_UNIT
    known.look(look_at(rng, slopes, np.array([0.02, 0.0, 0.01]), by), VARIANCE, False)
    assert known.moved.ravel() == pytest.approx(by, abs=5 * IMAGE_UNIT)
    target = known.points(lambda each: (each.points[OBJECT], each.visible[OBJECT]), VARIANCE)
    there = look_at(np.random.default_rng(0), slopes, np.array([0.0, 0.03, 0.0]), by).points[OBJECT]
    assert target.at(np.array([0.0, 0.03, 0.0])).object.points == pytest.approx(there, abs=5 * IMAGE_UNIT)


def test_where_nothing_was_met_a_view_that_is_hardly_foreseen_tells_of_no_push():
    rng = np.random.default_rng(3)
    slopes = rng.normal(size=(4, 3))
    known = Lying(seen(np.zeros(5)))
    known.look(look_at(rng, slopes, np.array([0.01, 0.0, 0.0])), VARIANCE, True)
    known.look(look_at(rng, slopes, np.array([0.3, -0.3, 0.2])), VARIANCE, True)
    assert not known.moved.any()


def test_a_tip_that_was_not_seen_twice_is_lost_and_words_get_shorter_until_it_is_seen_again():
    there = seen([0.1, 0.2, 0.3, 0.4, 0.0])
    view = InView(there)
    gone = replace(seen([0.5] * 5, tip=False))
    view.look(gone, True)
    assert not view.lost
    assert view.shorter == 1
    view.look(gone, False)
    assert view.lost
    assert view.shorter == 0.5
    assert (view.registers == there.registers).all()
    view.look(seen([0.2] * 5), False)
    assert not view.lost
    assert view.shorter == 0.5
    view.look(seen([0.3] * 5), True)
    assert view.shorter == 1
    assert (view.registers == 0.3).all()
