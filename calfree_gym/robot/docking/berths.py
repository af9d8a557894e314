"""Berths: from where the dock is seen, and how exactly its marks tell the docked pose."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import Array, Flags
from calfree_gym.image import PIXELS_PER_UNIT, inside
from calfree_gym.pool import OfWorlds
from calfree_gym.robot.arms.robot import Mounts
from calfree_gym.robot.docking.base import Base, before, relative
from calfree_gym.robot.docking.wheels import WheelMap
from calfree_gym.robot.workspace import BORDER_PX, MIN_IN_VIEW, judging_draws
from calfree_gym.streams import stream
from calfree_gym.vision.cameras import StereoCameras

if TYPE_CHECKING:
    from calfree_gym.world.value import World

DOCKED_M, DOCKED_DEGREES = 0.02, 2.0
"""A base within these is docked (issue 55)."""
LOWEST_STARTS, HIGHEST_STARTS = np.array([-1.5, -0.5, -np.radians(25)]), np.array([-0.3, 0.5, np.radians(25)])
"""Trials start between these poses, in the room, where the dock as built is at the origin."""
LEVEL = 0.05
"""Marks are at least so far (m) above or below every camera: at its height, they do not move up or down in
the image, and tell less."""
_JUDGED = 200
"""Starts that decide whether a world is in view."""
_STEP = 1e-4
"""By which image points are differenced, in m and rad (a guard: a third of the digits)."""
_DIRECTIONS = 2000
"""In which the set of poses that look docked is measured (a guard: to 2 %)."""
_DRAWN_AT_ONCE, _BLOCKS = 8, 500
"""Starts are drawn so many at a time, up to so many times (a guard)."""


class Accuracy(NamedTuple):
    """How far off a base can be whose marks all meet within the tolerance.

    Attributes:
        metres: From the docked place.
        degrees: From the docked heading.
    """

    metres: float
    degrees: float


class Berths(OfWorlds):
    """The docks of N worlds, one row each, as their cameras see them.

    Attributes:
        motors: The wheels of the N worlds.
        cameras: Their cameras.

    Args:
        rows: N.
        robot: Their base.
        mounts: Where the cameras are fixed.
        tolerance: Within which marks meet, in image units.
    """

    of_world: ClassVar[tuple[str, ...]] = ("_worlds", "_marks", "_dock")

    def __init__(self, rows: int, robot: Base, mounts: Mounts, tolerance: float) -> None:
        self.robot, self.mounts, self._tolerance = robot, mounts, tolerance
        self.motors = WheelMap(rows, robot)
        self._cameras_of_each, marks = len(robot.cameras), len(robot.marks)
        self.cameras = StereoCameras(rows, 2 * marks, self._cameras_of_each)
        self._worlds: NDArray[Any] = np.full(rows, None)
        self._marks, self._dock = np.zeros((rows, marks, 3)), np.zeros((rows, 3))

    def set_world(self, row: int, world: World) -> None:
        """Gives `row` the wheels, the cameras and the dock of `world`."""
        if self._worlds[row] is world:
            return
        self._worlds[row] = world
        self.motors.set_world(row, world)
        self.cameras.set_world(row, world)
        self._marks[row], self._dock[row] = world.marks, world.dock

    def images(self, poses: Array, rows: NDArray[np.intp]) -> tuple[Array, Flags]:
        """The dock's marks, seen from poses (n, k, 3) before the docks of rows (n,).

        Returns:
            Image points (n, k, d, c, 2), unclipped, and which the cameras show (n, k, d, c).
        """
        points = before(poses, self._marks[rows][:, None])
        return self.cameras.project(points[..., None, :], rows[:, None, None])

    def seen(self, poses: Array, rows: NDArray[np.intp]) -> Flags:
        """From which poses (n, k, 3) before the dock all cameras see all of its marks, well inside (n, k)."""
        images, shown = self.images(poses, rows)
        return np.asarray((shown & inside(images, BORDER_PX)).all((-2, -1)))

    def starts(
        self, seeds: list[int], trials: NDArray[np.int64], rows: NDArray[np.intp], in_view: bool
    ) -> Array:
        """Where the trials of rows (n,) start, before their docks (n, 3).

        Args:
            seeds: Of the rows (n,).
            trials: Of the rows (n,).
            rows: The rows.
            in_view: Whether only starts from which the dock is seen are drawn.

        Raises:
            ValueError: There is none in some row.
        """
        streams = [stream(seed, "starts", trial) for seed, trial in zip(seeds, trials.tolist(), strict=True)]
        found, open_ = np.zeros((len(rows), 3)), np.arange(len(rows))
        for _ in range(_BLOCKS):
            shares = np.stack([streams[each].random((_DRAWN_AT_ONCE, 3)) for each in open_.tolist()])
            poses = self._before_dock(shares, rows[open_])
            seen = self.seen(poses, rows[open_]) if in_view else np.ones(poses.shape[:2], bool)
            first, any_ = seen.argmax(1), seen.any(1)
            found[open_[any_]] = poses[any_, first[any_]]
            if not len(open_ := open_[~any_]):
                return found
        row = int(rows[open_[0]])
        raise ValueError(
            f"no start of a trial has all of the dock's marks in view: none of {_BLOCKS * _DRAWN_AT_ONCE} "
            f"drawn in row {row}, whose dock is at {self._dock[row].tolist()}"
        )

    def _before_dock(self, shares: Array, rows: NDArray[np.intp]) -> Array:
        """Starts before the docks of rows (n,), from shares (n, k, 3) of their range."""
        return relative(self._dock[rows][:, None], LOWEST_STARTS + shares * (HIGHEST_STARTS - LOWEST_STARTS))

    def accuracy(self, row: int) -> Accuracy:
        """How exactly the marks of a row tell the docked pose, to first order about it."""
        steps = _STEP * np.concatenate([np.eye(3), -np.eye(3)])
        images = self.images(steps[None], np.array([row]))[0][0].reshape(2, 3, -1, 2)
        jacobian = (images[0] - images[1]) / (2 * _STEP)  # (3, d * c, 2)
        normal = np.einsum("ikx,jkx->ij", jacobian, jacobian)
        try:
            root = np.linalg.cholesky(normal)
        except np.linalg.LinAlgError:
            return Accuracy(np.inf, np.inf)
        poses = np.linalg.solve(root.T, _directions().T).T
        errors = np.einsum("ni,ikx->nkx", poses, jacobian)
        reach = self._tolerance / np.sqrt(np.square(errors).sum(-1).max(-1))
        poses = poses * reach[:, None]
        return Accuracy(float(np.hypot(*poses.T[:2]).max()), float(np.degrees(np.abs(poses[:, 2]).max())))

    def in_view(self, row: int, whole: bool = False) -> bool:
        """Whether own marks and half of the starts are in view, and a base that looks docked is docked.

        Fewer than four marks are not asked how exactly they tell the docked pose.
        """
        world, rows = self._worlds[row], np.array([row])
        heights = self._marks[row, :, None, 2] - world.camera_position[:, 2]
        if np.abs(heights).min() < LEVEL or not self.seen(np.zeros((1, 1, 3)), rows).all():
            return False
        starts = self._before_dock(judging_draws(_JUDGED, 3), rows)
        if self.seen(starts, rows).mean() < MIN_IN_VIEW:
            return False
        return len(self.robot.marks) < 4 or self.tells_docked(row)

    @property
    def in_view_means(self) -> str:
        """What a world in view has, in words."""
        return (
            f"its own marks, and the dock's from {MIN_IN_VIEW:.0%} of the starts, in view of all cameras, "
            f"marks at least {LEVEL} m above or below these, and, by marks that meet within tolerance_px "
            f"{self._tolerance * PIXELS_PER_UNIT:g} (a smaller one tells it better), the docked pose told to "
            f"{DOCKED_M} m and {DOCKED_DEGREES:g} degrees"
        )

    def check_in_view(self, row: int) -> None:
        """Raises where the world of a row, which was given, is not in view.

        Raises:
            ValueError: Says what must be, and how exactly its marks tell the docked pose.
        """
        if not self.in_view(row):
            metres, degrees = self.accuracy(row)
            raise ValueError(
                f"the given world is not in view; it must have {self.in_view_means}. Its marks tell the "
                f"pose to {metres:.3f} m and {degrees:.1f} degrees"
            )

    def tells_docked(self, row: int) -> bool:
        """Whether a base whose marks all meet within the tolerance is docked."""
        metres, degrees = self.accuracy(row)
        return metres <= DOCKED_M and degrees <= DOCKED_DEGREES


def _directions() -> Array:
    """Points (k, 3) spread evenly on half of the unit sphere: a Fibonacci lattice."""
    height = (np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS
    around = np.pi * (1 + np.sqrt(5)) * np.arange(_DIRECTIONS)
    level = np.sqrt(1 - height * height)
    return np.stack([level * np.cos(around), level * np.sin(around), height], -1)
