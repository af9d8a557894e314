"""Where plates with holes stand: where the peg can go in, and both cameras see it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calfree_gym.geometry import Array, Flags, quaternion_of
from calfree_gym.robot.arms.movemaster import BEFORE_IT, DISTANCE, WAIST
from calfree_gym.robot.grasping.gripping_arm import GrippingArm
from calfree_gym.robot.grasping.jaws import AXIS
from calfree_gym.robot.grasping.placing import BLOCK, LEAST_GRASPABLE, Places
from calfree_gym.robot.inserting.peg import RIM
from calfree_gym.robot.motors import MotorMap
from calfree_gym.robot.workspace import ATTEMPTS, CHECKED, Workspaces
from calfree_gym.streams import stream

if TYPE_CHECKING:
    from calfree_gym.world import World

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
        robot, workspaces, motors: See `Places`.
        keep_in_view: Whether both cameras must see them.
    """

    def __init__(
        self, robot: GrippingArm, workspaces: Workspaces, motors: MotorMap, keep_in_view: bool
    ) -> None:
        super().__init__(robot, workspaces, motors)
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
        tip = self._robot.gripper_position(self.home(row), world.link_lengths)
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
    far = DISTANCE[0] + shares[:, 0] * (DISTANCE[1] - DISTANCE[0])
    around, high = (2 * shares[:, 1] - 1) * WAIST, HEIGHT[0] + shares[:, 2] * (HEIGHT[1] - HEIGHT[0])
    return np.stack([far * np.cos(around), far * np.sin(around), high], -1)


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
