"""Looks that are anywhere in the image, among looks at a function that is smooth."""

import numpy as np
import pytest

from agents.servo.image_model.gaussian_process import (
    GaussianProcess,
    odds_by_the_rest,
    price,
    right_looks,
)
from calfree_gym.image import IMAGE_UNIT

NOISE = 0.7 * IMAGE_UNIT
SEEN = np.ones(2, bool)


def scene(seed, looks=30, mistaken=0.08):
    """Places (n, 3), what is seen there (n, 2, 2), which of it is mistaken (n, 2), and where the point is."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(-0.6, 0.6, (looks, 3))
    bends = rng.normal(scale=0.3, size=(2, 2, 3))
    true = np.tanh(np.einsum("icm,nm->nic", bends, places) + 0.1)
    points = true + rng.normal(scale=NOISE, size=true.shape)
    wrong = rng.random((looks, 2)) < mistaken
    points[wrong] = rng.uniform(-1, 1, (np.count_nonzero(wrong), 2))
    return places, points, wrong, true


def looked(places, points):
    function = GaussianProcess.unknown(3, 3)
    for place, seen in zip(places, points, strict=True):
        function = function.with_look(place, seen, NOISE**2, SEEN)
    return function


@pytest.mark.parametrize("seed", range(6))
def test_mistaken_looks_are_found_in_each_image(seed):
    places, points, wrong, true = scene(seed)
    right = right_looks(looked(places, points))
    far = wrong & (np.linalg.norm(points - true, axis=2) > 20 * IMAGE_UNIT)
    assert not right[far].any()
    assert np.mean(right[~wrong]) > 0.9


def test_each_is_judged_by_those_that_stay():
    rng = np.random.default_rng(0)
    for _ in range(30):
        places = rng.uniform(-1, 1, (rng.integers(6, 30), 3))
        away = np.square(places[:, None] - places).sum(-1)
        covariance = np.exp(-away) + 1e-5 * np.eye(len(places))
        seen = np.linalg.cholesky(covariance) @ rng.normal(size=(len(places), 2))
        wrong = rng.random(len(places)) < 0.3
        seen[wrong] += rng.normal(scale=0.5, size=(np.count_nonzero(wrong), 2))
        left_out = rng.permutation(len(places))[: len(places) // 2].tolist()
        inverse = np.linalg.inv(covariance)
        for look, odds in zip(left_out, odds_by_the_rest(left_out, inverse, inverse @ seen), strict=True):
            rest = [each for each in range(len(places)) if each not in left_out]
            told = covariance[look, rest] @ np.linalg.inv(covariance[np.ix_(rest, rest)])
            variance = covariance[look, look] - told @ covariance[rest, look]
            off = np.square(seen[look] - told @ seen[rest]).sum()
            assert odds == pytest.approx(
                off / (2 * variance) + np.log(2 * np.pi * variance) + price(), rel=1e-4
            )
