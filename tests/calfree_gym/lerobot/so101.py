"""An SO-101 of capsules in MuJoCo: its joints as TheRobotStudio has them, driven by hobby motors.

Places, axes, ranges and masses are those of the arm's MJCF (so101_new_calib.xml, Apache 2.0), kp, damping and
play too; shapes are ours. A motor's encoder does not see the play behind it.
"""

import mujoco
import numpy as np

from tests.calfree_gym.lerobot.tags import put_tags

MOTORS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
TICK = 2 * np.pi / 4096
STEP = 0.004
HOME = np.radians([0.0, -35.0, 35.0, 55.0, 0.0, 20.0])
"""Where the arm stands at first: bent, its gripper above the table."""
BALLS = {"gripper_1": (0.95, 0.05, 0.65), "gripper_2": (0.05, 0.05, 0.95), "object": (0.05, 0.95, 0.05)}
BALL = 0.01
"""Radius of a ball in m."""
KP, TORQUE, SPEED, PLAY = 17.8, 2.9, 5.0, np.radians(0.5)
"""N m a rad; N m, at 12 V; rad/s without load; rad either way."""

MJCF = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="{step}" integrator="implicitfast"/>
  <visual>
    <headlight ambient="0.35 0.35 0.35" diffuse="0.3 0.3 0.3" specular="0 0 0"/>
    <global offwidth="640" offheight="480"/>
    <quality offsamples="0" shadowsize="0" numslices="20" numstacks="12" numquads="1"/>
  </visual>
  <default>
    <joint type="hinge" axis="0 0 1" damping="0.6" frictionloss="0.052" armature="0.028" limited="true"/>
    <geom type="capsule" size="0.016" rgba="0.85 0.8 0.68 1" contype="1" conaffinity="0"/>
    <default class="play">
      <joint range="-{play} {play}" damping="0.01" frictionloss="0" armature="0.01"/>
    </default>
    <default class="ball">
      <geom type="sphere" size="{ball}" contype="0" mass="0.004"/>
    </default>
    <position kp="{kp}" kv="0.3" forcerange="-{torque} {torque}"/>
  </default>
  <asset>
    <texture name="wood" type="2d" builtin="checker" rgb1="0.62 0.55 0.46" rgb2="0.5 0.45 0.4" width="128"
      height="128" mark="random" random="0.2" markrgb="0.4 0.38 0.36"/>
    <material name="wood" texture="wood" texrepeat="6 6"/>
  </asset>
  <worldbody>
    <light pos="0.5 0.6 1.5" dir="-0.2 -0.35 -1" diffuse="0.5 0.48 0.44" castshadow="false"/>
    <light pos="-0.5 -0.6 1.2" dir="0.5 0.4 -1" diffuse="0.25 0.27 0.3" castshadow="false"/>
    <geom type="plane" size="1.5 1.5 0.1" material="wood" contype="0" conaffinity="1"/>
    <geom type="box" size="0.04 0.03 0.03" pos="0 0 0.03" contype="0"/>
    <camera name="left" pos="0.5 0.4 0.4"/>
    <camera name="right" pos="0.5 -0.4 0.4"/>
    <body name="object" mocap="true"><geom name="object" class="ball"/></body>
    <body pos="0.0388353 0 0.0624" quat="0 0 -1 0">
      <joint name="shoulder_pan" range="-1.91986 1.91986"/><joint class="play"/>
      <inertial pos="-0.0307604 0 -0.0252713" mass="0.1" diaginertia="8.4e-5 8.1e-5 2.4e-5"/>
      <geom fromto="0 0 0.02 -0.0304 0 -0.0542" size="0.025"/>
      <body pos="-0.0303992 -0.0182778 -0.0542" quat="0.5 -0.5 -0.5 -0.5">
        <joint name="shoulder_lift" range="-1.74533 1.74533"/><joint class="play"/>
        <inertial pos="-0.0898471 -0.00838224 0.0184089" mass="0.103" diaginertia="4.1e-5 1.5e-4 1.4e-4"/>
        <geom fromto="0 0 0.0182 -0.11257 -0.028 0.0182"/>
        <body pos="-0.11257 -0.028 0" quat="0.707107 0 0 0.707107">
          <joint name="elbow_flex" range="-1.69 1.69"/><joint class="play"/>
          <inertial pos="-0.0980701 0.00324376 0.0182831" mass="0.104" diaginertia="2.9e-5 1.6e-4 1.5e-4"/>
          <geom fromto="0 0 0.0182 -0.1349 0.0052 0.0182"/>
          <body pos="-0.1349 0.0052 0" quat="0.707107 0 0 -0.707107">
            <joint name="wrist_flex" range="-1.65806 1.65806"/><joint class="play"/>
            <inertial pos="0 -0.0386143 0.0281156" mass="0.079" diaginertia="3.7e-5 2.5e-5 2.1e-5"/>
            <geom fromto="0 0 0.0182 0 -0.05 0.0182"/>
            <body pos="0 -0.0611 0.0181" quat="0.0172091 -0.0172091 0.706897 0.706897">
              <joint name="wrist_roll" range="-2.74385 2.84121"/><joint class="play"/>
              <inertial pos="0 0 -0.025187" mass="0.087" diaginertia="2.8e-5 4.3e-5 3.5e-5"/>
              <geom fromto="0 0 -0.01 -0.0079 0 -0.09" size="0.012"/>
              <geom name="bar" type="box" pos="-0.0079 0 -0.108" size="0.003 0.045 0.003"
                rgba="0.2 0.2 0.2 1"/>
              <site name="grip" group="4" pos="-0.0079 0 -0.125"/>
              <geom name="gripper_1" class="ball" pos="-0.0079 -0.05 -0.125"/>
              <geom name="gripper_2" class="ball" pos="-0.0079 0.05 -0.125"/>
              <body pos="0.0202 0.0188 -0.0234" quat="0.707107 0.707107 0 0">
                <joint name="gripper" range="-0.174533 1.74533"/>
                <inertial pos="0 -0.03 0.0193" mass="0.012" diaginertia="6.6e-6 1.9e-6 5.3e-6"/>
                <geom fromto="0 0 0.0189 0 -0.06 0.0189" size="0.008"/>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>{actuators}</actuator>
</mujoco>
"""


def model(tags=False) -> mujoco.MjModel:
    """The arm on its table, with two cameras and three balls, or tags in their place."""
    actuators = "".join(f'<position joint="{name}"/>' for name in MOTORS)
    spec = mujoco.MjSpec.from_string(
        MJCF.format(step=STEP, play=PLAY, ball=BALL, kp=KP, torque=TORQUE, actuators=actuators)
    )
    if tags:
        put_tags(spec)
        return spec.compile()
    for name, colour in BALLS.items():
        spec.geom(name).rgba[:3] = colour
    return spec.compile()


class Plant:
    """Motors that pull their joints to where they were told, as fast and as hard as they can.

    Args:
        tags: Whether the arm has tags in place of balls.

    Attributes:
        model, data: Of MuJoCo.
        home: Joint angles (6,) at first, in rad; with tags, which the jaw would cover, it is closed.
        targets: Joint angles (6,) that motors were told, in rad.
        powered: Whether motors have torque.
        jammed: Motors that do not move, by their numbers.
        weak: How far motors stay from where they were told (6,), in rad.
    """

    def __init__(self, tags=False):
        self.model = model(tags)
        self.data = mujoco.MjData(self.model)
        joints = [self.model.joint(name) for name in MOTORS]
        self._at = np.array([joint.qposadr[0] for joint in joints])
        self._dof = np.array([joint.dofadr[0] for joint in joints])
        self._damping = self.model.dof_damping.copy()
        self.home = HOME * [1, 1, 1, 1, 1, not tags]
        self.data.qpos[self._at] = self.home
        self.targets, self._setpoints = self.home.copy(), self.home.copy()
        self.powered, self.jammed, self.weak = True, set(), np.zeros(len(MOTORS))
        self.step(int(1 / STEP))

    def step(self, count=1):
        """Lets `STEP` seconds go by, so many times."""
        self.model.dof_damping[:] = self._damping
        self.model.dof_damping[self._dof[sorted(self.jammed)]] = 500.0
        for _ in range(count):
            ahead = self.targets - self._setpoints
            self._setpoints += np.clip(ahead, -SPEED * STEP, SPEED * STEP)
            self.data.ctrl[:] = self._setpoints + self.weak if self.powered else self.angles
            mujoco.mj_step(self.model, self.data)

    @property
    def angles(self):
        """What encoders see (6,), in rad."""
        return self.data.qpos[self._at]

    @property
    def speed(self):
        """Of the fastest joint, in rad/s."""
        return float(np.abs(self.data.qvel[self._dof]).max())

    def posed_by_hand(self, angles):
        """Power is off, and on again where somebody has brought the joints (6,), in rad."""
        self.data.qpos[self._at], self.data.qvel[:] = angles, 0
        self.targets[:] = self._setpoints[:] = angles

    def posed(self, angles):
        """A copy of the state with joints at angles (6,), by kinematics alone."""
        data = mujoco.MjData(self.model)
        data.mocap_pos[:] = self.data.mocap_pos
        data.qpos[self._at] = angles
        mujoco.mj_fwdPosition(self.model, data)
        return data
