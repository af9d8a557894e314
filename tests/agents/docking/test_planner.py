"""Plans lead where they say, in as few arcs as it takes."""

import numpy as np
import pytest

from agents.docking.planner import Planner
from calfree_gym.image import lengths_px
from tests.agents.docking.robot import Robot
from tests.agents.docking.test_projective_model import taught


@pytest.fixture(scope="module")
def robot():
    return Robot(11, bend=0.0)


@pytest.fixture(scope="module")
def model(robot):
    return taught(robot)


def planned(robot, model, rest=None):
    """A plan from where the robot stands."""
    points, goal = robot.seen(robot.pose)[0], robot.seen(np.zeros(3))[0]
    return Planner(np.ones((4, 2)), np.random.default_rng(0)).plan(model, points, goal, rest)


def test_one_arc_is_planned_where_one_leads_to_the_dock(robot, model):
    robot.pose = np.zeros(3)
    words = np.linalg.lstsq(robot.wheels, [0.04, 0.0, 0.01], rcond=None)[0]
    robot.drive(-words)
    np.testing.assert_allclose(planned(robot, model).words, [words], atol=0.03)


def test_several_arcs_lead_aside_as_far_as_the_plan_says(robot, model):
    robot.pose = np.array([-0.9, 0.08, 0.0])
    plan = planned(robot, model)
    assert 1 < len(plan.words) <= 3
    for words in plan.words:
        robot.drive(words)
    left_px = lengths_px(robot.seen(robot.pose)[0] - robot.seen(np.zeros(3))[0]).max()
    assert abs(left_px - plan.left_px) < 8
    assert np.abs(robot.pose).max() < 0.05
