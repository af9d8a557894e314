"""N bases without physics: they follow their arcs at once, and what is seen follows in closed form."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import mujoco
import numpy as np

from calfree_gym.geometry import Array, Rows, quaternion_about, rotation_matrix
from calfree_gym.image import PIXELS_PER_UNIT
from calfree_gym.pool import OfWorlds
from calfree_gym.robot.docking.base import SPEED, WHEEL_RADIUS, Base, along, arc_to, before, placed, relative
from calfree_gym.robot.docking.model import FREE, UP, at_poses, dress, model_of, pose_of
from calfree_gym.robot.simulation import Picture
from calfree_gym.vision.cameras import pinhole

if TYPE_CHECKING:
    from calfree_gym.world.value import World


class RollingSimulation(OfWorlds):
    """N bases that roll without physics, one row each.

    Attributes:
        rows: N.
        poses: Where the bases are in the room (N, 3).
        slip: Standard deviation of a wheel's way (N, 1), as a share of it.
        cameras, prefix, covers: As of `Simulation`.

    Args:
        rows: N.
        base: The base.
    """

    state_names: ClassVar[tuple[str, ...]] = ("poses", "_turned")
    of_world: ClassVar[tuple[str, ...]] = (
        *("dock", "slip", "_track", "_marks", "_centres", "_axes", "_focal", "_pixels", "_depth"),
    )

    prefix: ClassVar[str] = ""
    covers: ClassVar[tuple[str, ...]] = ("floor", "sky")

    def __init__(self, rows: int, base: Base) -> None:
        self.rows, self._base, self.cameras = rows, base, base.cameras
        cameras, marks, motors = len(base.cameras), len(base.marks), len(base.motors)
        self.poses, self._turned = np.zeros((rows, 3)), np.zeros((rows, motors))
        self.dock, self.slip, self._track = np.zeros((rows, 3)), np.zeros((rows, 1)), np.ones(rows)
        self._marks = np.tile(base.marks, (rows, 1, 1))
        self._centres, self._axes = np.zeros((rows, 1, cameras, 3)), np.zeros((rows, 1, cameras, 3, 3))
        self._focal = np.ones((rows, 1, cameras, 1))
        self._pixels = np.zeros((rows, 2 * marks, cameras, 2))
        self._depth = np.ones((rows, 2 * marks, cameras))

    def set_world(self, row: int, world: World) -> None:
        """Puts `row` into `world`; the base stays where it is."""
        self.dock[row], self.slip[row], self._marks[row] = world.dock, world.slip, world.marks
        self._track[row] = world.link_lengths[0]
        self._centres[row, 0] = world.camera_position
        self._axes[row, 0] = [rotation_matrix(each) for each in world.camera_orientation]
        self._focal[row, 0, :, 0] = world.focal_length
        one = slice(row, row + 1)
        own = slice(len(world.marks), None)
        self._pixels[one, own], self._depth[one, own] = self._seen(self._marks[one], one)

    def place(self, rows: Rows, joints: Array, objects: Array) -> None:
        """Puts the bases of `rows` at poses (n, 3) before their docks, with wheels at (n, m)."""
        self.poses[rows], self._turned[rows] = placed(self.dock[rows], objects), joints

    def roll(self, rows: Rows, joints: Array, grip: Array) -> Array:
        """Turns the wheels of `rows` to (n, m) in rad; of their ways they take these shares (n, m).

        Returns:
            How long the wheel that rolls farthest takes (n,), in seconds.
        """
        ways = WHEEL_RADIUS * (joints - self._turned[rows])
        self._turned[rows] = joints
        self._drive(rows, ways * grip)
        return np.asarray(np.abs(ways).max(-1) / SPEED)

    def _drive(self, rows: Rows, ways: Array) -> None:
        """Rolls the wheels of `rows` so far (n, m), in m."""
        self.poses[rows] = along(self.poses[rows], self._base.arc(ways, self._track[rows]))

    def before_dock(self) -> Array:
        """Where the bases are relative to their docks (N, 3)."""
        return relative(self.dock, self.poses)

    def refresh(self) -> None:
        """Brings image points up to date with where everything is."""
        marks = self._marks.shape[1]
        there = before(self.before_dock(), self._marks)
        self._pixels[:, :marks], self._depth[:, :marks] = self._seen(there, slice(None))

    def pinhole_pixels(self) -> tuple[Array, Array]:
        """As `Simulation`: of the dock's marks in turn, in each camera, then of the own marks."""
        return self._pixels.reshape(self.rows, -1, 2), self._depth.reshape(self.rows, -1)

    def configuration(self, row: int) -> Array:
        """All that moves in a row (q,), as MuJoCo has it."""
        return at_poses(self.poses[row : row + 1], WHEEL_RADIUS, FREE + len(self._base.motors))[0]

    def picture(self) -> Picture:
        """As `Simulation`: a model and its state of their own, on which `show` puts a row."""
        model = model_of(self._base)
        return model, mujoco.MjData(model)

    def between(self, before: Array, after: Array, share: float) -> Array:
        """A configuration (q,) so far along the arc between both, which turns by half a turn at most."""
        start, end = pose_of(before), pose_of(after)
        there = before + share * (after - before)
        pose = along(start[None], share * arc_to(relative(start, end))[None])
        there[:FREE] = at_poses(pose, there[2], FREE)[0]
        return there

    def show(self, row: int, picture: Picture, configuration: Array | None = None) -> Picture:
        """Puts a row on a picture, as it is or in a configuration (q,); it is changed, and returned."""
        model, data = picture
        data.qpos[:] = self.configuration(row) if configuration is None else configuration
        x, y, heading = self.dock[row]
        data.mocap_pos[0], data.mocap_quat[0] = (x, y, 0), quaternion_about(UP, heading)
        dress(model, self._base, self._marks[row], self._centres[row, 0], self._axes[row, 0])
        mujoco.mj_forward(model, data)
        return picture

    def _seen(self, points: Array, rows: slice) -> tuple[Array, Array]:
        """Pixels (n, d, c, 2) and depths (n, d, c) of points (n, d, 3) in the frames of bases."""
        flat, depth = pinhole(points[:, :, None], self._centres[rows], self._axes[rows])
        return flat * self._focal[rows] + PIXELS_PER_UNIT, depth
