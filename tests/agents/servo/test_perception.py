"""Noise, gates and visibility, each alone."""

import numpy as np
import pytest
from scipy.stats import multivariate_t

from agents.base.observation import Observation
from agents.servo.perception import Gating, NoiseEstimate, Visibility
from calfree_gym.image import IMAGE_UNIT

PREDICTED = np.zeros((4, 2))
RADII = np.full(4, 30.0)


def seen(px):
    """All points in place but the first, so many pixels (2,) away."""
    points = PREDICTED.copy()
    points[0] += np.array(px) * IMAGE_UNIT
    return Observation(points, np.ones(4, bool), np.zeros(3))


@pytest.mark.parametrize("noise_px", [1.0, 8.0, 20.0])
def test_noise_is_that_of_one_observation_not_of_a_difference(noise_px):
    rng, found = np.random.default_rng(0), []
    for _ in range(20):
        noise = NoiseEstimate()
        for _ in range(30):
            first, second = rng.normal(scale=noise_px * IMAGE_UNIT, size=(2, 4, 2))
            noise.add(second - first)
        found.append(noise.px)
    assert np.mean(found) == pytest.approx(noise_px, rel=0.06)


@pytest.mark.parametrize(("mistaken", "least"), [(0.0, 0.9), (0.1, 0.8), (0.4, 0.4)])
def test_two_looks_again_tell_the_noise_to_a_half_also_among_mistaken_points(mistaken, least):
    rng, found = np.random.default_rng(0), []
    for _ in range(200):
        noise, true = NoiseEstimate(), rng.uniform(-0.5, 0.5, (4, 2))
        for _ in range(2):
            looks = true + rng.normal(scale=4 * IMAGE_UNIT, size=(2, 4, 2))
            wrong = rng.random((2, 4, 1)) < mistaken
            first, second = np.where(wrong, rng.uniform(-1, 1, looks.shape), looks)
            noise.add(second - first)
        found.append(noise.px)
    assert np.mean((np.array(found) > 4 / 1.5) & (np.array(found) < 4 * 1.5)) > least


def test_noise_is_that_of_a_good_marker_until_enough_is_known_or_where_a_file_hardly_tells_it():
    noise = NoiseEstimate()
    assert noise.px == 0.7
    noise.add(np.full((4, 2), 30 * IMAGE_UNIT))
    assert noise.px == 0.7
    noise.add(np.full((20, 2), 0.1))
    assert noise.px != 0.7
    noise.restore(np.empty(0), np.empty(0))
    assert noise.px == 0.7


def test_homes_tell_the_noise_until_some_is_seen_in_a_row():
    """Cameras that were moved between two trials move home by more than any noise."""
    rng, noise = np.random.default_rng(0), NoiseEstimate()
    for _ in range(30):
        noise.add_homes(np.diff(rng.normal(scale=2 * IMAGE_UNIT, size=(2, 4, 2)), axis=0)[0])
    assert noise.px == pytest.approx(2, rel=0.2)
    for _ in range(30):
        noise.add_homes(rng.normal(scale=60 * IMAGE_UNIT, size=(4, 2)))
    assert noise.px > NoiseEstimate.NOISY_PX
    assert not noise.measured
    for _ in range(10):
        noise.add(np.diff(rng.normal(scale=2 * IMAGE_UNIT, size=(2, 4, 2)), axis=0)[0])
    assert noise.px == pytest.approx(2, rel=0.2)
    assert noise.measured


def test_gates_end_where_a_point_is_as_likely_to_be_mistaken_as_right():
    """By the densities themselves: Student's t in two coordinates, and anywhere in the image."""
    deviations_px, noise_px, share = np.array([1.0, 5.0, 20.0, 80.0]), 3.0, Gating.MISTAKEN / Gating.OF
    radii = Gating().radii(deviations_px, noise_px)
    scales = np.hypot(deviations_px, noise_px)
    right = multivariate_t(shape=np.eye(2), df=Gating.TAILS)
    densities = [right.pdf([r / s, 0]) / s**2 for r, s in zip(radii, scales, strict=True)]
    np.testing.assert_allclose(np.array(densities) * (1 - share), share / 512**2, rtol=1e-6)


@pytest.mark.parametrize("count", [1, 2])
def test_a_point_is_trusted_within_its_gate_alone(count):
    for px, found in ((29.0, True), (31.0, False)):
        observations = [seen([px, 0.0]), seen([-300.0, 0.0])][:count]
        assert Gating().estimate(observations, PREDICTED, RADII, 0.7).found[0] == found


def test_points_outside_their_gates_are_trusted_where_two_observations_agree_and_only_there():
    apart = Gating().estimate([seen([90.0, 0.0]), seen([-90.0, 40.0])], PREDICTED, RADII, 0.7)
    np.testing.assert_array_equal(apart.points, PREDICTED)
    assert apart.found.tolist() == [False, True, True, True]
    observations = [seen([90.0, 0.0]), seen([-90.0, 40.0]), seen([92.0, 0.0])]
    agreeing = Gating().estimate(observations, PREDICTED, RADII, 0.7)
    np.testing.assert_allclose(agreeing.points[0], [91 * IMAGE_UNIT, 0])
    assert agreeing.inconsistent.tolist() == [True, False, False, False]


def test_gates_get_narrower_the_more_mistaken_points_have_been_met():
    gating, widths = Gating(), []
    for far in [0.0] * 5 + [200.0] * 5:
        widths.append(gating.radii(np.full(4, 5.0), 0.7)[0])
        observations = [seen([far, 0.0]), seen([0.0, 0.0])]
        gating.count(observations, gating.estimate(observations, PREDICTED, RADII, 0.7), 0.7)
    widths.append(gating.radii(np.full(4, 5.0), 0.7)[0])
    assert np.all(np.diff(widths[:6]) > 0)
    assert np.all(np.diff(widths[5:]) < 0)
    assert widths[-1] < 0.8 * widths[5]


ALL, HIDDEN = np.ones(4, bool), np.array([True, False, True, True])


@pytest.mark.parametrize(("gaps", "patience"), [(False, 1), (True, 4)])
def test_a_point_is_lost_that_was_not_seen_for_longer_than_gaps_last(gaps, patience):
    visibility = Visibility()
    visibility.gaps = gaps
    for _ in range(patience):
        visibility.add(HIDDEN, again=False)
        assert not visibility.lost.any()
    visibility.add(HIDDEN, again=False)
    assert visibility.lost.tolist() == [False, True, False, False]
    visibility.add(ALL, again=False)
    assert not visibility.lost.any()


def test_where_looking_again_never_helped_a_point_is_lost_at_once():
    visibility = Visibility()
    for _ in range(2):
        visibility.add(HIDDEN, again=False)
        assert not visibility.lost.any()
        visibility.add(HIDDEN, again=True)
        assert visibility.lost[1]
        visibility.add(ALL, again=False)
    visibility.add(HIDDEN, again=False)
    assert visibility.lost[1]
    assert not visibility.gaps
    for _ in range(3):
        visibility.add(ALL, again=True)
        visibility.add(HIDDEN, again=False)
    assert visibility.may_return
    assert visibility.gaps
