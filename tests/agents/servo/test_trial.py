"""A trial in a linear world: test words that adapt, stops that are met, steps that can be trusted."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from agents.base.observation import Observation
from agents.base.registers import Stops
from agents.servo.jacobian import Kalman, TestMotions
from agents.servo.slopes import Slopes
from agents.servo.trial import Findings, ServoTrial, Steps
from calfree_gym.image import lengths_px
from tests.agents.linear_arm import LinearArm
from tests.agents.trials import carry_out

TEST_PX = 16.0


def trial_of(arm, estimator):
    return ServoTrial(arm.observed(), Findings(estimator), 0.04, TEST_PX)


def moved(motions, arm):
    """Executes motions to their end; returns the words sent, re-observations left out."""
    words, _ = carry_out(motions, arm.observed)
    return words[words.any(1)]


@pytest.fixture
def arm():
    return LinearArm([400.0] * 3)


@pytest.mark.parametrize("px_by_word", [80.0, 400.0, 1200.0])
@pytest.mark.parametrize("estimator", [TestMotions, Kalman])
def test_test_words_get_the_size_that_moves_the_images_as_wanted(estimator, px_by_word):
    arm = LinearArm([px_by_word] * 3)
    trial = trial_of(arm, estimator(3))
    for _ in range(3):
        for motor in range(3):
            moved(trial.test(motor), arm)
    moved_px = np.abs(trial.test_words) * px_by_word
    np.testing.assert_allclose(moved_px, TEST_PX, rtol=0.05)
    np.testing.assert_allclose(trial.estimator.jacobian, arm.jacobian, atol=0.02 * np.abs(arm.jacobian).max())


def test_a_test_motion_moves_one_motor_and_towards_the_object(arm):
    trial = trial_of(arm, TestMotions(3, Slopes.of(arm.jacobian)))
    for motor in range(3):
        before = trial.now.distance
        words = moved(trial.test(motor), arm)
        assert np.flatnonzero(words[0]).tolist() == [motor]
        assert trial.now.distance @ trial.now.distance < before @ before


class SlippingArm(LinearArm):
    """Motors give way a little at their stops, as coupled ones do."""

    def observed(self, words=0.0):
        before = self.registers
        seen = super().observed(words)
        pushed = before + words - self.registers
        return replace(seen, registers=seen.registers + 0.004 * pushed)


def test_a_motor_that_gives_way_at_its_stop_is_tested_the_other_way():
    arm = SlippingArm([10.0] * 3, highest=np.array([0.0, 1.0, 1.0]))
    trial = trial_of(arm, TestMotions(3))
    trial.test_words[0] = trial.LARGEST_TEST
    words = moved(trial.test(0), arm)
    assert words[:, 0].tolist() == [trial.LARGEST_TEST, -trial.LARGEST_TEST]
    assert not trial.still.any()
    np.testing.assert_allclose(trial.estimator.jacobian[:, 0], arm.jacobian[:, 0], rtol=0.05)


def test_where_a_motor_stops_is_believed_when_it_does_not_move_at_all_by_a_second_word():
    arm = LinearArm([100.0] * 3, lowest=np.array([-1, -0.3, -1]), highest=np.array([0.2, 1, 1]))
    trial = trial_of(arm, TestMotions(3, Slopes.of(arm.jacobian)))
    moved(trial.move(np.array([0.5, -0.7, 0.1])), arm)
    np.testing.assert_allclose(trial.stops.highest, [1.2, 1, 1.1])  # one word beyond where motors have been
    moved(trial.move(np.array([0.5, -0.5, 0.1])), arm)
    np.testing.assert_allclose(trial.stops.highest, [0.2, 1, 1.2])
    np.testing.assert_allclose(trial.stops.lowest, [-1, -0.3, -1])
    lowest, highest = trial.word_bounds
    np.testing.assert_allclose(highest, [0.0, 1.3, 1.0])
    np.testing.assert_allclose(lowest, [-1.2, 0.0, -1.2])


def test_a_motion_that_has_a_greatest_length_is_no_stop():
    stops = Stops(np.zeros(1))
    for register in 0.1 * np.arange(1, 6):
        stops.learn(np.array([0.7]), np.array([0.6]), np.array([register]))
    assert stops.highest[0] == pytest.approx(1.5)


def test_a_word_that_is_longer_than_words_can_be_meets_no_stop(arm):
    """As on the way back from afar; environments execute a word of one."""
    trial = trial_of(arm, TestMotions(3))
    (words,) = moved(trial.move(np.array([-1.6, 0.4, 0.0])), arm)
    np.testing.assert_allclose(words, [-1.0, 0.4, 0.0])
    assert np.isinf(trial.stops.found).all()


def test_where_no_motor_goes_further_a_step_looks_again(arm):
    """Else a servo whose motors press against their stops would think for ever."""
    steps = Steps(trial_of(arm, TestMotions(3)), step_px=100, step_word=0.7, border=0.95)
    words, _ = carry_out(steps.make(np.zeros(3)), arm.observed)
    assert len(words)
    assert not words.any()


def test_a_motor_at_its_stop_is_tested_the_other_way():
    arm = LinearArm([400.0] * 3, highest=np.array([0.001, 1, 1]))
    trial = trial_of(arm, TestMotions(3))
    words = moved(trial.test(0), arm)
    assert len(words) == 2
    assert words[0, 0] > 0 > words[1, 0]
    np.testing.assert_allclose(trial.estimator.jacobian[:, 0], arm.jacobian[:, 0], atol=1e-9)


def test_test_motions_find_all_that_is_trusted_and_forgetting_asks_for_them_anew(arm):
    """Found is nothing merely predicted; the words keep their sizes."""
    trial, home = trial_of(arm, TestMotions(3)), arm.observed().points
    assert list(trial.unmeasured()) == [0, 1, 2]
    for motor in range(3):
        moved(trial.test(motor), arm)
    assert len(trial.findings.trusted) >= 3
    for each in trial.findings.trusted:
        there = home + (arm.jacobian @ each.registers).reshape(4, 2)
        np.testing.assert_allclose(each.points, there, atol=1e-12)
    assert list(trial.unmeasured()) == []
    trial.forget()
    assert list(trial.unmeasured()) == [0, 1, 2]
    px = [lengths_px((arm.jacobian @ word).reshape(4, 2)).max() for word in np.diag(trial.test_words)]
    np.testing.assert_allclose(px, TEST_PX, rtol=1e-6)


@given(
    arrays(float, 3, elements=st.floats(-9, 9)),
    st.lists(arrays(float, (2, 3), elements=st.floats(-2, 2)), max_size=6),
)
def test_a_motor_always_stands_between_its_stops(registers, motions):
    stops = Stops(registers)
    for words, executed in motions:
        registers = registers + executed
        stops.learn(words, words - executed, registers)
        assert (stops.lowest <= registers).all()
        assert (registers <= stops.highest).all()


@pytest.mark.parametrize("seed", range(20))
def test_a_test_word_keeps_its_sign_where_it_brings_the_gripper_neither_nearer_nor_farther(arm, seed):
    """But for rounding: it is moved across the way to the object."""
    rng = np.random.default_rng(seed)
    turned = np.linalg.qr(rng.normal(size=(4, 4)))[0]
    arm.home = np.concatenate([0.2 * turned[0].reshape(2, 2), np.zeros((2, 2))])
    trial = trial_of(arm, TestMotions(3))
    trial.estimator.jacobian[:4, 0] = turned[1]
    trial.test_words[:] = 0.04
    assert next(trial.test(0))[0] == 0.04


STEP_PX, STEP_WORD, BORDER = 100.0, 0.5, 0.9


def numbers(*shape, most=1.0):
    return arrays(float, shape, elements=st.floats(-most, most))


def steps_in(jacobian, points, edges=(1.0, 1.0)):
    """Steps of a trial in which J (8, 3) is known, points (4, 2) are seen, and images end at edges (2,)."""
    findings = Findings(TestMotions(3, Slopes.of(jacobian)), edges=np.tile(edges, (4, 1)))
    trial = ServoTrial(Observation(points, np.ones(4, bool), np.zeros(3)), findings, 0.04, 16.0)
    return Steps(trial, STEP_PX, STEP_WORD, BORDER)


@settings(max_examples=100)
@given(numbers(8, 3, most=3.0), numbers(4, 2, most=0.8), numbers(3), st.sampled_from([1.0, 0.75]))
def test_a_step_keeps_its_direction_and_all_bounds(jacobian, points, words, height):
    edges = np.array([1.0, height])
    points = points * edges
    made = steps_in(jacobian, points, edges).bounded(words)
    moved = (jacobian @ made).reshape(4, 2)
    np.testing.assert_allclose(np.cross(made, words), 0, atol=1e-12)
    assert made @ words >= 0
    assert np.abs(made).max() <= STEP_WORD + 1e-12
    assert lengths_px(moved).max() <= STEP_PX + 1e-6
    out = np.abs(points + moved) > BORDER * edges + 1e-9
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
