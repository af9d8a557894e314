"""What is known of usual slopes, against samples of a distribution that is known."""

import numpy as np
import pytest

from agents.servo.slopes import Slopes

MOTORS = 3
HOLD = np.ones(4, bool)


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def lived(rng, spread, trials, known=0.0, hold=HOLD):
    """Slopes after trials whose Jacobians are a mean one and an error of each motor's own spread (m,)."""
    mean = rng.normal(size=(8, MOTORS))
    seen = [mean + rng.normal(size=(8, MOTORS)) * spread for _ in range(trials)]
    variances = np.tile(known**2 * np.eye(MOTORS), (4, 1, 1))
    slopes = Slopes.of(seen[0], variances=variances)
    for each in seen[1:]:
        slopes = slopes.corrected(Slopes.of(each, variances=variances), hold)
    return mean, seen, slopes


def test_many_trials_tell_the_mean_and_what_each_motor_differs_by(rng):
    spread = np.array([0.1, 0.5, 1.5])
    mean, _, slopes = lived(rng, spread, 400)
    np.testing.assert_allclose(slopes.jacobian, mean, atol=4 * spread.max() / np.sqrt(400))
    np.testing.assert_allclose(np.sqrt(slopes.changes), np.tile(spread, (4, 1)), rtol=0.2)
    assert slopes.trials == 399


def test_what_no_longer_holds_is_replaced_by_what_was_seen(rng):
    hold = np.array([True, True, False, False])
    _, seen, slopes = lived(rng, np.ones(MOTORS), 5, hold=hold)
    np.testing.assert_array_equal(slopes.jacobian[4:], seen[-1][4:])
    assert np.abs(slopes.jacobian[:4] - seen[-1][:4]).max() > 0.1
