"""The servo by an estimated Jacobian in a linear world: when it makes test motions, and when none."""

import numpy as np

from agents.servo.jacobian import Kalman
from agents.servo.jacobian_servo import JacobianServo
from agents.servo.slopes import Slopes
from agents.servo.trial import Findings
from calfree_gym.image import IMAGE_UNIT
from tests.agents.linear_arm import LinearArm
from tests.agents.trials import carry_out


def arm_with_object(off_px):
    """An arm that could reach the object, were it not for `off_px` that no words can make vanish."""
    rng = np.random.default_rng(0)
    arm = LinearArm([400.0] * 3)
    arm.jacobian[:4] = rng.normal(size=(4, 3))
    arm.jacobian[4:] = 0
    contradiction = np.linalg.svd(arm.jacobian[:4])[0][:, -1] * off_px * IMAGE_UNIT
    arm.home = np.zeros((4, 2))
    arm.home[2:] = (arm.jacobian[:4] @ [0.1, -0.1, 0.05] + contradiction).reshape(2, 2)
    return arm


def motors_moved(arm, servo, motions):
    """How many motors each motion moves, where the true Jacobian is known from the last trial."""
    running = servo(arm.observed(), Findings(Kalman(3, Slopes.of(arm.jacobian))))
    sent, _ = carry_out(running, arm.observed, motions)
    return np.count_nonzero(sent, axis=1).tolist()


def test_it_makes_no_test_motion_while_steps_bring_the_gripper_nearer():
    arm = arm_with_object(0.0)
    assert 1 not in motors_moved(arm, JacobianServo(), 40)
    points = arm.observed().points
    np.testing.assert_allclose(points[:2], points[2:], atol=IMAGE_UNIT)


def test_it_measures_j_anew_where_as_many_steps_as_its_patience_bring_it_no_nearer():
    counts = motors_moved(arm_with_object(80.0), JacobianServo(patience=6), 40)
    first = counts.index(1)
    steps = np.count_nonzero(np.array(counts[:first]) == 3)
    assert 6 <= steps <= 12
    assert motors_moved(arm_with_object(80.0), JacobianServo(patience=3), 40).index(1) < first
