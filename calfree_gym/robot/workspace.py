"""The work space: candidate objects, which of them both cameras see, and worlds that are in view."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import Array, Flags
from calfree_gym.image import inside, lengths
from calfree_gym.robot.inverse import InverseKinematics
from calfree_gym.robot.kinematics import gripper_position
from calfree_gym.robot.motors import JOINT_LIMITS, MotorMap
from calfree_gym.vision.cameras import StereoCameras
from calfree_gym.world import World

HEIGHT = (0.03, 0.25)
"""Objects lie between these heights above the table (m)."""
DISTANCE = (0.30, 0.50)
"""Objects lie between these distances from the waist's axis (m)."""
WAIST = 0.9
"""Objects lie within this angle of straight ahead (rad)."""
LIMIT_MARGIN = 0.1
"""No object needs a joint nearer than this to its limit (rad)."""
BORDER_PX = 16.0
"""Objects are seen at least this far inside both images."""
MAX_REGISTER = 0.9
"""Registers of at most this magnitude reach every object."""
MIN_IN_VIEW = 0.5
"""Share of the work space that both cameras must see."""
CHECKED = 200
"""Candidates that decide whether a world is in view."""
ATTEMPTS = 1000
"""Draws of worlds, or of blocks of candidate objects, before giving up."""

_LOWEST = JOINT_LIMITS[:3, 0] + LIMIT_MARGIN
_HIGHEST = JOINT_LIMITS[:3, 1] - LIMIT_MARGIN
_LOWEST[0], _HIGHEST[0] = -WAIST, WAIST
_JUDGING = np.random.default_rng(0).random((1, 50 * CHECKED, 3))

Indices = NDArray[np.intp]


class Candidates(NamedTuple):
    """Candidate objects.

    Attributes:
        points: In m (n, k, 3).
        within: Which of them (n, k) lie in the work space.
        reached: Which of them (n, k) registers within `MAX_REGISTER` reach.
        seen: Which of those within (n, k) both cameras see, from home and with the gripper there.
        apart: Image distance (n, k) of those within from the gripper at home, in image units, in the
            camera that sees the larger one.
    """

    points: Array
    within: Flags
    reached: Flags
    seen: Flags
    apart: Array


class Workspaces:
    """The work spaces of N worlds, one row each, and what their cameras see of them.

    Attributes:
        cameras: The cameras of the N worlds.

    Args:
        rows: N.
        mount: Where the cameras are fixed, see `cameras.MOUNTS`.
    """

    def __init__(self, rows: int, mount: str) -> None:
        self._turning = mount == "waist"
        self._motors = MotorMap(rows)
        self.cameras = StereoCameras(rows)
        self._lengths = np.ones((rows, 5))
        self._home = np.zeros((rows, 5))
        self._gripper_images = np.zeros((rows, 2, 2))
        self._gripper_seen = np.zeros(rows, bool)
        self._inverse: list[InverseKinematics | None] = [None] * rows

    def set_world(self, row: int, world: World) -> None:
        """Gives `row` the arm and the cameras of `world`."""
        self._motors.set_world(row, world)
        self.cameras.set_world(row, world)
        self._lengths[row] = world.link_lengths
        self._inverse[row] = None
        one = np.array([row])
        self._home[one] = self._motors.joints(np.zeros((1, 3)), one)
        gripper = gripper_position(self._home[one, :4], self._lengths[one])
        self._gripper_images[one], self._gripper_seen[one] = self._images(gripper, self._home[one, 0], one)

    def candidates(self, draws: Array, rows: Indices) -> Candidates:
        """Turns uniform draws in [0, 1) (n, k, 3), one each for J1-J3 of the n `rows`, into candidates."""
        joints = _LOWEST + draws * (_HIGHEST - _LOWEST)
        wrist = self._motors.wrist(joints[..., 1], joints[..., 2], rows[:, None])
        bent = np.concatenate([joints, wrist[..., None]], -1)
        points = gripper_position(bent, self._lengths[rows][:, None])
        height, distance = points[..., 2], np.hypot(points[..., 0], points[..., 1])
        within = (
            (height >= HEIGHT[0])
            & (height <= HEIGHT[1])
            & (distance >= DISTANCE[0])
            & (distance <= DISTANCE[1])
        )
        of, _ = np.nonzero(within)
        images, judged = self._images(points[within], self._home[rows[of], 0], rows[of])
        if self._turning:
            judged &= self._images(points[within], joints[within][:, 0], rows[of])[1]
        seen, apart = np.zeros_like(within), np.zeros(within.shape)
        seen[within] = judged
        apart[within] = lengths(images - self._gripper_images[rows[of]]).max(-1)
        return Candidates(points, within, self._motors.reaches(joints, MAX_REGISTER, rows), seen, apart)

    def registers_at(self, row: int, point: Array) -> Array:
        """Registers (3,) that bring the gripper of `row` nearest to `point` (3,) in m."""
        inverse = self._inverse[row]
        if inverse is None:
            inverse = self._inverse[row] = self._inverse_of(row)
        return inverse.registers_at(point)

    def gripper_seen_at_home(self, row: int) -> bool:
        """Whether both cameras see the gripper at home."""
        return bool(self._gripper_seen[row])

    def _inverse_of(self, row: int) -> InverseKinematics:
        one = slice(row, row + 1)

        def gripper_at(registers: Array) -> Array:
            return gripper_position(self._motors.joints(registers, one)[:, :4], self._lengths[row])

        return InverseKinematics(gripper_at, self._motors.lowest[row], self._motors.highest[row])

    def _images(self, points: Array, waist: Array, rows: Indices) -> tuple[Array, Flags]:
        """Image points (k, 2, 2) of points (k, 3) in the cameras of their rows (k,), J1 at `waist` (k,).

        The second result says which of them (k,) both cameras see, well inside.
        """
        if self._turning:
            c, s = np.cos(waist), np.sin(waist)
            x, y, z = points.T
            points = np.stack([c * x + s * y, c * y - s * x, z], -1)
        images, shown = self.cameras.project(points, rows)
        return images, np.asarray((shown & inside(images, BORDER_PX)).all(-1))


def in_view(world: World, mount: str, whole: bool = False) -> bool:
    """Whether both cameras see the gripper at home and half of the work space, within the motors' reach.

    Args:
        world: The world.
        mount: Where its cameras are fixed.
        whole: Whether the motors must reach all of the work space, as they do in worlds as drawn; after
            a perturbation half of it, seen and reached, is enough.
    """
    workspace = Workspaces(1, mount)
    workspace.set_world(0, world)
    if not workspace.gripper_seen_at_home(0):
        return False
    found = workspace.candidates(_JUDGING, np.array([0]))
    reached, good = (
        found.reached[found.within][:CHECKED],
        (found.seen & found.reached)[found.within][:CHECKED],
    )
    if len(good) < CHECKED or (whole and not reached.all()):
        return False
    return bool(good.mean() >= MIN_IN_VIEW)


def first_in_view(draw: Callable[[int], World], mount: str, what: str, whole: bool = False) -> World:
    """The first of `draw(0)`, `draw(1)`, ... that is in view.

    Raises:
        ValueError: None of `ATTEMPTS` draws of `what` is.
    """
    for attempt in range(ATTEMPTS):
        world = draw(attempt)
        if in_view(world, mount, whole):
            return world
    raise ValueError(
        f"{what} is never in view on the {mount!r} mount: in {ATTEMPTS} draws no world had the gripper "
        f"at home and {MIN_IN_VIEW:.0%} of the work space in view of both cameras and within reach"
    )
