"""The work space: candidate objects, which of them both cameras see, and worlds that are in view."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from calfree_gym.arm import gripper_position
from calfree_gym.cameras import image_points, inside, pinhole
from calfree_gym.geometry import Array, Flags, rotation_matrix
from calfree_gym.motors import JOINT_LIMITS, MotorMap
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
"""Candidates by which a world is judged."""
ATTEMPTS = 1000
"""Worlds, or objects' blocks of candidates, drawn in vain before giving up."""

_LOWEST = JOINT_LIMITS[:3, 0] + LIMIT_MARGIN
_HIGHEST = JOINT_LIMITS[:3, 1] - LIMIT_MARGIN
_LOWEST[0], _HIGHEST[0] = -WAIST, WAIST
_JUDGING = np.random.default_rng(0).random((1, 20 * CHECKED, 3))

Indices = NDArray[np.intp]


class Workspaces:
    """The work spaces of N worlds, one row each, and what their cameras see of them.

    Args:
        rows: N.
        mount: Where the cameras are fixed, see `cameras.MOUNTS`.
    """

    def __init__(self, rows: int, mount: str) -> None:
        self._turning = mount == "waist"
        self._motors = MotorMap(rows)
        self._position = np.zeros((rows, 2, 3))
        self._rotation = np.zeros((rows, 2, 3, 3))
        self._focal_length = np.ones((rows, 2))
        self._principal_point = np.zeros((rows, 2, 2))
        self._k1 = np.zeros((rows, 2))
        self._lengths = np.ones((rows, 5))
        self._home = np.zeros(rows)

    def set_world(self, row: int, world: World) -> None:
        """Gives `row` the arm and the cameras of `world`."""
        self._motors.set_world(row, world)
        self._position[row] = world.camera_position
        self._rotation[row] = [rotation_matrix(q) for q in world.camera_orientation]
        self._focal_length[row] = world.focal_length
        self._principal_point[row] = world.principal_point
        self._k1[row] = world.lens_k1
        self._lengths[row] = world.link_lengths
        self._home[row] = self._motors.joints(np.zeros((1, 3)), np.array([row]))[0, 0]

    def candidates(self, draws: Array, rows: Indices) -> tuple[Array, Flags, Flags]:
        """Turns uniform draws into candidate objects.

        Args:
            draws: In [0, 1) (n, k, 3), one each for J1-J3.
            rows: The n rows.

        Returns:
            points: In m (n, k, 3).
            within: Which of them (n, k) lie in the work space, within reach of the motors.
            seen: Which of those (n, k) both cameras see, from home and with the gripper there.
        """
        joints = _LOWEST + draws * (_HIGHEST - _LOWEST)
        wrist = self._motors.wrist(joints[..., 1], joints[..., 2], rows[:, None])
        lengths = self._lengths[rows][:, None]
        points = gripper_position(np.concatenate([joints, wrist[..., None]], -1), lengths)
        height, distance = points[..., 2], np.hypot(points[..., 0], points[..., 1])
        within = (
            (height >= HEIGHT[0])
            & (height <= HEIGHT[1])
            & (distance >= DISTANCE[0])
            & (distance <= DISTANCE[1])
            & self._motors.reaches(joints, MAX_REGISTER, rows)
        )
        of, _ = np.nonzero(within)
        judged = self._seen(points[within], self._home[rows[of]], rows[of])
        if self._turning:
            judged &= self._seen(points[within], joints[within][:, 0], rows[of])
        seen = np.zeros_like(within)
        seen[within] = judged
        return points, within, seen

    def gripper_seen_at_home(self, row: int) -> bool:
        """Whether both cameras see the gripper at home."""
        rows = np.array([row])
        home = self._motors.joints(np.zeros((1, 3)), rows)
        point = gripper_position(home[:, :4], self._lengths[rows])
        return bool(self._seen(point, home[:, 0], rows)[0])

    def _seen(self, points: Array, waist: Array, rows: Indices) -> Flags:
        """Which points (k, 3) both cameras of their rows (k,) see, well inside, with J1 at `waist` (k,)."""
        if self._turning:
            c, s = np.cos(waist), np.sin(waist)
            x, y, z = points.T
            points = np.stack([c * x + s * y, c * y - s * x, z], -1)
        flat, depth = pinhole(points[:, None], self._position[rows], self._rotation[rows])
        images, shown = image_points(
            flat, self._focal_length[rows], self._principal_point[rows], self._k1[rows]
        )
        return np.asarray((shown & (depth > 0) & inside(images, BORDER_PX)).all(-1))


def in_view(world: World, mount: str) -> bool:
    """Whether both cameras see the gripper at home and at least half of the work space.

    A work space of which less than half can be reached by registers within `MAX_REGISTER` fails too.
    """
    workspace = Workspaces(1, mount)
    workspace.set_world(0, world)
    if not workspace.gripper_seen_at_home(0):
        return False
    _, within, seen = workspace.candidates(_JUDGING, np.array([0]))
    judged = seen[within][:CHECKED]
    return len(judged) == CHECKED and bool(judged.mean() >= MIN_IN_VIEW)


def first_in_view(draw: Callable[[int], World], mount: str, what: str) -> World:
    """The first of `draw(0)`, `draw(1)`, ... that is in view.

    Raises:
        ValueError: None of many is; `what` was drawn in vain.
    """
    for attempt in range(ATTEMPTS):
        world = draw(attempt)
        if in_view(world, mount):
            return world
    raise ValueError(
        f"{what} is never in view on the {mount!r} mount: in {ATTEMPTS} draws no world had the gripper "
        f"at home and {MIN_IN_VIEW:.0%} of the work space in view of both cameras and within reach"
    )
