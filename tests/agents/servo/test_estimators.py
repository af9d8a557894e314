"""Estimators of the Jacobian against MuJoCo's derivatives, and against algebra where the world is linear."""

import copy

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from agents.base.observation import Observation
from agents.servo.jacobian import ESTIMATORS, Kalman, TestMotions, distance_jacobian
from agents.servo.slopes import Slopes
from calfree_gym.image import IMAGE_UNIT, lengths_px
from tests.agents import analytic
from tests.agents.trials import STAND_FIRST

EVERY = {"test_motions": TestMotions, **ESTIMATORS}


ALL = np.ones(4, bool)


def longest_px(moved):
    """Of a displacement of all points (8,), the longest in pixels."""
    return lengths_px(moved.reshape(4, 2)).max()


class Robot:
    """An arm in a wild world, and an estimator that learns from what it does."""

    def __init__(self, env, estimator="test_motions"):
        self.env = env
        self.now = Observation.of(env.reset()[0])
        self.estimator = EVERY[estimator](3)

    def move(self, words):
        before, self.now = self.now, Observation.of(self.env.step(np.asarray(words, np.float32))[0])
        executed = self.now.registers - before.registers
        self.estimator.learn(executed, self.now.points - before.points, before.visible & self.now.visible)
        return executed

    def test(self, motor, pixels=16.0):
        """Moves one motor so far that some point moves by so many pixels; returns its executed word."""
        column = analytic.points_jacobian(self.env)[:, motor]
        return self.move(np.eye(3)[motor] * pixels / longest_px(column))[motor]


@pytest.mark.parametrize("seed", range(5))
def test_the_analytic_jacobian_is_what_the_simulation_does(mount, noise_free, seed):
    """The reference itself, against noise-free image points and their central differences."""
    env = noise_free(mount, seed)
    robot = Robot(env)
    robot.move(np.random.default_rng(seed).uniform(-0.1, 0.1, 3))
    true, middle = analytic.points_jacobian(env), robot.now.registers
    np.testing.assert_allclose(analytic.points(env), env.arms.true_points[0], atol=1e-6)
    for motor in range(3):
        points = []
        for sign in (1, -1):
            env.step(middle + sign * 1e-3 * np.eye(3)[motor] - env.arms.registers[0])
            points.append(env.arms.true_points.ravel())
        differences = (points[0] - points[1]) / 2e-3
        np.testing.assert_allclose(differences, true[:, motor], atol=1e-4 * np.abs(true).max())


@pytest.mark.parametrize("noise_px", [0.0, 0.5])
@pytest.mark.parametrize("estimator", EVERY)
def test_three_test_motions_give_every_estimator_the_analytic_jacobian(
    estimator, mount, noise_free, noise_px
):
    """Each column is that in the middle of its own motion, but for noise, curvature, and Broyden's ρ.

    A coordinate's two observations err by σ√2/w over a word w. A motion's mean slope differs from that in its
    middle by a small part of the slope's change. Regularised by ρ, an update learns the share w² / (ρ + w²).
    """
    for seed in range(4):
        robot = Robot(noise_free(mount, seed, noise_px), estimator)
        for motor in range(3):
            start = robot.now.registers
            word = robot.test(motor)
            first, middle, last = (
                analytic.points_jacobian(robot.env, start + share * word * np.eye(3)[motor])[:, motor]
                for share in (0.0, 0.5, 1.0)
            )
            rest = getattr(robot.estimator, "REGULARISATION", 0.0) / word**2 + 1e-3
            curve = 0.1 * np.abs(last - first).max() + rest * np.abs(middle).max()
            noise = 4.5 * noise_px * IMAGE_UNIT * np.sqrt(2) / abs(word)
            np.testing.assert_allclose(robot.estimator.jacobian[:, motor], middle, atol=curve + noise)


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize("mount", STAND_FIRST)
def test_lasting_estimators_follow_the_jacobian_through_small_motions(estimator, mount, noise_free):
    """After 20 motions of 20 px that lead away, the error is at most 0.6 of the unchanged J's (median)."""
    errors = []
    for seed in range(12):
        robot, rng = Robot(noise_free(mount, seed, 0.5), estimator), np.random.default_rng(seed)
        for motor in range(3):
            robot.test(motor)
        unchanged = distance_jacobian(robot.estimator.jacobian)
        away = rng.normal(size=3)
        for _ in range(20):
            true = analytic.points_jacobian(robot.env)
            lengths = np.linalg.norm(distance_jacobian(true), axis=0)
            words = (rng.normal(size=3) + 0.7 * away / np.linalg.norm(away)) / lengths
            robot.move(words * 20.0 / longest_px(true @ words))
        true = analytic.distance_jacobian(robot.env)
        scale = np.linalg.norm(true, axis=0)
        followed = distance_jacobian(robot.estimator.jacobian)
        errors.append([np.linalg.norm((found - true) / scale) for found in (followed, unchanged)])
    after, before = np.array(errors).T
    assert np.median(before) > 0.5  # J has changed much, or following it would prove nothing
    assert np.median(after / before) <= 0.6


def matrices(*shape, low=-1.0, high=1.0):
    return arrays(float, shape, elements=st.floats(low, high, width=32))


def moved_by(jacobian, words):
    """The points' displacement (4, 2) in a linear world."""
    return (jacobian @ words).reshape(4, 2)


def orthogonal(entries):
    """Three orthogonal motions (3, 3) of length 1."""
    return np.linalg.qr(entries + 3 * np.eye(3))[0]


def independent(entries):
    """Three independent motions (3, 3), with singular values of 1, 1/2 and 1/4."""
    left, _, right = np.linalg.svd(entries + np.diag([3.0, 4.0, 5.0]))
    return left @ np.diag([1.0, 0.5, 0.25]) @ right


@settings(max_examples=50)
@pytest.mark.parametrize("estimator", EVERY)
@given(jacobian=matrices(8, 3), entries=matrices(3, 3), size=st.floats(0.05, 0.3))
def test_in_a_linear_world_as_many_independent_motions_as_motors_give_j(estimator, jacobian, entries, size):
    """Where an update has rank one, it keeps what it learned of directions at right angles, and no others."""
    rank_one = {
        "test_motions": np.diag([1.0, -1.0, 1.0]),
        **dict.fromkeys(["broyden", "trust_region"], orthogonal(entries)),
    }
    found = EVERY[estimator](3)
    for words in size * rank_one.get(estimator, independent(entries)):
        found.learn(words, moved_by(jacobian, words), ALL)
    np.testing.assert_allclose(found.jacobian, jacobian, atol=5e-3)


@settings(max_examples=50)
@given(start=matrices(8, 3), words=matrices(3, low=0.0625), moved=matrices(8), other=matrices(3))
def test_broyden_explains_the_last_motion_by_the_least_change(start, words, moved, other):
    found = EVERY["broyden"](3, Slopes.of(start))
    found.learn(words, moved.reshape(4, 2), ALL)
    np.testing.assert_allclose(found.jacobian @ words, moved, atol=1e-3)
    across = other - words * (other @ words) / (words @ words)
    np.testing.assert_allclose(found.jacobian @ across, start @ across, atol=1e-9)


@pytest.mark.parametrize("estimator", EVERY)
def test_what_was_not_seen_changes_nothing(estimator):
    rng = np.random.default_rng(0)
    start, seen = rng.normal(size=(8, 3)), np.array([True, True, False, True])
    found = EVERY[estimator](3, Slopes.of(start))
    for words in 0.1 * np.eye(3):
        found.learn(words, rng.normal(size=(4, 2)), seen)
    rows = np.repeat(seen, 2)
    np.testing.assert_allclose(found.jacobian[~rows], start[~rows], atol=1e-9)
    assert (np.abs(found.jacobian - start)[rows] > 1e-3).all()


@pytest.mark.parametrize("noise_px", [0.1, 5.0])
def test_how_sure_a_jacobian_from_before_is_does_not_depend_on_the_noise_of_the_first_motion(noise_px):
    estimator = Kalman(3, Slopes.of(np.random.default_rng(0).normal(size=(8, 3))))
    before = estimator.deviations(np.ones(3))
    estimator.noise_px = noise_px
    estimator.learn(np.zeros(3), np.zeros((4, 2)), ALL)
    np.testing.assert_allclose(estimator.deviations(np.ones(3)), before)


@pytest.mark.parametrize("estimator", EVERY)
def test_an_estimator_begins_with_the_jacobian_that_it_is_given_and_a_copy_of_its_own(estimator):
    start = np.random.default_rng(0).normal(size=(8, 3))
    given_ = start.copy()
    found = EVERY[estimator](3, Slopes.of(given_))
    np.testing.assert_array_equal(found.jacobian, start)
    found.learn(np.array([0.1, 0.0, 0.0]), np.ones((4, 2)), ALL)
    np.testing.assert_array_equal(given_, start)
    np.testing.assert_array_equal(EVERY[estimator](3).jacobian, np.zeros((8, 3)))


@pytest.mark.parametrize("estimator", ["rls", "kalman", "local"])
def test_forgetting_lets_the_next_test_motions_decide(estimator):
    """After a change of sign test motions alone correct J; without forgetting, some of the old one stays."""
    old, errors = np.random.default_rng(0).normal(size=(8, 3)), {}
    for forgets in (True, False):
        found = EVERY[estimator](3)
        for _ in range(5):
            for words in 0.05 * np.eye(3):
                found.learn(words, moved_by(old, words), ALL)
        before = found.jacobian.copy()
        if forgets:
            found.forget()
            np.testing.assert_array_equal(found.jacobian, before)
        for words in 0.05 * np.eye(3):
            found.learn(words, moved_by(-old, words), ALL)
        errors[forgets] = np.abs(found.jacobian + old).max()
    assert errors[True] < 0.01
    assert errors[False] > 3 * errors[True]


def test_local_least_squares_withstands_one_gross_outlier_among_its_motions():
    """Among 12 motions of about 25 px one mistaken point, half an image away, in the first six."""
    rng, errors = np.random.default_rng(0), []
    for _ in range(100):
        true = rng.normal(size=(8, 3))
        sent = rng.uniform(-0.06, 0.06, (12, 3))
        moved = sent @ true.T + rng.normal(size=(12, 8)) * 0.7 * IMAGE_UNIT
        moved[rng.integers(6), :2] += rng.choice([-1, 1], 2)
        found = EVERY["local"](3)
        for words, displacement in zip(sent, moved, strict=True):
            found.learn(words, displacement.reshape(4, 2), ALL)
        plain = np.linalg.lstsq(sent, moved, rcond=None)[0].T
        errors.append([np.abs(estimate - true)[:2].max() for estimate in (found.jacobian, plain)])
    local, plain = np.array(errors).T
    assert np.mean(local < 0.2 * plain) >= 0.9
    assert np.median(local) < 0.2 < 1 < np.median(plain)


def test_trust_region_goes_further_where_it_predicts_well_and_less_far_where_not():
    true, words = np.random.default_rng(0).normal(size=(8, 3)), np.full(3, 0.1)
    found = EVERY["trust_region"](3, Slopes.of(true))
    reach = found.reach_px
    found.learn(words, moved_by(true, words), ALL)
    assert found.reach_px > reach
    for _ in range(3):
        found.learn(words, moved_by(-found.jacobian, words), ALL)
    assert found.reach_px < reach


@pytest.mark.parametrize("word", [0.01, 0.1])
def test_points_are_as_exact_as_the_kalman_filter_says(word):
    """Where J is constant, and paths curve by 2 %: errors² are those of its covariance."""
    rng, share, noise = np.random.default_rng(0), 0.02, 0.7 * IMAGE_UNIT
    ratios = []
    for _ in range(60):
        jacobian = rng.normal(size=(4, 2, 3)) * 30 * IMAGE_UNIT / word
        found, true = EVERY["kalman"](3), rng.uniform(-0.5, 0.5, (4, 2))
        estimated = true + noise * rng.normal(size=(4, 2))
        for motion in range(20):
            words = word * (np.eye(3)[motion] if motion < 3 else rng.normal(size=3))
            straight = jacobian @ words
            curved = share * np.linalg.norm(straight, axis=-1, keepdims=True) * rng.normal(size=(4, 2))
            true = true + straight + curved
            seen = true + noise * rng.normal(size=(4, 2))
            estimated = estimated + found.learn(words, seen - estimated, ALL)
            if motion > 5:
                ratios.append(np.square((estimated - true) / IMAGE_UNIT).mean() / found.blur_px**2)
    assert 0.7 < np.mean(ratios) < 1.2


@pytest.mark.parametrize("estimator", ["trust_region", "rls"])
def test_looking_again_teaches_nothing_of_a_jacobian(estimator):
    learner, rng = EVERY[estimator](3), np.random.default_rng(0)
    for words in 0.1 * np.eye(3):
        learner.learn(words, rng.normal(size=8), ALL)
    twin = copy.deepcopy(learner)
    for _ in range(8):
        learner.learn(np.zeros(3), 0.01 * rng.normal(size=8), ALL)
    words, moved = np.array([0.1, -0.05, 0.02]), rng.normal(size=8)
    for each in (learner, twin):
        each.learn(words, moved, ALL)
    np.testing.assert_array_equal(learner.jacobian, twin.jacobian)
