"""The unified servo in linear worlds, of as many motors as one likes."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import agents
from agents.servo.trial import Findings
from agents.servo.unified import UnifiedServo
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


def lived(arm, motions, servo=None, known=None):
    """Words (n, m) and image distances in pixels (n + 1,) of one trial, and what was found out."""
    servo = servo or UnifiedServo()
    findings = Findings(known or servo.new_estimator(len(arm.registers), None), edges=np.ones((4, 2)))
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


@pytest.mark.parametrize(("motors", "idle"), [*((motors, 0) for motors in range(3, 8)), (5, 2)])
def test_it_reaches_with_any_number_of_motors_in_hardly_more_motions(motors, idle):
    arms = [arm_of(motors, np.random.default_rng(seed), idle) for seed in range(12)]
    made = [motions_to(lived(arm, 25)[1]) for arm in arms]
    assert min(made) > 0
    assert np.median(made) <= 10


def reached_of_12(hides, motions):
    """Of 12 arms of five motors, two of which do nothing to the gripper but turn it, how many reach."""

    class Hiding(LinearArm):
        def observed(self, words=0.0):
            seen = super().observed(words)
            turned = np.linalg.norm(np.linalg.svd(self.jacobian[:4])[2][3:] @ self.registers)
            return replace(seen, visible=np.array([not hides(seen.distance_px, turned), True, True, True]))

    reached = 0
    for seed in range(12):
        arm = arm_of(5, np.random.default_rng(seed))
        arm.__class__ = Hiding
        running = UnifiedServo()(arm.observed(), Findings(UnifiedServo().new_estimator(5, None)))
        seen = arm.observed(next(running))
        for _ in range(motions):
            if seen.visible.all() and seen.distance_px < 4:
                reached += 1
                break
            seen = arm.observed(running.send(seen))
    return reached


def test_where_one_way_to_the_object_hides_the_gripper_it_takes_another():
    assert reached_of_12(lambda distance_px, turned: distance_px < 30 and turned < 0.3, 40) == 12


def test_where_most_motions_hide_the_gripper_it_comes_back_with_shorter_ones_and_reaches():
    assert reached_of_12(lambda _, turned: turned > 0.03, 60) >= 8


def test_it_takes_in_the_last_observation_and_then_asks_for_no_words():
    arm, servo = arm_of(3, np.random.default_rng(0)), UnifiedServo()
    findings = Findings(servo.new_estimator(3, None))
    running = servo(arm.observed(), findings)
    last = replace(arm.observed(next(running)), last=True)
    with pytest.raises(StopIteration):
        running.send(last)
    np.testing.assert_array_equal(findings.estimator.gripper.looks.places[-1], last.registers)


def test_a_stop_is_met_two_or_three_times_and_tried_once_more():
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


@pytest.mark.parametrize("name", ["unified_servo", "memory", "body_schema"])
def test_words_stay_numbers_where_no_motion_ever_shows(make_env, name):
    class Frozen(gym.ObservationWrapper):
        def observation(self, observation):
            still = np.array([0.1, 0.2, 0.1, 0.2], np.float32)
            return {**observation, "achieved_goal": still, "desired_goal": still + 0.3}

    agents.make(name, Frozen(make_env())).learn(130)
