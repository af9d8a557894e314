"""Steps are made as long as the Jacobian can be trusted, and no longer."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from agents.base.observation import Observation
from agents.servo.jacobian import TestMotions
from agents.servo.slopes import Slopes
from agents.servo.trial import Findings, ServoTrial, Steps
from calfree_gym.image import lengths_px
from tests.agents.trials import carry_out

STEP_PX, STEP_WORD, BORDER = 100.0, 0.5, 0.9


def numbers(*shape, most=1.0):
    return arrays(float, shape, elements=st.floats(-most, most))


def steps_in(jacobian, points):
    """Steps of a trial in which J (8, 3) is known and points (4, 2) are seen."""
    findings = Findings(TestMotions(3, Slopes.of(jacobian)))
    trial = ServoTrial(Observation(points, np.ones(4, bool), np.zeros(3)), findings, 0.04, 16.0)
    return Steps(trial, STEP_PX, STEP_WORD, BORDER)


@settings(max_examples=100)
@given(numbers(8, 3, most=3.0), numbers(4, 2, most=0.8), numbers(3))
def test_a_step_keeps_its_direction_and_all_bounds(jacobian, points, words):
    made = steps_in(jacobian, points).bounded(words)
    moved = (jacobian @ made).reshape(4, 2)
    np.testing.assert_allclose(np.cross(made, words), 0, atol=1e-12)
    assert made @ words >= 0
    assert np.abs(made).max() <= STEP_WORD + 1e-12
    assert lengths_px(moved).max() <= STEP_PX + 1e-6
    out = np.abs(points + moved) > BORDER + 1e-9
    assert not out.any() or np.linalg.norm(made) <= Steps.LEAST_SHARE * np.linalg.norm(words) + 1e-12


@settings(max_examples=50)
@given(numbers(8, 3, most=0.1), numbers(4, 2, most=0.5), numbers(3, most=0.4))
def test_a_step_that_meets_no_bound_is_made_as_it_is(jacobian, points, words):
    np.testing.assert_array_equal(steps_in(jacobian, points).bounded(words), words)


def test_a_point_already_outside_may_come_back_but_not_go_further():
    jacobian = np.zeros((8, 3))
    jacobian[0, 0] = 1.0
    points = np.zeros((4, 2))
    points[0, 0] = 0.95
    steps = steps_in(jacobian, points)
    inwards, outwards = np.array([-0.1, 0, 0]), np.array([0.1, 0, 0])
    np.testing.assert_array_equal(steps.bounded(inwards), inwards)
    np.testing.assert_allclose(steps.bounded(outwards), Steps.LEAST_SHARE * outwards)


@pytest.mark.parametrize("lost", [False, True])
def test_a_step_that_loses_a_point_is_taken_back_and_the_next_one_is_shorter(lost):
    jacobian = np.concatenate([0.3 * np.eye(4, 3), np.zeros((4, 3))])
    steps, words, registers = steps_in(jacobian, np.zeros((4, 2))), np.array([0.2, 0.0, 0.0]), np.zeros(3)
    trial = steps.trial
    assert not list(trial.begin())
    trial.filter.latency.confirmed = True
    trial.known[:] = True

    def observed(made):
        registers[:] += made
        visible = np.array([not (lost and registers.any()), True, True, True])
        return Observation((jacobian @ registers).reshape(4, 2), visible, registers.copy())

    sent, _ = carry_out(steps.make(words), observed, 12)
    np.testing.assert_array_equal(sent[0], words)
    np.testing.assert_allclose(registers, 0 if lost else words, atol=1e-12)
    assert steps.confidence == pytest.approx(Steps.SHORTER if lost else 1.0)
