"""A peg, a plate with a hole, the arm that holds the peg, and where holes can stand."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import mujoco
import numpy as np

from calfree_gym.geometry import Array, Flags, Rows, quaternion_of
from calfree_gym.robot.arms.movemaster import BEFORE_IT, GRIPPER_POINT
from calfree_gym.robot.grasping.gripping_arm import (
    AXIS,
    HARD,
    OF_GRIPPER,
    OF_SURFACES,
    SPRING,
    GrippingArm,
    add_gripper,
    add_table,
)
from calfree_gym.robot.grasping.placing import BLOCK, LEAST_GRASPABLE, Places, before_the_arm
from calfree_gym.robot.grasping.simulation import OBJECT, GraspSimulation
from calfree_gym.robot.grasping.simulation import POINTS as OF_GRASPING
from calfree_gym.robot.simulation import Picture
from calfree_gym.robot.workspace import ATTEMPTS, CHECKED, Workspaces
from calfree_gym.streams import stream

if TYPE_CHECKING:
    from calfree_gym.world.value import World

RADIUS = 0.008
"""Of the peg (m). Choice: a dowel of 16 mm, which the jaws hold."""
STICKS_OUT = 0.045
"""The peg ends so far beyond the jaws (m). Choice: twice as deep as it is to go in, and a little."""
CHAMFER, NARROWER = 0.003, 0.0008
"""The peg's end narrows over this length, by so much of its radius (m): a dowel's chamfer, 3 mm at 15 degrees
(ISO 2338)."""
YIELDS = 0.003
"""The grip gives way to the side so far (m). Choice: that of a compliance for assembly (Whitney 1982)."""
DAMPING = 60.0
"""Of the grip, to the side (N s/m): that of the wrist along its axis."""
ARMATURE = 0.2
"""Of the grip, to the side (kg): that of the jaws. So it swings slowly enough for substeps of 5 ms."""
FRICTION = 0.2
"""Of steel on steel, hardly greased."""
THICKNESS = 0.004
"""Of the plate (m). Choice: thin, so that the hole does not guide the peg."""
PLATE = 0.050
"""Of the plate's middle ring, from the hole's axis to its edge (m)."""
SIDES = 24
"""The hole is a ring of so many boxes; its corners are wider than the hole by 0.9 %. Choice: by less than a
sixth of the smallest clearance asked for."""
RIM = 0.040
"""From the hole's centre to each of the plate's points (m). Choice: beyond the peg, near the edge."""
RIMS = tuple(f"rim_{i}" for i in range(1, 5))
"""Names of the plate's points."""


def add_peg(spec: Any, point: Any) -> None:
    """Puts a peg between the jaws, which gives way to the side as the wrist does along the axis.

    Args:
        spec: Of the arm and its gripper; it is changed.
        point: Where on the gripper the peg's end is (3,), on the gripper's axis.
    """
    plain, palm = mujoco.MjSpec().default, spec.body("palm")
    spec.delete(spec.site("gripper_point"))
    peg = palm.add_body(plain, name="peg", pos=point)
    for name, axis in (("grip_1", [0, 1, 0]), ("grip_2", [0, 0, 1])):
        peg.add_joint(
            plain,
            name=name,
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=axis,
            stiffness=SPRING,
            damping=DAMPING,
            armature=ARMATURE,
            limited=True,
            range=[-YIELDS, YIELDS],
        )
    length = STICKS_OUT + 0.03  # between the jaws, too
    skin = {
        "contype": OF_GRIPPER,
        "conaffinity": OF_SURFACES,
        "condim": 3,
        "friction": [FRICTION, 0.005, 0.0001],
        "priority": 1,
        "rgba": [0.75, 0.76, 0.80, 1],
        **HARD,
    }
    peg.add_geom(
        plain,
        name="peg",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        fromto=[-length, 0, 0, -CHAMFER, 0, 0],
        size=[RADIUS, 0, 0],
        mass=0.1,
        **skin,
    )
    angles = np.arange(SIDES) * 2 * np.pi / SIDES
    ring = np.stack([np.zeros(SIDES), np.cos(angles), np.sin(angles)], -1)
    ends = [RADIUS * ring - [CHAMFER, 0, 0], (RADIUS - NARROWER) * ring]
    spec.add_mesh(name="nose", uservert=np.concatenate(ends).ravel())
    peg.add_geom(plain, name="nose", type=mujoco.mjtGeom.mjGEOM_MESH, meshname="nose", mass=0.0, **skin)
    peg.add_site(plain, name="gripper_point", rgba=[0] * 4)


def add_plate(spec: Any, radius: float) -> None:
    """Adds a plate in the room, whose frame is at the centre of its hole, on the upper side, z upwards.

    Args:
        spec: Of the scene; it is changed.
        radius: Of the hole (m).
    """
    plain = mujoco.MjSpec().default
    plate = spec.worldbody.add_body(plain, name="object", pos=[0.4, 0, 0.1])
    half, wide = (PLATE - radius) / 2, PLATE * np.tan(np.pi / SIDES)
    for i in range(SIDES):
        angle = 2 * np.pi * i / SIDES
        middle = (radius + half) * np.array([np.cos(angle), np.sin(angle)])
        plate.add_geom(
            plain,
            name=f"plate_{i}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=[*middle, -THICKNESS / 2],
            quat=[np.cos(angle / 2), 0, 0, np.sin(angle / 2)],
            size=[half, wide, THICKNESS / 2],
            rgba=[0.20, 0.45, 0.70, 1],
            contype=OF_SURFACES,
            conaffinity=OF_SURFACES,
            condim=3,
            **HARD,
        )
    plate.add_site(plain, name="object_point", rgba=[0] * 4)
    for name, (x, y) in zip(RIMS, ((RIM, 0), (-RIM, 0), (0, RIM), (0, -RIM)), strict=True):
        plate.add_site(plain, name=name, pos=[x, y, 0], rgba=[0] * 4)


class InsertingArm(GrippingArm):
    """Four motors turn J1-J3 and J5; the jaws are closed on a peg, whose end is the gripper point.

    Args:
        clearance: The hole's diameter less the peg's (m).
    """

    opening = RADIUS

    def __init__(self, clearance: float) -> None:
        self._hole = RADIUS + clearance / 2

    def furnish(self, spec: Any) -> None:
        """See `GrippingArm`: with shorter jaws, a peg and a plate."""
        add_gripper(spec, spec.body("gripper"), GRIPPER_POINT, beyond=-STICKS_OUT)
        spec.site("gripper_base").pos = GRIPPER_POINT - [AXIS, 0, 0]
        add_peg(spec, GRIPPER_POINT)
        add_table(spec)
        add_plate(spec, self._hole)


POINTS = (*OF_GRASPING[: OBJECT + 1], *RIMS)
"""What cameras see: of the gripper as in grasping, with the peg's end as its point; the hole's centre, on the
upper side of the plate; and four points of the plate around it."""


class InsertSimulation(GraspSimulation):
    """N arms that put pegs into holes."""

    seen: ClassVar[tuple[str, ...]] = POINTS
    told: ClassVar[slice] = slice(2, 4)
    """See `GraspSimulation`: all contacts together, for a peg that presses has many."""
    pinned: ClassVar[float] = 0.0
    """See `GraspSimulation`: nothing pins a peg, and who presses is to press no more."""

    def _bind_object(self, model: mujoco.MjModel) -> tuple[str, ...]:
        return ("body_quat",)

    def _put(self, rows: Rows, objects: Array) -> None:
        """Puts plates at their poses (n, 7): the hole's centre in m, and a quaternion."""
        self._body_position[rows, self._body] = objects[:, :3]
        self._fields["body_quat"][rows, self._body] = objects[:, 3:]

    def set_plate(self, row: int, pose: Array) -> None:
        """Puts the plate of a row at a pose (7,), with the arm where it is."""
        self._put(np.array([row]), pose[None])

    def tips(self) -> tuple[Array, Array]:
        """How deep the pegs' ends are below the plates' upper side (N,), and how far from holes' axes (N,).

        In m, at the last refresh.
        """
        tip, hole = self.positions()
        across = self._sites[:, self._site[OBJECT + 1 :]] - hole[:, None]
        normal = np.cross(across[:, 0], across[:, 2])
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        depth = -np.einsum("nk,nk->n", tip - hole, normal)
        return depth, np.linalg.norm(tip - hole + depth[:, None] * normal, axis=-1)

    def show_object(self, row: int, picture: Picture, object_: Array | None) -> None:
        """See `Simulation`: the plate stays where it is."""
        picture[0].body_quat[:] = self._fields["body_quat"][row]


HEIGHT = (0.08, 0.14)
"""Holes are between these heights above the table (m). Choice: plates, however they lean, and what passes
through them, stay clear of the table."""
LEANS = np.radians(5.0)
"""The hole's axis differs from the gripper's by up to this angle (rad). Choice: the arm cannot turn the peg
upright, see `Holes`."""
CLEAR = 0.03
"""At home the peg's end is so high above the plate's upper side, at least (m). Choice: so the arm comes from
above, and stands in no plate."""
BEYOND = 0.025
"""The arm must reach so far beyond the hole's centre, too (m)."""


class Holes(Places):
    """Draws plates for N arms: a pure function of seed and trial.

    Four motors move the peg, but do not tilt it: the wrist keeps the gripper at one angle, which wrong joint
    zeros tilt by up to 28 degrees. No such peg goes into a hole that is upright. So plates lean: the hole's
    axis is that of the gripper at the hole, but for an angle within `LEANS`.

    Args:
        robot, workspaces: See `Places`.
        keep_in_view: Whether both cameras must see them.
    """

    def __init__(self, robot: GrippingArm, workspaces: Workspaces, keep_in_view: bool) -> None:
        super().__init__(robot, workspaces)
        self._keep_in_view = keep_in_view

    def draw(self, row: int, seed: int, trial: int, world: World) -> Array:
        """The pose (7,) of the plate of a trial: the hole's centre in m, and a quaternion.

        Raises:
            ValueError: There is no place for it.
        """
        for block in range(ATTEMPTS):
            shares = stream(seed, "hole", trial, block).random((BLOCK, 6))
            good, poses = self._judged(row, world, _places(shares[:, :3]), shares[:, 3:])
            if good.any():
                return poses[good.argmax()]
        raise ValueError(
            f"no hole in {ATTEMPTS * BLOCK} drawn places can be reached and is in view of both cameras, in "
            f"row {row}, trial {trial}: see its world"
        )

    def given(self, row: int, seed: int, trial: int, world: World, place: Array) -> Array:
        """The same, with the hole's centre at a given place (3,) in m.

        Raises:
            ValueError: The arm cannot put a peg in there.
        """
        turns = stream(seed, "hole", trial).random((1, 3))
        reached, _, poses = self._reached(row, world, place[None], turns)
        if not reached[0] or place[2] < HEIGHT[0]:
            raise ValueError(
                f"the hole at {place.tolist()} is out of reach in this world, whose motors and links do not "
                f"bring the peg there along it; as built, pegs go in about {BEFORE_IT}, {HEIGHT[0]} to "
                f"{HEIGHT[1]} m above the table, and {CLEAR} m below the peg at home"
            )
        return poses[0]

    def serves(self, row: int, world: World) -> bool:
        """Whether there is a place for holes in enough of the work space of a world, which the row is in."""
        shares = np.random.default_rng(0).random((CHECKED, 6))
        good, _ = self._judged(row, world, _places(shares[:, :3]), shares[:, 3:])
        return bool(good.mean() >= LEAST_GRASPABLE)

    def _judged(self, row: int, world: World, places: Array, turns: Array) -> tuple[Flags, Array]:
        """In which holes (k,) the peg can be put, seen all the way; and the poses of plates (k, 7)."""
        reached, seen, poses = self._reached(row, world, places, turns)
        return reached & (seen | (not self._keep_in_view)), poses

    def _reached(self, row: int, world: World, places: Array, turns: Array) -> tuple[Flags, Flags, Array]:
        """Which holes are reached, and which are seen; and the poses of plates (k, 7)."""
        angles, reached = self.joints_at(row, world, places)
        axis = self._robot.axis(angles)
        frames = np.stack([_frame(-a, turn) for a, turn in zip(axis, turns, strict=True)])
        tip = self._robot.gripper_position(self._workspaces.home(row), world.link_lengths)
        reached &= np.einsum("nk,nk->n", tip - places, frames[:, :, 2]) > CLEAR
        seen = np.ones(len(places), bool)
        marks = [places, *(places + sign * RIM * frames[:, :, i] for i in (0, 1) for sign in (1, -1))]
        for point in marks:
            seen &= self.seen_from_home(row, point)
        for ahead in (-AXIS, BEYOND):
            angles, reaches = self.joints_at(row, world, places + ahead * axis)
            reached &= reaches
            for point in (*marks, places + ahead * axis, places + (ahead - AXIS) * axis):
                seen &= self.seen_from(row, point, angles)
        quaternions = np.stack([quaternion_of(frame) for frame in frames])
        return reached, seen, np.concatenate([places, quaternions], 1)


def _places(shares: Array) -> Array:
    """Holes' centres (k, 3) in m, from numbers in [0, 1) (k, 3)."""
    return before_the_arm(shares, HEIGHT[0] + shares[:, 2] * (HEIGHT[1] - HEIGHT[0]))


def _frame(upwards: Array, turns: Array) -> Array:
    """A plate's axes as columns (3, 3): z near `upwards` (3,), as numbers in [0, 1) (3,) say."""
    lean, around, spin = LEANS * np.sqrt(turns[0]), 2 * np.pi * turns[1], 2 * np.pi * turns[2]
    side = np.cross(upwards, [0.0, 1.0, 0.0] if abs(upwards[1]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    other = np.cross(upwards, side)
    z = np.cos(lean) * upwards + np.sin(lean) * (np.cos(around) * side + np.sin(around) * other)
    x = np.cross(other, z)
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    return np.stack([np.cos(spin) * x + np.sin(spin) * y, np.cos(spin) * y - np.sin(spin) * x, z], -1)
