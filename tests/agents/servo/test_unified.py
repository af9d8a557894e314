"""The unified servo in linear worlds, of as many motors as one likes."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import agents
from agents.servo.image_model.gaussian_process import GaussianProcess
from agents.servo.image_model.smooth_points import SmoothPoints
from agents.servo.trial import Findings
from agents.servo.unified import Reach, UnifiedServo
from calfree_gym.image import IMAGE_UNIT
from tests.agents.linear_arm import LinearArm


def arm_of(motors, rng, idle=0, goal=0.3):
    """An arm whose gripper's three dimensions some of its motors move, and an object that it can reach."""
    arm = LinearArm([400.0] * 3)
    arm.jacobian = np.zeros((8, motors))
    in_images = rng.normal(size=(4, 3))
    arm.jacobian[:4, idle:] = in_images @ rng.normal(size=(3, motors - idle)) * 0.5
    arm.registers = np.zeros(motors)
    arm.home = np.zeros((4, 2))
    arm.home[2:] = (arm.jacobian[:4] @ rng.uniform(-goal, goal, motors)).reshape(2, 2)
    return arm


def lived(arm, motions, start=None, servo=None, known=None, edges=1.0):
    """Words (n, m) and image distances in pixels (n + 1,) of one trial, and what was found out."""
    servo = servo or UnifiedServo()
    estimator = known or servo.new_estimator(len(arm.registers), start)
    findings = Findings(estimator, edges=np.full((4, 2), edges))
    running = servo(arm.observed(), findings)
    words, made, distances = next(running), [], [arm.observed().distance_px]
    for _ in range(motions):
        made.append(words)
        observation = arm.observed(words)
        distances.append(observation.distance_px)
        words = running.send(observation)
    return np.array(made), np.array(distances), findings


def motions_to(distances_px, px=2.0):
    return int(np.argmax(distances_px < px))


@pytest.mark.parametrize("motors", range(3, 8))
def test_it_reaches_with_any_number_of_motors_in_hardly_more_motions(motors):
    made = [motions_to(lived(arm_of(motors, np.random.default_rng(seed)), 25)[1]) for seed in range(12)]
    assert min(made) > 0
    assert np.median(made) <= 10


def test_a_motor_that_moves_nothing_costs_nothing():
    plain = [motions_to(lived(arm_of(3, np.random.default_rng(seed)), 25)[1]) for seed in range(12)]
    idle = [motions_to(lived(arm_of(5, np.random.default_rng(seed), idle=2), 25)[1]) for seed in range(12)]
    assert np.median(idle) <= np.median(plain) + 2


def looks(seed, hides, motions):
    """Yields what is seen in a trial of an arm of five motors, two of which do nothing but turn the gripper.

    Args:
        seed: Of the arm.
        hides: Tells by the image distance in pixels and by how far those two are from home whether the
            gripper is hidden in the left camera.
        motions: At most.
    """

    class Hiding(LinearArm):
        def observed(self, words=0.0):
            seen = super().observed(words)
            turned = np.linalg.norm(np.linalg.svd(self.jacobian[:4])[2][3:] @ self.registers)
            return replace(seen, visible=np.array([not hides(seen.distance_px, turned), True, True, True]))

    arm = arm_of(5, np.random.default_rng(seed))
    arm.__class__ = Hiding
    servo = UnifiedServo()
    running = servo(arm.observed(), Findings(servo.new_estimator(5, None)))
    words = next(running)
    for _ in range(motions):
        seen = arm.observed(words)
        yield seen
        words = running.send(seen)


def reach(arms, hides, motions):
    """How many of so many arms reach."""
    return sum(
        any(seen.visible.all() and seen.distance_px < 4 for seen in looks(seed, hides, motions))
        for seed in range(arms)
    )


def test_where_one_way_to_the_object_hides_the_gripper_it_takes_another():
    assert reach(12, lambda distance_px, turned: distance_px < 30 and turned < 0.3, 40) == 12


@pytest.mark.parametrize(
    ("arms", "most", "least"), [(24, 0.05, 20), pytest.param(120, 0.03, 80, marks=pytest.mark.slow)]
)
def test_where_most_motions_hide_the_gripper_it_comes_back_and_reaches(arms, most, least):
    """As a printed tag, which the gripper soon turns away from a camera."""
    assert reach(arms, lambda _, turned: turned > most, 60) >= least


def test_where_motions_hide_the_gripper_they_become_shorter():
    """Where all that turn it do, it is soon turned far less than by its first motion."""
    shares = []
    for seed in range(24):
        turns = []

        def hides(_, turned, turns=turns):
            turns.append(turned)
            return turned > 1e-9

        for _ in looks(seed, hides, 40):
            pass
        shares.append(min(turns[5:]) / turns[1])
    assert np.median(shares) < 1 / 3


def test_with_slopes_from_before_one_or_two_motions_do():
    made = []
    for seed in range(12):
        arm = arm_of(6, np.random.default_rng(seed), goal=0.1)
        _, _, findings = lived(arm, 20)
        arm.registers = np.zeros(6)
        arm.home[2:] = (arm.jacobian[:4] @ np.random.default_rng(9).uniform(-0.1, 0.1, 6)).reshape(2, 2)
        made.append(motions_to(lived(arm, 10, findings.estimator.slopes_for_next())[1], 4.0))
    assert min(made) > 0
    assert np.median(made) <= 2


def test_what_is_remembered_of_another_arm_is_soon_left_out():
    """The trial then goes on by what was seen in it: no test motions are made."""
    alone, misled = [], []
    for seed in range(12):
        arm, other = (arm_of(5, np.random.default_rng(each)) for each in (seed, seed + 100))
        _, _, findings = lived(other, 25)
        gripper, object_ = findings.estimator.gripper, GaussianProcess.unknown(9, 5)
        known = SmoothPoints.remembered(gripper, (object_, arm.home[2:]), 0.7)
        alone.append(motions_to(lived(arm, 40)[1]))
        arm.registers = np.zeros(5)
        misled.append(motions_to(lived(arm, 40, known=known)[1]))
    assert min(misled) > 0
    assert np.median(misled) <= np.median(alone) + 2 * UnifiedServo.PATIENCE


def test_among_words_that_do_it_takes_small_ones():
    """Beside its probes, which are random: no longer than three times the shortest way, in the median.

    Of 120 draws, two have not arrived after so many motions.
    """
    distances, lengths = [], []
    for seed in range(40):
        arm = arm_of(7, np.random.default_rng(seed))
        _, _, findings = lived(arm, 25)
        distances.append(findings.trusted[-1].distance_px)
        shortest = np.linalg.norm(np.linalg.pinv(arm.jacobian[:4]) @ (arm.home[2:].reshape(4)))
        lengths.append(np.linalg.norm(arm.registers) / shortest)
    assert np.count_nonzero(np.array(distances) < 2) >= 36
    assert np.median(lengths) < 3


@pytest.mark.parametrize("seed", range(4))
def test_words_are_the_same_by_any_basis_of_what_is_unknown(monkeypatch, seed):
    """Another kernel of linear algebra may give any basis of vectors whose eigenvalues are equal."""

    def another(matrix):
        values, vectors = eigh(matrix)
        alike = np.isclose(values, values[-1], rtol=1e-6)
        turn = np.linalg.qr(np.random.default_rng(len(vectors)).normal(size=[np.count_nonzero(alike)] * 2))[0]
        vectors[:, alike] @= turn
        return values, vectors

    eigh, made = np.linalg.eigh, []
    for each in (eigh, another):
        monkeypatch.setattr(np.linalg, "eigh", each)
        made.append(lived(arm_of(5, np.random.default_rng(seed)), 8)[0])
    np.testing.assert_allclose(*made, atol=1e-5)


def test_it_takes_in_the_last_observation_and_then_asks_for_no_words():
    arm, servo = arm_of(3, np.random.default_rng(0)), UnifiedServo()
    findings = Findings(servo.new_estimator(3, None))
    running = servo(arm.observed(), findings)
    last = replace(arm.observed(next(running)), last=True)
    with pytest.raises(StopIteration):
        running.send(last)
    np.testing.assert_array_equal(findings.estimator.gripper.looks.places[-1], last.registers)


def test_words_stay_within_bounds_and_stops_are_learned():
    arm = arm_of(3, np.random.default_rng(1))
    arm.lowest, arm.highest = np.array([-0.05, -1, -1]), np.array([0.05, 1, 1])
    words, _, _ = lived(arm, 20)
    assert np.abs(words).max() <= 1
    beyond = np.abs(words[12:, 0]).max()
    assert beyond <= 0.1 + 1e-6


def test_a_stop_is_met_two_or_three_times_and_tried_once_more():
    """The object lies where only a motor would bring the gripper that stops long before."""
    for seed in range(5):
        arm = arm_of(3, np.random.default_rng(seed))
        arm.home[2:] = (arm.jacobian[:4] @ [0.5, 0.1, 0.1]).reshape(2, 2)
        stop = 0.05
        arm.highest = np.array([stop, 1.0, 1.0])
        words, _, _ = lived(arm, 20)
        register, beyond = 0.0, []
        for word in words[:, 0]:
            beyond.append(register + word > stop + 1e-6)
            register = min(register + word, stop)
        assert 2 <= sum(beyond[:8]) <= 3
        assert sum(beyond) <= 8


def test_probes_are_about_as_large_in_the_images_as_they_are_wanted():
    moved = []
    for seed in range(30):
        arm = arm_of(4, np.random.default_rng(seed))
        arm.jacobian *= 2.0 ** np.random.default_rng(seed).uniform(-1, 2)
        arm.home[2:] = 0.9
        start = arm.observed().points
        words, _, _ = lived(arm, 3)
        arm.registers = np.zeros(4)
        moved.append(np.linalg.norm(arm.observed(words[1]).points - start) / 2 / IMAGE_UNIT)
    assert 8 < np.median(moved) < 80


def test_words_are_short_that_would_lead_points_out_of_the_images():
    """Large probes lead out of the images less far where a border is set.

    After the first shorter word a trial goes its own way: by the last bits of a processor's numbers, one of
    twenty has been seen to come farther out.
    """
    farthest = []
    for border in (0.5, 9.0):
        servo = UnifiedServo(border=border, probe_px=150.0)
        for seed in range(20):
            arm = arm_of(3, np.random.default_rng(seed))
            arm.home[2:] = 0.6
            _, _, findings = lived(arm, 12, servo=servo)
            farthest.append(max(np.abs(each.points[:2]).max() for each in findings.trusted))
    within, anywhere = np.reshape(farthest, (2, 20))
    assert np.count_nonzero(within <= anywhere) >= 18
    assert np.count_nonzero(within < anywhere - 0.1) >= 5


@pytest.mark.parametrize("seed", range(3))
def test_a_border_is_a_share_of_where_images_end(seed):
    def words(border, edges):
        arm = arm_of(3, np.random.default_rng(seed))
        arm.home[2:] = 0.6
        return lived(arm, 8, servo=UnifiedServo(border=border, probe_px=150.0), edges=edges)[0]

    np.testing.assert_array_equal(words(1.0, 0.5), words(0.5, 1.0))
    assert (words(1.0, 0.5) != words(1.0, 1.0)).any()


def test_a_word_is_a_step_alone_where_that_is_expected_to_do():
    arm = arm_of(3, np.random.default_rng(3))
    servo = UnifiedServo()
    findings = Findings(servo.new_estimator(3, None))
    findings.estimator.look(arm.observed(), 0.7)
    for words in np.vstack([np.eye(3), -np.eye(3)]) * 0.2:
        arm.registers = np.zeros(3)
        findings.estimator.look(arm.observed(words), 0.7)
    arm.registers = np.zeros(3)
    reach = Reach(servo, arm.observed(), findings)
    np.testing.assert_allclose(
        reach.words(), np.linalg.pinv(arm.jacobian[:4]) @ -arm.observed().distance, atol=0.03
    )


@pytest.mark.parametrize("name", ["unified_servo", "memory", "body_schema"])
def test_words_stay_numbers_where_no_motion_ever_shows(make_env, name):
    """Frozen images, or an arm without power."""

    class Frozen(gym.ObservationWrapper):
        def observation(self, observation):
            still = np.array([0.1, 0.2, 0.1, 0.2], np.float32)
            return {**observation, "achieved_goal": still, "desired_goal": still + 0.3}

    agents.make(name, Frozen(make_env())).learn(130)
