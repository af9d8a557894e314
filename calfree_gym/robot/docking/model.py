"""The MuJoCo model of a base and its dock: wheels, casters, floor, marks, their prints and cameras.

Two wheels are narrow, so that they hardly scrub as the base turns. Casters roll without friction: a contact
takes the larger friction of both its surfaces, unless one has priority. The centre of mass lies between the
axle and the rear caster; the front caster, a little higher, catches a base that brakes.

An omnidirectional wheel has rollers round its rim, which let it slide along its axle. So its contact has
friction across the axle alone: MuJoCo's contact of a capsule with a plane has the capsule's axis as its first
direction. The rollers' own inertia and the steps from one to the next are left out.

People see marks as balls on rods; cameras see printed tags in their place, and no rods.
"""

from __future__ import annotations

from typing import Any

import cv2
import mujoco
import numpy as np

from calfree_gym.geometry import Array, quaternion_of
from calfree_gym.robot.docking.base import TRACK, WHEEL_RADIUS, Base
from calfree_gym.robot.rays import MARKS_GROUP, RIG_GROUP
from calfree_gym.vision.dock_tags import MIDDLE, WIDER, picture, prints


def _numbers(values: Array) -> str:
    return " ".join(map(str, values.tolist()))


HALF_APART = 0.055
"""From a mark's point on the front to each of its pair (m)."""
FREE = 7
"""Numbers of a pose in qpos; then come the wheels."""
UP = np.array([0.0, 0.0, 1.0])
_FRONT = np.array([0.13, 0.0, 0.08])
_FOOT = np.array([0.0, 0.0, 0.1])
"""Where the rods of the marks begin, and the masts of the cameras, from the axle (m)."""
_OWN, _MARK, _CASTER = 0.022, 0.03, 0.03
_GRIP, _ALONG = 0.9, 0.01
"""Friction of wheels with the floor, and that of omnidirectional ones along their axles. Choice: the second
is that of rollers on bearings; with a third of it a base that stands creeps by 0.2 mm a motion."""
_FACING = _numbers(quaternion_of(np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])))
"""How prints are turned: they face who comes, upright."""
_COLOURS = "0.95 0.05 0.55 1", "0.05 0.70 0.25 1"
"""Of the marks of base and dock."""


def model_of(base: Base) -> mujoco.MjModel:
    """The model of a base: on two wheels with casters, or on three omnidirectional wheels."""
    omni = base.kind == "omni"
    wheels = "".join(
        f"""<body name="{name}" pos="{_numbers(TRACK / 2 * stands)} 0">
              <joint name="{name}" axis="{-rolls[1]} {rolls[0]} 0" damping=".02" armature=".01"/>
              {_wheel(name, f"{-rolls[1]} {rolls[0]} 0", omni)}
            </body>"""
        for name, stands, rolls in zip(base.wheels, base.stand, base.rolls, strict=True)
    )
    casters = "".join(
        f'<geom type="sphere" size="{_CASTER}" pos="{x} 0 {_CASTER - WHEEL_RADIUS + lifted}" mass=".2" '
        'friction="0 0 0" priority="1" condim="1" rgba=".5 .5 .5 1"/>'
        for x, lifted in (() if omni else ((-0.15, 0.0), (0.15, 0.003)))
    )
    contacts = "".join(
        f'<pair geom1="floor" geom2="{name}" condim="3" friction="{_ALONG} {_GRIP}"/>'
        for name in (base.wheels if omni else ())
    )
    own = "".join(
        f'<geom name="own{i}{end}" size="{_OWN}" rgba="{_COLOURS[0]}" class="shown"/>'
        f'<geom name="rod{i}{end}" type="cylinder" size=".002 .1" rgba=".6 .6 .6 1" class="shown"/>'
        for i in range(len(base.marks))
        for end in (0, 1)
    )
    docks = "".join(
        f'<geom name="dock{i}" size="{_MARK}" rgba="{_COLOURS[1]}" class="shown"/>'
        f'<geom name="post{i}" type="cylinder" size=".004 .1" rgba=".6 .6 .6 1" class="shown"/>'
        for i in range(len(base.marks))
    )
    eyes = "".join(
        f'<camera name="{name}" resolution="1 1" sensorsize="1 1" focal="1 1"/>'
        f'<geom name="{name}_mast" type="cylinder" size=".012 .1" rgba=".3 .4 .6 1" class="shown"/>'
        f'<geom name="{name}_camera" type="box" size=".018 .018 .03" rgba=".1 .1 .1 1" class="shown"/>'
        for name in base.cameras
    )
    tags = prints(len(base.marks))
    sheets = "".join(
        f'<texture name="tag{tag.number}" type="2d" file="{tag.number}.png"/>'
        f'<material name="tag{tag.number}" texture="tag{tag.number}" specular="0"/>'
        for tag in tags
    )
    own_tags, dock_tags = (
        "".join(
            f'<geom name="tag{tag.number}" type="box" size="{half} {half} .0005" quat="{_FACING}" '
            f'material="tag{tag.number}" class="seen" group="{MARKS_GROUP}"/>'
            for tag in tags
            if tag.own is own and (half := WIDER * tag.side / 2)
        )
        for own in (True, False)
    )
    servos = "".join(f'<position joint="{name}" kp="400" kv="20"/>' for name in base.wheels)
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco model="dock">
          <option timestep="0.002" integrator="implicitfast" cone="elliptic" impratio="10"/>
          <default>
            <geom friction="{_GRIP} 0.005 0.0001"/>
            <default class="seen"><geom type="sphere" contype="0" conaffinity="0" mass="0"/>
              <default class="shown"><geom group="{RIG_GROUP}"/></default>
            </default>
          </default>
          <visual>
            <headlight ambient=".6 .6 .6" diffuse=".15 .15 .15"/>
            <map shadowclip="1"/>
            <global offwidth="4096" offheight="4096"/>
          </visual>
          <statistic center="-.5 0 .3" extent="2.5"/>
          <asset>
            <texture name="sky" type="skybox" builtin="flat" rgb1=".83 .87 .91" width="64" height="64"/>
            <texture name="floor" type="2d" builtin="checker" rgb1=".97 .98 .98" rgb2=".91 .93 .93"
              width="64" height="64"/>
            <material name="floor" texture="floor" texuniform="true"/>
            {sheets}
          </asset>
          <worldbody>
            <light name="lamp" pos="-.5 0 4" dir="0 0 -1" directional="true" diffuse=".25 .25 .25"/>
            <geom name="floor" type="plane" size="0 0 .1" material="floor"/>
            <body name="base" pos="0 0 {WHEEL_RADIUS}">
              <freejoint/>
              <geom type="cylinder" size=".2 .06" pos="-.05 0 .06" mass="8" rgba=".3 .4 .6 1"
                contype="0" conaffinity="0"/>
              {casters}{wheels}{own}{own_tags}{eyes}
            </body>
            <body name="dock" mocap="true">
              <geom type="cylinder" size=".2 .002" pos="-.05 0 0" rgba=".55 .8 .6 1" class="seen"/>
              {docks}{dock_tags}
            </body>
          </worldbody>
          <contact>{contacts}</contact>
          <actuator>{servos}</actuator>
        </mujoco>""",
        {f"{tag.number}.png": cv2.imencode(".png", picture(tag.number))[1].tobytes() for tag in tags},
    )


def _wheel(name: str, axle: str, omni: bool) -> str:
    """The geoms of a wheel: what it looks like, and, where that is another thing, what touches the floor."""
    shape = f'type="cylinder" size="{WHEEL_RADIUS} .006" zaxis="{axle}" rgba=".15 .15 .15 1"'
    if not omni:
        return f'<geom {shape} mass=".6"/>'
    return (
        f'<geom {shape} class="seen"/>'
        f'<geom name="{name}" type="capsule" size="{WHEEL_RADIUS} .001" zaxis="{axle}" mass=".6" '
        'contype="0" conaffinity="0" group="3"/>'
    )


def at_poses(poses: Array, height: float, size: int) -> Array:
    """Configurations (n, size) of bases at poses (n, 3), axles at a height (m), wheels at zero."""
    configurations = np.zeros((len(poses), size))
    configurations[:, :2], configurations[:, 2] = poses[:, :2], height
    configurations[:, 3], configurations[:, 6] = np.cos(poses[:, 2] / 2), np.sin(poses[:, 2] / 2)
    return configurations


def pose_of(configurations: Array) -> Array:
    """Poses (..., 3) of bases in configurations (..., q), headings within +-pi."""
    x, y, _, w, i, j, k = np.moveaxis(configurations[..., :FREE], -1, 0)
    heading = np.arctan2(2 * (w * k + i * j), 1 - 2 * (j * j + k * k))
    return np.stack([x, y, heading], -1)


def dress(model: mujoco.MjModel, base: Base, marks: Array, centres: Array, axes: Array) -> None:
    """Puts marks (d, 3), and cameras by their centres (c, 3) and axes (c, 3, 3), where a world has them."""
    for i, mark in enumerate(marks):
        for end, apart in enumerate((-HALF_APART, HALF_APART)):
            end_of_rod = mark + np.array([0, apart, -WHEEL_RADIUS])
            model.geom(f"own{i}{end}").pos[:] = end_of_rod
            _join(model.geom(f"rod{i}{end}"), _FRONT, end_of_rod)
        model.geom(f"dock{i}").pos[:] = mark
        post = model.geom(f"post{i}")
        post.pos[:], post.size[1] = mark * [1, 1, 0.5], mark[2] / 2
    for tag in prints(len(marks)):
        model.geom(f"tag{tag.number}").pos[:] = (
            marks[tag.mark] + tag.grid[MIDDLE] - tag.own * WHEEL_RADIUS * UP
        )
    for name, centre, turn in zip(base.cameras, centres, axes, strict=True):
        for eye in (model.camera(name), model.geom(f"{name}_camera")):
            eye.pos[:], eye.quat[:] = centre - WHEEL_RADIUS * UP, quaternion_of(turn)
        _join(model.geom(f"{name}_mast"), _FOOT, eye.pos)
    model.geom_sameframe[:] = 0


def _join(rod: Any, start: Array, end: Array) -> None:
    """Puts a cylinder between two points."""
    way = end - start
    rod.pos[:], rod.size[1] = (start + end) / 2, np.linalg.norm(way) / 2
    mujoco.mju_quatZ2Vec(rod.quat, way)
