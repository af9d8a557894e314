"""What arcs do to marks in images: against matrix exponentials, and against plane geometry."""

import numpy as np
import pytest

from agents.docking.projective_model import DrivenArc, ProjectiveModel, homography
from calfree_gym.image import IMAGE_UNIT
from tests.agents.docking.robot import WHEELS, Robot


def motions(robot, count, size=0.3):
    """Motions from anywhere, of which all marks are seen before and after."""
    found = []
    while len(found) < count:
        robot.reset()
        before, words = robot.last, robot.rng.uniform(-size, size, len(robot.bend))
        robot.step(words)
        if robot.seen(robot.pose)[1].all():
            found.append(DrivenArc(before, words, robot.last, np.ones(len(before), bool)))
    return found


def taught(robot, count=40):
    """A model that has learned from so many motions."""
    model = ProjectiveModel(4, len(robot.bend))
    for each in motions(robot, count):
        model.learn(each)
    model.fit(20)
    return model


def worst_px(model, seen):
    """How far off any point of these motions is predicted, in pixels."""
    return max(np.abs(model.predict(m.before, m.words) - m.after).max() for m in seen) / IMAGE_UNIT


@pytest.mark.parametrize("base", WHEELS)
def test_it_predicts_any_arc_of_linear_motors_once_it_has_learned(base):
    robot = Robot(1, base, bend=0.0)
    assert worst_px(taught(robot), motions(robot, 30)) < 1.5


def test_the_homography_of_its_own_marks_carries_it_over_a_turn_of_the_camera():
    robot = Robot(4, bend=0.0)
    model, before = taught(robot), robot.seen(np.zeros(3))[0]
    robot.knock(15)
    seen = motions(robot, 20)
    lost = worst_px(model, seen)
    model.carry_over(homography(before, robot.seen(np.zeros(3))[0])[None])
    assert worst_px(model, seen) < 2 < 20 < lost
    for each in seen:
        model.learn(each)
    model.fit(10)
    assert worst_px(model, seen) < 0.5


@pytest.mark.parametrize("hidden", [(0,), (0, 3), (1, 2)])
def test_hidden_marks_move_with_those_that_are_seen(hidden):
    robot = Robot(7, bend=0.0)
    model, wrong, off_px = taught(robot), [], []
    visible = ~np.isin(np.arange(4), hidden)
    for each in motions(robot, 30):
        words = each.words * [1.08, 0.92]
        expected = model.predict(each.before, words)
        found = np.where(visible[:, None], each.after, 9.0)
        here = model.corrected(expected, words, found, visible)
        np.testing.assert_array_equal(here[visible], each.after[visible])
        wrong.append(np.abs(expected - each.after)[~visible].max() / IMAGE_UNIT)
        off_px.append(np.abs(here - each.after)[~visible].max() / IMAGE_UNIT)
    assert np.median(off_px) < 1.5 < 5 < np.median(wrong)
