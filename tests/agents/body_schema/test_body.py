"""A body against chains that are known: how it is found, what has changed, where gripper and object meet."""

from dataclasses import replace

import numpy as np
import pytest

from agents.base.observation import Observation
from agents.base.registers import Stops
from agents.body_schema.body import NOTHING, Body, BodyChange, likely_mounts
from agents.body_schema.body_schema import MeetingSeeker
from agents.body_schema.chain import PLACE, TURN, Views
from agents.body_schema.fitting import Gaussian, reversing, rolled
from calfree_gym.image import IMAGE_UNIT
from tests.agents.body_schema.chains import Arm

BOTH = np.array([True, True])


def changed(arm, what):
    numbers = arm.numbers.copy()
    match what:
        case "left camera":
            numbers = rolled(arm.chain, numbers, 0)[3]
            numbers[arm.chain.camera(0)][0] += 0.2
            numbers[arm.chain.camera(0)][PLACE] += 0.2, -0.1, 0.1
        case "right camera turned":
            numbers[arm.chain.camera(1)][TURN] += 0.1, -0.05, 0.02
        case "motor 3 reversed":
            numbers[arm.chain.joint(2)][:6] *= -1
        case "motor 2":
            numbers[arm.chain.joint(1)][:6] *= 0.7
        case "gripper":
            numbers[arm.chain.gripper] += 0.08, 0.03, -0.05
    return numbers


@pytest.mark.parametrize(
    "what",
    [
        *(NOTHING, "right camera turned", "motor 3 reversed"),
        *(pytest.param(each, marks=pytest.mark.slow) for each in ("left camera", "motor 2", "gripper")),
    ],
)
def test_what_explains_is_what_has_changed(what):
    arm = Arm("redundant.xml", "tool")
    known = arm.known(arm.pairs(trials=30, seed=1))
    since = arm.pairs(trials=1, looks=10, seed=2, numbers=changed(arm, what))
    cameras = known.contradicted(since)
    assert cameras.any() == (what != NOTHING)
    assert BodyChange(known, BOTH, since).explanation.kind == what


def test_a_reversed_motor_does_for_a_register_what_it_did_for_its_negative():
    arm = Arm("redundant.xml", "tool")
    arm.numbers[arm.chain.joint(3)][6:] = 0.1, -0.2, 0.3
    registers = np.random.default_rng(0).uniform(-0.4, 0.4, (10, arm.chain.motors))
    mirrored = registers * np.where(np.arange(arm.chain.motors) == 3, -1, 1)
    nothing = np.zeros((1, 4))
    now = Views(arm.chain, reversing(arm.chain, 3) * arm.numbers, registers, nothing)
    np.testing.assert_allclose(now.points, Views(arm.chain, arm.numbers, mirrored, nothing).points)


@pytest.mark.parametrize(
    ("trials", "looks"), [(1, 8), pytest.param(4, Body.LOOKS // 3, marks=pytest.mark.slow)]
)
def test_a_body_goes_on_with_what_has_not_changed(trials, looks):
    """It knows the arm as before, and explains the next trial, also after more looks than a fit takes."""
    arm = Arm("scara.xml", "tip")
    body, numbers = Body(arm.chain.motors), changed(arm, "left camera")
    body.learn(arm.pairs(trials=20, seed=1))
    for seed in range(2, 2 + trials):
        body.learn(arm.pairs(trials=1, looks=looks, seed=seed, numbers=numbers))
    assert [event.kind for event in body.events] == ["left camera"]
    assert not body.known.contradicted(arm.pairs(trials=1, looks=8, seed=99, numbers=numbers)).any()


def test_a_trial_with_mistaken_points_is_no_change():
    arm = Arm("scara.xml", "tip")
    known = arm.known(arm.pairs(trials=20, seed=1))
    pairs = arm.pairs(trials=1, looks=10, seed=2)
    pairs.sensors[[2, 6], :2] = 0.7
    assert not known.contradicted(pairs).any()


def seeker(arm, target, stops=None, offset=0.0):
    nothing = np.zeros(arm.chain.motors)
    place = arm.gripper(target)
    home = np.concatenate([arm.pinhole(place, camera) for camera in (0, 1)])
    gripper = np.concatenate([arm.pinhole(arm.gripper(nothing), camera) for camera in (0, 1)])
    points = np.concatenate([gripper, home]).reshape(4, 2)
    now = Observation(points + offset, np.ones(4, bool), nothing)
    return MeetingSeeker(arm.exact, home, now, 0.5, stops or Stops(nothing)), place


@pytest.mark.parametrize("seed", range(5))
def test_mujoco_has_the_gripper_at_the_object_there(seed):
    arm = Arm("redundant.xml", "tool")
    target = np.random.default_rng(seed).uniform(-0.5, 0.5, arm.chain.motors)
    found, place = seeker(arm, target)
    meeting = found.seek()
    assert meeting.deviation_px < 4
    assert np.linalg.norm(arm.gripper(meeting.registers) - place) < 0.02


def test_motors_stay_between_their_stops():
    arm = Arm("redundant.xml", "tool")
    stops = Stops(np.zeros(arm.chain.motors))
    stops.found[:, 1] = -0.05, 0.05
    found, place = seeker(arm, np.r_[0.1, 0.1, -0.1, 0.2, 0.1, 0.1, 0.0], stops)
    registers = found.seek().registers
    assert abs(registers[1]) <= 0.05
    assert np.linalg.norm(arm.gripper(registers) - place) < 0.02


def test_the_jacobian_is_that_of_the_points():
    arm = Arm("scara.xml", "tip")
    registers = np.r_[0.2, -0.3, 0.1, 0.0][: arm.chain.motors]
    home = np.concatenate([arm.pinhole(arm.gripper(registers), camera) for camera in (0, 1)])
    jacobian = arm.exact.jacobian(registers, home)
    for motor, step in enumerate(1e-5 * np.eye(arm.chain.motors)):
        both = [
            [arm.pinhole(arm.gripper(registers + sign * step), camera) for camera in (0, 1)]
            for sign in (1, -1)
        ]
        slope = (np.array(both[0]) - both[1]).ravel() / 2e-5
        np.testing.assert_allclose(jacobian[:4, motor], slope, atol=1e-4)


@pytest.mark.parametrize(
    ("file", "site", "mount"),
    [("scara.xml", "tip", 0), pytest.param("redundant.xml", "tool", 2, marks=pytest.mark.slow)],
)
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


def test_an_object_that_was_seen_at_home_alone_tells_of_no_mount():
    """Somebody moved it before the first motion, and it was hidden after that."""
    pairs = Arm("redundant.xml", "tool", 3).pairs(trials=2, seed=8, reach=0.2)
    away = pairs.registers.any(1)
    objects = np.where(away[:, None], np.nan, pairs.homes + 0.5)
    assert likely_mounts(replace(pairs, objects=objects)) == [(0, 0)]
