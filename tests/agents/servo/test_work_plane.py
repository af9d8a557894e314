"""The paper's first implementation, against section 3.2 and figure 6."""

from itertools import islice

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import agents
from agents.base.observation import Observation
from agents.servo.redundancy import solve
from agents.servo.work_plane import EQUATIONS, WAIST, disparity, disparity_weight, turn
from calfree_gym.image import IMAGE_UNIT
from tests.agents import analytic
from tests.agents.trials import motions_of


def numbers(*shape):
    return arrays(float, shape, elements=st.floats(-1, 1))


def well_conditioned(entries):
    """A Jacobian (4, 3) whose 2×2 blocks, one a camera, are far from singular."""
    return entries + np.array([[0.5, 3, 0], [0, 0, 3], [-0.5, 3, 1], [1, -1, 3]])


def disparity_px(jacobian, distance):
    apart = disparity(jacobian, distance, 0.0)
    return np.sqrt(apart @ disparity_weight(jacobian) @ apart) / IMAGE_UNIT


def work_plane(gripper):
    """Unit vectors from the waist's axis to the gripper, upwards, and across the work plane."""
    outwards = np.array([gripper[0], gripper[1], 0.0]) / np.hypot(gripper[0], gripper[1])
    up = np.array([0.0, 0.0, 1.0])
    return outwards, up, np.cross(up, outwards)


def test_both_cameras_give_the_same_words_in_the_work_plane_and_only_there(noise_free, mount):
    for seed in range(10):
        env = noise_free(mount, seed)
        gripper = env.reset()[1]["truth"]["gripper"]
        outwards, up, across = work_plane(gripper)
        for offset, in_plane in ((outwards, True), (up, True), ((outwards - up) / 2, True), (across, False)):
            now = Observation.of(env.reset(options={"object": gripper + 0.005 * offset})[0])
            jacobian = analytic.distance_jacobian(env)
            left, right = (
                solve(jacobian[EQUATIONS[camera], 1:], now.distance[EQUATIONS[camera]], 0.0)
                for camera in ("left", "right")
            )
            difference = np.abs(left - right).max() / max(np.abs(left).max(), np.abs(right).max())
            assert difference < 0.01 if in_plane else difference > 0.5
            assert (disparity_px(jacobian, now.distance) < 0.1) == in_plane


@settings(max_examples=100)
@given(numbers(4, 3), numbers(4))
def test_turn_and_motion_in_plane_are_the_least_squares_solution_of_all_four_equations(entries, distance):
    jacobian = well_conditioned(entries)
    word = turn(jacobian, distance, 0.0)
    turned = distance + jacobian[:, WAIST] * word
    motion = solve(jacobian[:, 1:], turned, 0.0)
    best = np.linalg.lstsq(jacobian, -distance, rcond=None)[0]
    np.testing.assert_allclose([word, *motion], best, atol=1e-6)


@settings(max_examples=100)
@given(numbers(4, 3), numbers(4))
def test_a_disparity_is_as_long_as_the_distance_that_motors_2_and_3_must_leave(entries, distance):
    jacobian = well_conditioned(entries)
    motion = np.linalg.lstsq(jacobian[:, 1:], -distance, rcond=None)[0]
    left_over = np.linalg.norm(jacobian[:, 1:] @ motion + distance) / IMAGE_UNIT
    assert disparity_px(jacobian, distance) == pytest.approx(left_over, abs=1e-5)


def test_turn_by_turn_the_disparity_shrinks(noise_free, mount):
    lengths = []
    for seed in range(1000, 1030):
        env = noise_free(mount, seed, terminate_on_success=False)
        now, lengths_here = Observation.of(env.reset()[0]), []
        for _ in range(3):
            jacobian = analytic.distance_jacobian(env)
            lengths_here.append(disparity_px(jacobian, now.distance))
            word = np.clip(turn(jacobian, now.distance, 0.0), -0.9, 0.9)
            now = Observation.of(env.step(np.array([word, 0.0, 0.0]))[0])
        lengths.append(lengths_here)
    first, second, third = np.array(lengths).T
    assert np.median(first) > 40
    assert np.mean((second < first) & (third < second)) >= 0.95
    assert np.median(third) < 3


@pytest.mark.parametrize("camera", EQUATIONS)
def test_either_camera_alone_brings_the_gripper_to_an_object_in_the_work_plane(noise_free, mount, camera):
    for seed in range(5):
        env = noise_free(mount, seed, tolerance_px=1.0)
        gripper = env.reset()[1]["truth"]["gripper"]
        outwards, up, _ = work_plane(gripper)
        agent = agents.make("work_plane_servo", env, camera=camera, in_plane_px=1e3)
        for offset in (-0.05 * outwards - 0.03 * up, 0.03 * outwards - 0.08 * up):
            trial = motions_of(agent, env, options={"object": gripper + offset})
            words, _, _, infos = zip(*islice(trial, 30), strict=True)
            assert not np.array(words)[:, WAIST].any()
            assert infos[-1]["truth"]["error_px"] <= 1
            assert infos[-1]["truth"]["distance_mm"] <= 5
