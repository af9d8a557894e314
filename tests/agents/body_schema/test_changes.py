"""What has changed is told by what is seen since."""

import numpy as np
import pytest

from agents.body_schema.body import Body
from agents.body_schema.explanations import NOTHING, explained
from agents.body_schema.starts import rolled
from tests.agents.body_schema.chains import Arm

BOTH = np.array([True, True])


def changed(arm, what):
    numbers = arm.numbers.copy()
    match what:
        case "left camera":
            numbers = rolled(arm.chain, numbers, 0)[3]
            numbers[arm.chain.camera(0)][0] += 0.2
        case "right camera":
            numbers[arm.chain.camera(1)][2:5] += 0.1, -0.05, 0.02
        case "motor 3":
            numbers[arm.chain.joint(2)][:6] *= -1
        case "gripper":
            numbers[arm.chain.gripper] += 0.08, 0.03, -0.05
    return numbers


@pytest.mark.parametrize("what", [NOTHING, "left camera", "right camera", "motor 3", "gripper"])
def test_what_explains_is_what_has_changed(what):
    arm = Arm("redundant.xml", "tool")
    known = arm.known(arm.pairs(trials=30, seed=1))
    since = arm.pairs(trials=1, looks=10, seed=2, numbers=changed(arm, what))
    cameras = known.contradicted(since)
    assert cameras.any() == (what != NOTHING)
    assert explained(known, since, BOTH).kind == what


def test_a_body_goes_on_with_what_has_not_changed():
    """After one trial with another camera it knows the arm as before, and explains the next."""
    arm = Arm("scara.xml", "tip")
    body = Body(arm.chain.motors)
    body.learn(arm.pairs(trials=20, seed=1))
    numbers = changed(arm, "left camera")
    body.learn(arm.pairs(trials=1, looks=8, seed=2, numbers=numbers))
    assert [event.kind for event in body.events] == ["left camera"]
    assert not body.known.contradicted(arm.pairs(trials=1, looks=8, seed=3, numbers=numbers)).any()


def test_a_trial_with_mistaken_points_is_no_change():
    arm = Arm("scara.xml", "tip")
    known = arm.known(arm.pairs(trials=20, seed=1))
    pairs = arm.pairs(trials=1, looks=10, seed=2)
    pairs.sensors[[2, 6], :2] = 0.7
    assert not known.contradicted(pairs).any()
