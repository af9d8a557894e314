"""Has anything changed? Against worlds that were, and worlds that were not."""

import numpy as np
import pytest

from agents.memory.detector import ChangeDetector, ChangeVerdict
from agents.memory.pairs import HomeView
from agents.servo.perception import NoiseEstimate
from calfree_gym.image import IMAGE_UNIT
from calfree_gym.perturbations import CameraAim, CameraRoll, MotorSign
from tests.agents.memory.gripper_views import known, trial, wild

TRIALS = 30


def homes(count, seed, rate_px=0.0):
    home = HomeView()
    rng = np.random.default_rng(seed)
    for i in range(count):
        gone = np.array([i * rate_px * IMAGE_UNIT, 0, 0, 0])
        home.add(gone + rng.normal(0, 0.5 * IMAGE_UNIT, 4), 0.5, i)
    return home


def test_a_view_that_jumps_or_drifts_does_so_in_the_camera_that_moved():
    home = homes(20, 0)
    assert home.jumped(np.array([0, 0, 6 * IMAGE_UNIT, 0])).tolist() == [False, True]
    assert homes(30, 1, rate_px=0.2).drifting().tolist() == [True, False]
    rate = homes(30, 1, 0.2).drift_rate(12)
    np.testing.assert_allclose(rate[0], 0.2 * IMAGE_UNIT, atol=0.15 * IMAGE_UNIT)
    assert not homes(30, 1, rate_px=0.2).jumped(np.array([30 * 0.2 * IMAGE_UNIT, 0, 0, 0])).any()


@pytest.fixture(scope="module", params=[4110, 4111])
def acquainted(request):
    """A wild world, what is known of it, and a detector that has examined every trial."""
    world, detector, verdicts = wild(request.param), ChangeDetector(3), []
    knowledge = known(world, TRIALS, lambda *each: verdicts.append(detector.examine(*each).verdict))
    assert set(verdicts) == {ChangeVerdict.UNCHANGED}
    return world, knowledge, detector.arrays()


def examine(acquainted, *trials):
    """What the detector says after each of some further trials."""
    _, knowledge, arrays = acquainted
    detector = ChangeDetector(3)
    detector.restore(arrays)
    return detector, [detector.examine(pairs, knowledge) for pairs in trials]


@pytest.mark.parametrize(
    ("perturbation", "cameras"),
    [
        (CameraAim(camera="left", degrees=8), [True, False]),
        (CameraRoll(camera="right", degrees=25), [False, True]),
    ],
)
def test_a_turned_camera_shows_at_once_and_by_its_side(acquainted, perturbation, cameras):
    pairs = trial(perturbation.apply(acquainted[0], np.random.default_rng(0)), TRIALS)
    detector, (finding,) = examine(acquainted, pairs)
    assert finding.verdict is ChangeVerdict.CHANGED
    assert finding.cameras.tolist() == cameras
    assert finding.pairs.trials.tolist() == [TRIALS] * len(pairs)
    detector.begin_anew(TRIALS)
    assert len(detector.home.sensors) == 1
    before = trial(acquainted[0], 99).sensors[0]
    np.testing.assert_allclose(finding.home_before, before, atol=2.5 * IMAGE_UNIT)


def test_a_reversed_motor_shows_away_from_home_only(acquainted):
    reversed_ = MotorSign(motor="elbow").apply(acquainted[0], np.random.default_rng(0))
    _, (finding,) = examine(acquainted, trial(reversed_, TRIALS))
    assert finding.verdict is ChangeVerdict.CHANGED
    few = [trial(reversed_, TRIALS + i, places=2) for i in (0, 1)]
    detector, (first, second) = examine(acquainted, *few)
    assert first.verdict is ChangeVerdict.SUSPECT
    assert second.verdict is ChangeVerdict.CHANGED
    assert set(second.pairs.trials) == {TRIALS, TRIALS + 1}
    assert not len(detector.suspects)


def test_what_is_not_confirmed_was_mistaken(acquainted):
    odd = trial(acquainted[0], TRIALS, places=2)
    odd.sensors[1] += 0.3
    quiet = [trial(acquainted[0], TRIALS + i) for i in range(1, 5)]
    detector, findings = examine(acquainted, odd, *quiet)
    verdicts = [finding.verdict for finding in findings]
    assert verdicts == [ChangeVerdict.SUSPECT] + 4 * [ChangeVerdict.UNCHANGED]
    learned = np.concatenate([finding.pairs.sensors for finding in findings[1:]])
    assert any((odd.sensors[2] == each).all() for each in learned)
    assert not any((odd.sensors[1] == each).all() for each in learned)
    assert not len(detector.suspects)


def test_home_that_is_seen_elsewhere_once_is_a_mistake_and_twice_a_change(acquainted):
    odd = [trial(acquainted[0], TRIALS + i) for i in (0, 1)]
    home = odd[0].sensors[0].copy()
    for pairs in odd:
        pairs.sensors[0, :2] += 0.1
    quiet = trial(acquainted[0], TRIALS + 1)
    detector, (first, then) = examine(acquainted, odd[0], quiet)
    assert first.verdict is then.verdict is ChangeVerdict.UNCHANGED
    np.testing.assert_allclose(first.pairs.sensors[0], home, atol=2.5 * IMAGE_UNIT)
    assert not len(detector.unconfirmed_home)
    _, (first, then) = examine(acquainted, *odd)
    assert (first.verdict, then.verdict) == (ChangeVerdict.UNCHANGED, ChangeVerdict.CHANGED)
    assert then.cameras.tolist() == [True, False]


def test_noise_that_is_hardly_known_yet_raises_few_alarms():
    alarms, lifetimes, trials = 0, 300, 20
    rng = np.random.default_rng(0)
    for _ in range(lifetimes):
        home, noise, before = HomeView(), NoiseEstimate(), None
        for number in range(trials):
            seen = rng.normal(0, 3 * IMAGE_UNIT, 4)
            if before is not None:
                noise.add_homes((seen - before).reshape(2, 2))
            alarms += home.jumped(seen).any()
            home.add(seen, noise.px, number)
            alarms += home.drifting().any()
            before = seen
    assert alarms <= lifetimes * trials / 1_000
