"""Four equations for three words: solving them, and what is done with the one too many (section 3.2)."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import least_squares, lsq_linear

from agents.base.weights import cauchy_weights, huber_weights
from agents.servo.redundancy import REDUNDANCIES, omit, solve, solve_within, transform, weighted
from calfree_gym.image import IMAGE_UNIT


def numbers(*shape, low=-1.0, high=1.0):
    return arrays(float, shape, elements=st.floats(low, high))


JACOBIANS = numbers(4, 3).map(lambda entries: entries + np.eye(4, 3) * 3)


def left_null(jacobian):
    """The direction (4,) of image distances that no words change: the cross product of J's columns."""
    minors = [np.linalg.det(np.delete(jacobian, row, axis=0)) * (-1) ** row for row in range(4)]
    return np.array(minors) / np.linalg.norm(minors)


@settings(max_examples=50)
@pytest.mark.parametrize("redundancy", REDUNDANCIES)
@given(jacobian=JACOBIANS, words=numbers(3))
def test_where_the_four_equations_agree_every_use_of_them_solves_all(redundancy, jacobian, words):
    equations = REDUNDANCIES[redundancy](jacobian, -jacobian @ words)
    np.testing.assert_allclose(solve(*equations, 0.0), words, atol=1e-6)


@settings(max_examples=50)
@given(JACOBIANS, numbers(4))
def test_omit_keeps_the_three_equations_with_the_largest_least_singular_value(jacobian, distance):
    kept, kept_distance = omit(jacobian, distance)
    threes = [np.delete(jacobian, row, axis=0) for row in range(4)]
    least = [np.linalg.svd(each, compute_uv=False)[-1] for each in (kept, *threes)]
    assert least[0] == pytest.approx(max(least[1:]))
    equations = np.column_stack([jacobian, distance]).tolist()
    assert all(each in equations for each in np.column_stack([kept, kept_distance]).tolist())


@settings(max_examples=50)
@given(JACOBIANS, numbers(4))
def test_transform_leaves_out_just_what_no_words_can_change(jacobian, distance):
    turned, kept = transform(jacobian, distance)
    assert turned.shape == (3, 3)
    best = np.linalg.lstsq(jacobian, -distance, rcond=None)[0]
    np.testing.assert_allclose(np.linalg.solve(turned, -kept), best, atol=1e-6)
    assert kept @ kept == pytest.approx(distance @ distance - (left_null(jacobian) @ distance) ** 2, abs=1e-9)


def test_weighted_leaves_out_a_contradicting_coordinate_better_than_plain_least_squares():
    rng, errors = np.random.default_rng(0), []
    for _ in range(500):
        jacobian, words = rng.normal(size=(4, 3)), rng.uniform(-0.2, 0.2, 3)
        distance = -jacobian @ words + rng.normal(size=4) * 0.7 * IMAGE_UNIT
        wrong = np.abs(left_null(jacobian)).argmax()
        distance[wrong] += rng.choice([-1, 1]) * rng.uniform(20, 80) * IMAGE_UNIT
        plain = np.linalg.lstsq(jacobian, -distance, rcond=None)[0]
        robust = solve(*weighted(jacobian, distance), 0.0)
        errors.append([np.abs(found - words).max() for found in (robust, plain)])
    robust, plain = np.array(errors).T
    assert np.median(robust / plain) < 0.2
    assert np.mean(robust < plain) > 0.95


@settings(max_examples=50)
@given(JACOBIANS, numbers(4), numbers(3, low=0.01, high=100.0), st.floats(0, 0.5))
def test_a_word_has_no_unit_damped_solutions_change_with_it(jacobian, distance, units, damping):
    words = solve(jacobian, distance, damping)
    in_units = solve(jacobian / units, distance, damping)
    np.testing.assert_allclose(in_units, words * units, rtol=1e-6, atol=1e-9)


@settings(max_examples=50)
@given(JACOBIANS, numbers(4), st.integers(0, 2))
def test_a_motor_of_which_nothing_is_known_gets_a_zero_word(jacobian, distance, motor):
    jacobian[:, motor] = 0
    words = solve(jacobian, distance, 0.0)
    others = np.delete(np.arange(3), motor)
    assert words[motor] == 0
    best = np.linalg.lstsq(jacobian[:, others], -distance, rcond=None)[0]
    np.testing.assert_allclose(words[others], best, atol=1e-6)


@settings(max_examples=50)
@given(JACOBIANS, numbers(4), numbers(3, low=0.01, high=0.5))
@example(  # held back one after the other, motors would end further away
    np.array([[-0.9375] * 3] * 3 + [[0, -0.9375, -0.9375]]) + np.eye(4, 3) * 3,
    np.array([0.0, 0, 0, 1]),
    np.array([0.5, 0.125, 0.125]),
)
def test_bounded_words_keep_within_bounds_help_and_are_the_best_where_none_binds(jacobian, distance, bounds):
    words = solve_within(jacobian, distance, 0.0, -bounds, bounds)
    assert (np.abs(words) <= bounds + 1e-12).all()
    best = lsq_linear(jacobian, -distance, (-bounds, bounds), method="bvls").cost
    ours = 0.5 * ((jacobian @ words + distance) ** 2).sum()
    assert best - 1e-9 <= ours <= 0.5 * (distance**2).sum() + 1e-9
    if (np.abs(solve(jacobian, distance, 0.0)) <= bounds).all():
        assert ours == pytest.approx(best, abs=1e-9)


DEVIATIONS = np.array([-20.0, -3.0, -1.0, 0.0, 0.5, 2.0, 7.0])


@pytest.mark.parametrize("scale", [0.5, 1.0, 3.0])
def test_weights_are_scipy_s(scale):
    """The derivatives of its ρ(deviation²), from a fit's gradient: jᵀ w r with j = 1."""
    for loss, found in (
        ("cauchy", cauchy_weights(DEVIATIONS / scale)),
        ("huber", huber_weights(DEVIATIONS, scale)),
    ):
        options = {"loss": loss, "f_scale": scale, "max_nfev": 1}
        fits = [least_squares(lambda x, r=r: x + r, [0.0], **options) for r in DEVIATIONS]
        weights = [fit.grad[0] / r if r else 1.0 for fit, r in zip(fits, DEVIATIONS, strict=True)]
        np.testing.assert_allclose(found, weights, rtol=1e-6)
