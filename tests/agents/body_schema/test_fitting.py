"""Fits against chains that are known, and what is left of a normal distribution against its covariance."""

import numpy as np
import pytest

from agents.body_schema.body import Body, likely_mounts
from agents.body_schema.chain import Views
from agents.body_schema.fitting import Gaussian
from calfree_gym.image import IMAGE_UNIT
from tests.agents.body_schema.chains import Arm


@pytest.mark.parametrize(("file", "site", "mount"), [("scara.xml", "tip", 0), ("redundant.xml", "tool", 2)])
def test_a_body_is_found_from_nothing(file, site, mount):
    """From 160 looks, where it was never seen: to less than the noise."""
    arm = Arm(file, site, mount)
    body = Body(arm.chain.motors, seed=1)
    body.learn(arm.pairs(trials=40, seed=4))
    new = arm.pairs(trials=20, noise_px=0.0, seed=5)
    views = Views(body.known.chain, body.known.fitted.numbers, new.registers, new.homes)
    off_px = np.linalg.norm(views.points[:, :2].reshape(-1, 4) - new.sensors, axis=1) / IMAGE_UNIT
    assert body.known.explains
    assert np.median(off_px) < 0.5


def test_what_it_expects_is_as_far_off_as_it_says():
    """Of 300 points, the errors by their standard deviations have a mean square of one."""
    arm = Arm("scara.xml", "tip")
    known = arm.known(arm.pairs(trials=12, seed=6))
    new = arm.pairs(trials=100, noise_px=0.0, seed=7)
    squares = []
    for registers, home, sensors in zip(new.registers, new.homes, new.sensors, strict=True):
        points, deviations_px = known.expected(registers, home)
        off_px = (points[:2] - sensors.reshape(2, 2)) / IMAGE_UNIT
        squares.append(np.square(off_px / deviations_px[:2, None]).mean())
    assert 0.4 < np.mean(squares) < 2.0


def test_what_is_known_but_for_some_is_the_marginal_of_the_others():
    random = np.random.default_rng(0)
    factor = random.normal(size=(5, 5))
    covariance = factor @ factor.T + np.eye(5)
    changed = np.array([False, True, False, False, True])
    left = Gaussian(np.zeros(5), np.linalg.inv(covariance)).but_for(changed, np.full(5, 3.0))
    found = np.linalg.inv(left.information)
    np.testing.assert_allclose(found[np.ix_(~changed, ~changed)], covariance[np.ix_(~changed, ~changed)])
    np.testing.assert_allclose(found[np.ix_(changed, changed)], 9.0 * np.eye(2))
    np.testing.assert_allclose(left.root @ left.root.T, found)


@pytest.mark.parametrize("mount", [0, 1, 3, 5, 7])
def test_the_mount_is_among_the_guesses(mount):
    arm = Arm("redundant.xml", "tool", mount)
    assert (mount, mount) in likely_mounts(arm.pairs(trials=6, seed=8, reach=0.2), Body.GUESSES)
