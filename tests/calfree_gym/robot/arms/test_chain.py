"""An arm's forward kinematics is MuJoCo's own, for every posture, every length, and every kind of joint."""

import mujoco
import numpy as np
import pytest

from calfree_gym import Arm
from tests.arms.every import EVERY, arm_named
from tests.arms.fetched import fetched_arms
from tests.arms.own import ARMS

POSTURES = 20

ALL_KINDS = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="cart" pos="5 5 5">
      <freejoint name="cart"/>
      <geom size="0.1"/>
      <body name="neck" pos="0.1 0.2 0.3" quat="0.5 0.5 -0.5 0.5">
        <joint name="neck" type="ball" pos="0.05 -0.02 0.01"/>
        <geom size="0.05"/>
        <body name="rail" pos="0 0.1 0" euler="0.3 -0.4 0.5">
          <joint name="lift" type="slide" axis="1 2 3" range="-0.2 0.4" ref="0.05"/>
          <joint name="tilt" axis="0 1 1" pos="0.01 0.02 0.03" range="-1 1" ref="0.4"/>
          <geom size="0.05"/>
          <body name="arm" pos="0.3 0.02 0">
            <joint name="stuck" axis="0 0 1" pos="0 0.03 0" ref="-0.2" range="-1 1"/>
            <joint name="turn" axis="1 -1 0.5" pos="-0.02 0 0.01" range="-2 2"/>
            <geom size="0.04"/>
            <body name="hand" pos="0.2 0 0.05" quat="1 1 0 0">
              <joint name="wrist" axis="0 1 0" range="-1.5 1.5" ref="1"/>
              <geom size="0.03"/>
              <body name="swivel" pos="0.01 0 0.02">
                <joint name="swivel" type="ball"/>
                <geom size="0.02" pos="0.05 0 0.03"/>
                <site name="tip" pos="0.02 0.03 0.1"/>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <keyframe>
    <key name="about" qpos="1 -2 0.5 0.5 -0.5 0.5 0.5  0.8 0.6 0 0  0.1 0.2 0.7 -0.3 0.4  0.6 0 0 -0.8"/>
  </keyframe>
</mujoco>
"""


def all_kinds(**arguments):
    return Arm(
        model=ALL_KINDS, gripper="tip", motors=["lift", "tilt", "turn", "wrist"], home="about", **arguments
    )


def drawn(robot, rng, motors):
    low, high = robot.stops.T
    return low + rng.random(motors) * (high - low)


def mujocos(model, robot, joints, stretch):
    """MuJoCo's state with the motors' joints at `joints` (m,) and links stretched by `stretch` (l,)."""
    for name, factor in zip(robot.links, stretch, strict=True):
        model.body(name).pos *= factor
    data = mujoco.MjData(model)
    data.qpos[:] = robot.home_qpos
    for name, at in zip(robot.motors, joints, strict=True):
        data.joint(name).qpos = at
    mujoco.mj_kinematics(model, data)
    return data


def check(robot, model_of, tolerance):
    rng = np.random.default_rng(0)
    kind, name = robot.parts.gripper
    joints = drawn(robot, rng, (POSTURES, len(robot.motors)))
    stretch = rng.uniform(0.5, 1.5, (POSTURES, len(robot.links)))
    stretch[0] = 1
    lengths = robot.lengths * stretch
    grippers = robot.gripper_position(joints, lengths)
    frames = {body: robot.frames(body, joints, lengths) for body in robot.bodies}
    for i in range(POSTURES):
        data = mujocos(model_of(), robot, joints[i], stretch[i])
        point = data.site(name).xpos if kind == "site" else data.body(name).xpos
        assert grippers[i] == pytest.approx(point, abs=tolerance)
        for body, (positions, axes) in frames.items():
            if body in free_bodies(robot):
                continue
            assert positions[i] == pytest.approx(data.body(body).xpos, abs=tolerance)
            assert axes[i] == pytest.approx(data.body(body).xmat.reshape(3, 3), abs=tolerance)


def free_bodies(robot):
    model = robot.model
    return {model.body(b).name for b in range(model.nbody) if model.body_mocapid[b] >= 0}


@pytest.mark.parametrize("name", EVERY)
def test_frames_of_all_bodies_are_mujocos(name):
    robot = arm_named(name).robot
    check(robot, lambda: robot.spec.compile(), 1e-12)


@pytest.mark.parametrize("name", EVERY)
def test_the_arm_is_that_of_its_file(name):
    """MuJoCo writes numbers with six digits: the arm that is simulated is that much another one."""
    robot, path = arm_named(name).robot, (ARMS | fetched_arms())[name]["model"]
    check(robot, lambda: mujoco.MjModel.from_xml_path(str(path)), 3e-5)


def test_every_kind_of_joint():
    robot = all_kinds().robot
    check(robot, lambda: robot.spec.compile(), 1e-12)
    assert robot.links == ("neck", "rail", "arm", "hand", "swivel")
    assert robot.home == pytest.approx([0.1, 0.2, -0.3, 0.4])
