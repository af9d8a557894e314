"""A body against chains that are known: how it is found, what has changed, where gripper and object meet."""

import numpy as np
import pytest

from agents.base.observation import Observation
from agents.base.registers import Stops
from agents.body_schema.body import NOTHING, Body, BodyChange
from agents.body_schema.body_schema import MeetingSeeker
from agents.body_schema.chain import PLACE, TURN, Views
from agents.body_schema.fitting import rolled
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
    "what", [NOTHING, "left camera", "right camera turned", "motor 3 reversed", "motor 2", "gripper"]
)
def test_what_explains_is_what_has_changed(what):
    arm = Arm("redundant.xml", "tool")
    known = arm.known(arm.pairs(trials=30, seed=1))
    since = arm.pairs(trials=1, looks=10, seed=2, numbers=changed(arm, what))
    cameras = known.contradicted(since)
    assert cameras.any() == (what != NOTHING)
    assert BodyChange(known, BOTH, since).explanation.kind == what


@pytest.mark.parametrize(
    ("trials", "looks"), [(1, 8), pytest.param(4, Body.LOOKS // 3, marks=pytest.mark.slow)]
)
def test_a_body_goes_on_with_what_has_not_changed(trials, looks):
    arm = Arm("scara.xml", "tip")
    body, numbers = Body(arm.chain.motors), changed(arm, "left camera")
    body.learn(arm.pairs(trials=20, seed=1))
    for seed in range(2, 2 + trials):
        body.learn(arm.pairs(trials=1, looks=looks, seed=seed, numbers=numbers))
    assert [event.kind for event in body.events] == ["left camera"]
    assert not body.known.contradicted(arm.pairs(trials=1, looks=8, seed=99, numbers=numbers)).any()


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


@pytest.mark.parametrize(("file", "site", "mount"), [("scara.xml", "tip", 0), ("redundant.xml", "tool", 2)])
def test_a_body_is_found_from_nothing(file, site, mount):
    arm = Arm(file, site, mount)
    body = Body(arm.chain.motors, seed=1)
    body.learn(arm.pairs(trials=40, seed=4))
    new = arm.pairs(trials=20, noise_px=0.0, seed=5)
    views = Views(body.known.chain, body.known.fitted.numbers, new.registers, new.homes)
    off_px = np.linalg.norm(views.points[:, :2].reshape(-1, 4) - new.sensors, axis=1) / IMAGE_UNIT
    assert body.known.explains
    assert np.median(off_px) < 0.5


def test_what_it_expects_is_as_far_off_as_it_says():
    arm = Arm("scara.xml", "tip")
    known = arm.known(arm.pairs(trials=12, seed=6))
    new = arm.pairs(trials=100, noise_px=0.0, seed=7)
    squares = []
    for registers, home, sensors in zip(new.registers, new.homes, new.sensors, strict=True):
        points, deviations_px = known.expected(registers, home)
        off_px = (points[:2] - sensors.reshape(2, 2)) / IMAGE_UNIT
        squares.append(np.square(off_px / deviations_px[:2, None]).mean())
    assert 0.4 < np.mean(squares) < 2.0
