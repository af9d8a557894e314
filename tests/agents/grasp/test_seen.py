"""What a grasping agent makes of points that are hidden or pushed, and of directions."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from agents.grasp.observation import ARM, NAMES, OBJECT, TIP, GraspObservation
from agents.grasp.seen import Lying
from agents.grasp.trial import GraspFindings, GraspTrial, InView
from agents.grasp.turning import Turning, direction_key, directions, turn_needed
from calfree_gym.image import IMAGE_UNIT

NUMBER = st.floats(-1.0, 1.0)


def gripper(directions, axis=(0.0, 0.0, 0.0)):
    """An observation of a gripper whose edge, line and axis are seen so (4, 3), and of an object's axis."""
    points = np.zeros((len(NAMES), 4))
    edge, line, along = directions.T
    for name, place in {
        "tip": -along / 2,
        "base": along / 2,
        "edge_1": edge / 2,
        "edge_2": -edge / 2,
        "jaw_1": line / 2,
        "jaw_2": -line / 2,
        "object": -along / 2,
        "end_1": -along / 2 + directions @ axis / 2,
        "end_2": -along / 2 - directions @ axis / 2,
    }.items():
        points[NAMES.index(name)] = place
    seen = np.ones((len(NAMES), 2), bool)
    return GraspObservation(points.reshape(-1, 2, 2), seen, np.zeros(ARM + 2), 1.0, False, np.zeros((2, 2)))


@given(st.lists(NUMBER, min_size=12, max_size=12), st.lists(NUMBER, min_size=3, max_size=3))
def test_ways_are_told_in_gripper_lengths(directions, way):
    directions, way = np.reshape(directions, (4, 3)), np.array(way)
    assume(np.linalg.cond(directions) < 30)
    now = gripper(directions)
    np.testing.assert_allclose(now.in_gripper_lengths(directions @ way), now.proportions * way, atol=1e-6)
    now.visible[NAMES.index("edge_1"), 1] = False
    told = now.in_gripper_lengths(directions @ (way * [1, 1, 0]))
    if np.linalg.cond(directions[:2, :2]) > 3:
        assert told is None, "seen from one side"
    else:
        np.testing.assert_allclose(told, now.proportions * way * [1, 1, 0], atol=1e-6)


def test_an_angle_needs_the_object_and_the_gripper_in_one_image():
    directions = np.array([[1.0, 0, 0.2], [0, 1, 0.3], [0.9, 0.1, -1], [0, 1.1, 0.4]])
    now = gripper(directions, axis=(0.5, 0.3, 0))
    true = turn_needed("least_squares", now)
    assert turn_needed("unturned", now) == 0 != true
    now.visible[TIP, 0] = False
    assert turn_needed("least_squares", now) == pytest.approx(true)
    assert turn_needed("both_images", now) is None
    now.visible[TIP, 1] = False
    assert turn_needed("least_squares", now) is None


def lifted(turn=0.0, **seen):
    """The words (5,) of a gripper that lifts: it began at home, and its wrist has turned by that word."""
    first = gripper(np.random.default_rng(0).normal(size=(4, 3)))
    reach = SimpleNamespace(filter=SimpleNamespace(noise=SimpleNamespace(px=0.7)))
    trial = GraspTrial(None, "along_axis", "least_squares", first, GraspFindings(reach, Turning.unknown(ARM)))
    trial.now = replace(first, registers=np.array([0.4, 0.2, -0.1, turn, 1.0]), opening=0.3, **seen)
    return next(trial.lift())


@pytest.mark.parametrize(("turn", "sign"), [(0.0, 1), (0.95, -1)])
def test_jaws_that_hide_what_they_hold_turn_and_at_a_stop_the_other_way(turn, sign):
    hidden = np.ones((len(NAMES), 2), bool)
    assert lifted(turn, visible=hidden)[ARM] == 0
    hidden[OBJECT, 1] = False
    assert sign * lifted(turn, visible=hidden)[ARM] > 0.1


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


def looked(edge, axis):
    """What is seen of jaws and an object that point so (rad) in both images."""
    now = gripper(np.zeros((4, 3)))
    for name, angles in {"edge_1": edge, "end_1": axis}.items():
        now.points[NAMES.index(name)] = np.stack([np.cos(angles), np.sin(angles)], 1)
    return now


def test_directions_are_those_between_edge_and_axis_in_each_image():
    seen = looked([0.2, 1.0], [0.9, 0.5])
    assert directions(seen) == pytest.approx([0.7, -0.5])
    assert direction_key(seen) * np.pi / 2 == pytest.approx([0.1, 0.6])


def test_a_tip_that_was_not_seen_twice_is_lost_and_words_get_shorter_until_it_is_seen_again():
    there, found = seen([0.1, 0.2, 0.3, 0.4, 0.0]), []
    view = InView(there)
    for now, last in ((seen([0.5] * 5, tip=False), True), (seen([0.5] * 5, tip=False), False)):
        view.look(now, last)
        found.append((view.lost, view.shorter))
    assert (view.registers == there.registers).all()
    for now, last in ((seen([0.2] * 5), False), (seen([0.3] * 5), True)):
        view.look(now, last)
        found.append((view.lost, view.shorter))
    assert found == [(False, 1), (True, 0.5), (False, 0.5), (False, 1)]
    assert (view.registers == 0.3).all()
