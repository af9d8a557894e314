"""What has changed is told by what is seen since."""

import numpy as np
import pytest

from agents.body_schema.body import NOTHING, Body, BodyChange
from agents.body_schema.chain import PLACE, TURN, Views
from agents.body_schema.fitting import reversing, rolled
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


def test_a_reversed_motor_does_for_a_register_what_it_did_for_its_negative():
    arm = Arm("redundant.xml", "tool")
    arm.numbers[arm.chain.joint(3)][6:] = 0.1, -0.2, 0.3
    registers = np.random.default_rng(0).uniform(-0.4, 0.4, (10, arm.chain.motors))
    mirrored = registers * np.where(np.arange(arm.chain.motors) == 3, -1, 1)
    nothing = np.zeros((1, 4))
    now = Views(arm.chain, reversing(arm.chain, 3) * arm.numbers, registers, nothing)
    np.testing.assert_allclose(now.points, Views(arm.chain, arm.numbers, mirrored, nothing).points)


@pytest.mark.parametrize(("trials", "looks"), [(1, 8), (4, Body.LOOKS // 3)])
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
