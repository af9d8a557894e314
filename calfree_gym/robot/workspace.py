"""The work space: candidate objects, which of them both cameras see, worlds in view, and postures."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import Array, Flags
from calfree_gym.image import inside, lengths, rounded
from calfree_gym.pool import OfWorlds
from calfree_gym.robot.arms.robot import ROOM, Mounts, Robot
from calfree_gym.robot.motors import MotorMap
from calfree_gym.vision.cameras import StereoCameras

if TYPE_CHECKING:
    from calfree_gym.world.value import World

_CANDIDATES = 400
"""From about so many turns, on a grid, may the search start."""
_ITERATIONS = 30
"""Of a search (a guard: a dozen are enough)."""
_STILL = 1e-9
"""The search ends with a step of shafts that is smaller."""
_STARTS = 20
"""Where stops end the search before the point is reached, it begins anew from so many places of the grid."""
_REACHED = 1e-5
"""At this distance (m) a point is reached."""
_STEP = 1e-5
"""Turns by which the Jacobian is differenced (a guard: a third of the digits)."""
_DAMPING = 1e-9
"""Of its steps (a guard: it is divided by)."""


class InverseKinematics:
    """How far shafts must turn for the gripper to be somewhere: the nearest of a grid, then damped steps.

    The steps are those of Gauss-Newton, damped (Levenberg 1944), within the stops.

    Args:
        gripper_at: From turns of shafts (k, motors) to gripper points (k, 3) in m.
        lowest: Turns at which the shafts stop (motors,).
        highest: The same at the other end.
    """

    def __init__(self, gripper_at: Callable[[Array], Array], lowest: Array, highest: Array) -> None:
        self._gripper_at = gripper_at
        self._lowest, self._highest = lowest, highest
        motors = len(lowest)
        along = max(3, round(_CANDIDATES ** (1 / motors)))
        axes = np.linspace(lowest, highest, along).T
        self._grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, motors)
        self._on_grid = gripper_at(self._grid)
        self._moved = _STEP * np.vstack([np.zeros(motors), np.eye(motors)])

    def shafts_at(self, point: Array, near: Array | None = None) -> Array:
        """Turns of shafts (motors,) that bring the gripper nearest to `point` (3,) in m.

        Args:
            point: Where it should be.
            near: Turns (motors,) from which the search starts, before it tries others.
        """
        found, least = np.empty(0), np.inf
        for start in self._starts(point, near):
            shafts, error = self._from(start, point)
            if error < least:
                found, least = shafts, error
            if least <= _REACHED**2:
                break
        return found

    def _starts(self, point: Array, near: Array | None) -> Iterator[Array]:
        """Turns (motors,) from which the search may start, `near` first."""
        if near is not None:
            yield near
        far = rounded(np.square(self._on_grid - point).sum(-1))
        yield from self._grid[far.argsort(kind="stable")[:_STARTS]]

    def _from(self, shafts: Array, point: Array) -> tuple[Array, float]:
        """The nearest turns (motors,) behind a start, and the squared distance there."""
        damping, error = _DAMPING, np.inf
        best = shafts
        for _ in range(_ITERATIONS):
            points = self._gripper_at(shafts + self._moved)
            found = float(np.square(points[0] - point).sum())
            if found < error:
                best, error, damping = shafts, found, max(damping / 10, _DAMPING)
                jacobian = (points[1:] - points[0]).T / _STEP
                residual = points[0] - point
            else:
                damping *= 100
            gradient = jacobian.T @ residual
            at_lowest, at_highest = best <= self._lowest, best >= self._highest
            stopped = (at_lowest & (gradient > 0)) | (at_highest & (gradient < 0))
            free = np.where(stopped, 0.0, 1.0)
            normal = jacobian.T @ jacobian * np.outer(free, free)
            step = np.linalg.solve(normal + np.diag(damping + stopped), gradient * free)
            shafts = np.clip(best - step, self._lowest, self._highest)
            if np.abs(shafts - best).max() < _STILL:
                break
        return best, error


BORDER_PX = 16.0
"""Objects are seen at least this far inside both images."""
MAX_REGISTER = 0.9
"""Registers of at most this magnitude reach every object."""
MIN_IN_VIEW = 0.5
"""Share of the work space that both cameras must see."""
MIN_IN_VIEW_ON_A_LINK = 0.2
"""The same, where a camera is fixed to a link behind the first one, and turns away as it moves."""
FARTHEST = 2.0
"""No object lies farther than this from the middle of the RV-M2's work space (m), all of which lies within
0.4 m; of another arm, for its size."""
CHECKED = 200
"""Candidates that decide whether a world is in view."""
PLACED_AT_ONCE = 500
"""Candidates are placed so many at a time, until `CHECKED` lie in the work space (a guard: it saves time)."""
ATTEMPTS = 1000
"""Draws of worlds, or of blocks of candidate objects, before giving up."""

Indices = NDArray[np.intp]


class Candidates(NamedTuple):
    """Candidate objects.

    Attributes:
        positions: Of the motors' joints (n, k, m).
        points: Where the gripper is there, in the room, in m (n, k, 3).
        within: Which of them (n, k) lie in the work space.
        reached: Which of those within (n, k) registers within `MAX_REGISTER` reach.
        seen: Which of those within (n, k) both cameras see, from home and with the gripper there.
        apart: Image distance (n, k) of those within from the gripper at home, in image units, in the
            camera that sees the larger one.
    """

    positions: Array
    points: Array
    within: Flags
    reached: Flags
    seen: Flags
    apart: Array


class Workspaces(OfWorlds):
    """The work spaces of N worlds, one row each: what their motors reach, and what their cameras see.

    Attributes:
        motors: The motors of the N worlds.
        cameras: Their cameras.

    Args:
        rows: N.
        robot: Their arm.
        mounts: Where the cameras are fixed.
        points: How many of them each camera sees.
    """

    of_world: ClassVar[tuple[str, ...]] = (
        "_lengths",
        "_home",
        "_gripper_images",
        "_gripper_seen",
        "_inverse",
        "_worlds",
    )

    def __init__(self, rows: int, robot: Robot, mounts: Mounts, points: int = 2) -> None:
        self.robot, self.mounts = robot, mounts
        self._moving = mounts != (ROOM, ROOM)
        self.motors = MotorMap(rows, robot)
        self.cameras = StereoCameras(rows, points)
        self._lengths = np.ones((rows, len(robot.links)))
        self._home = np.zeros((rows, len(robot.built_home)))
        self._gripper_images = np.zeros((rows, 2, 2))
        self._gripper_seen = np.zeros(rows, bool)
        self._inverse, self._worlds = np.full(rows, None), np.full(rows, None)

    def set_world(self, row: int, world: World) -> None:
        """Gives `row` the arm and the cameras of `world`."""
        if self._worlds[row] is world:
            return
        self._worlds[row] = world
        self.motors.set_world(row, world)
        self.cameras.set_world(row, world)
        self._lengths[row] = world.link_lengths
        self._inverse[row] = None
        one = np.array([row])
        self._home[one] = self.motors.joints(np.zeros((1, len(self.robot.motors))), one)
        gripper = self.robot.gripper_position(self._home[one], self._lengths[one])
        self._gripper_images[one], self._gripper_seen[one] = self.images(gripper, self._home[one], one)

    def candidates(self, draws: Array, rows: Indices) -> Candidates:
        """Turns uniform draws in [0, 1) (n, k, m), one a motor of the n `rows`, into candidates."""
        positions, angles, points, within = self._placed(draws, rows)
        reached, seen, apart = np.zeros_like(within), np.zeros_like(within), np.zeros(within.shape)
        of = rows[within.nonzero()[0]]
        reached[within] = self.motors.reaches(positions[within], MAX_REGISTER, of)
        seen[within], images = self._seen(points[within], angles[within], of)
        apart[within] = lengths(images - self._gripper_images[of]).max(-1)
        return Candidates(positions, points, within, reached, seen, apart)

    def _placed(self, draws: Array, rows: Indices) -> tuple[Array, Array, Array, Flags]:
        """Of draws as for `candidates`: positions, of all joints too, points, and which are within."""
        positions = self.robot.postures(draws)
        angles = self.motors.angles(positions, rows)
        points = self.robot.gripper_position(angles, self._lengths[rows][:, None])
        return positions, angles, points, self.robot.within(points)

    def _seen(self, points: Array, angles: Array, rows: Indices) -> tuple[Flags, Array]:
        """Whether both cameras see points (k, 3) from home and with joints at (k, j), and from home where."""
        home = np.broadcast_to(self._home[rows], angles.shape)
        images, seen = self.images(points, np.stack([home, angles] if self._moving else [home]), rows)
        return np.asarray(seen.all(0)), images[0]

    def registers_at(self, row: int, point: Array, near: Array | None = None) -> Array:
        """Registers (m,) that bring the gripper of `row` nearest to `point` (3,) in m.

        Args:
            row: The row.
            point: Where the gripper should be.
            near: Positions of the motors' joints (m,) near which the search starts.
        """
        inverse: InverseKinematics | None = self._inverse[row]
        if inverse is None:
            inverse = self._inverse[row] = self._inverse_of(row)
        if near is not None:
            near = self.motors.shafts(near, row)
        return self.motors.registers_of(inverse.shafts_at(point, near), row)

    def home(self, row: int) -> Array:
        """Joint positions (j,) at home."""
        return self._home[row].copy()

    def gripper_seen_at_home(self, row: int) -> bool:
        """Whether both cameras see the gripper at home."""
        return bool(self._gripper_seen[row])

    def in_view(self, row: int, whole: bool = False) -> bool:
        """See the function of this name, of the world of a row."""
        if not self._gripper_seen[row]:
            return False
        reached, good = self.judged(row)
        if len(good) < CHECKED or (whole and not reached.all()):
            return False
        return bool(good.mean() >= least_in_view(self.robot, self.mounts))

    @property
    def in_view_means(self) -> str:
        """What a world in view has, in words."""
        share = least_in_view(self.robot, self.mounts)
        return (
            f"the gripper at home, and {share:.0%} of the work space, in view of both cameras and within "
            "reach"
        )

    def check_in_view(self, row: int) -> None:
        """Raises where the world of a row, which was given, is not in view.

        Raises:
            ValueError: Says what must be.
        """
        if not self.in_view(row):
            least = least_in_view(self.robot, self.mounts)
            raise ValueError(
                f"the given world is not in view on {self.robot.mount_name(self.mounts)}: both cameras must "
                f"see the gripper at home and {least:.0%} of the work space, which the motors must reach"
            )

    def judged(self, row: int) -> tuple[Flags, Flags]:
        """Of the `CHECKED` candidates by which a world is judged: which are reached, and which also seen."""
        draws = judging_draws(self.robot.candidates, len(self.robot.motors))
        found: list[tuple[Array, ...]] = []
        for first in range(0, draws.shape[1], PLACED_AT_ONCE):
            *placed, within = self._placed(draws[:, first : first + PLACED_AT_ONCE], np.array([row]))
            found.append(tuple(each[within] for each in placed))
            if sum(len(points) for *_, points in found) >= CHECKED:
                break
        positions, angles, points = (np.concatenate(each)[:CHECKED] for each in zip(*found, strict=True))
        rows = np.array([row])
        reached = self.motors.reaches(positions, MAX_REGISTER, rows)
        return reached, reached & self._seen(points, angles, rows)[0]

    def _inverse_of(self, row: int) -> InverseKinematics:
        one = slice(row, row + 1)

        def gripper_at(shafts: Array) -> Array:
            angles = self.motors.angles(self.motors.driven(shafts, one), one)
            return self.robot.gripper_position(angles, self._lengths[row])

        return InverseKinematics(gripper_at, self.motors.lowest[row], self.motors.highest[row])

    def images(self, points: Array, angles: Array, rows: Indices) -> tuple[Array, Flags]:
        """Image points (..., k, 2, 2), unclipped, of points (k, 3) in the cameras of their rows (k,).

        Args:
            points: In the room, in m.
            angles: Of all joints (..., k, j).
            rows: The row of each point, or that of all.

        Returns:
            Them, and which of them (..., k) both cameras see, well inside.
        """
        lengths = self._lengths[rows]
        images, shown = self.cameras.project(
            self.robot.into_mounts(points, angles, lengths, self.mounts), rows
        )
        return images, np.asarray((shown & inside(images, BORDER_PX)).all(-1))


def in_view(world: World, robot: Robot, mounts: Mounts, whole: bool = False) -> bool:
    """Whether both cameras see the gripper at home and enough of the work space, within the motors' reach.

    Args:
        world: The world.
        robot: Its arm.
        mounts: Where its cameras are fixed.
        whole: Whether the motors must reach all of the work space, as they do in worlds as drawn; after
            a perturbation half of it, seen and reached, is enough.
    """
    workspace = Workspaces(1, robot, mounts)
    workspace.set_world(0, world)
    return workspace.in_view(0, whole)


def cameras_at_home(world: World, robot: Robot, mounts: Mounts) -> Array:
    """Optical centres (2, 3) in the room at registers zero: joint zeros and links move mounts on the arm."""
    motors = MotorMap(1, robot)
    motors.set_world(0, world)
    home = motors.joints(np.zeros((1, len(robot.motors))), slice(None))[0]
    positions = world.camera_position.copy()
    for camera, body in enumerate(mounts):
        if body != ROOM:
            origin, axes = robot.room_moved_with(body, home, world.link_lengths)
            positions[camera] = origin + axes @ positions[camera]
    return positions


def check_near(objects: Array, robot: Robot) -> None:
    """Raises where objects (n, 3) in m lie far beyond the work space.

    Raises:
        ValueError: Says how far, and how far it may be.
    """
    far = np.linalg.norm(objects - robot.rig.target, axis=-1)
    if (far > (farthest := FARTHEST * robot.rig.scale)).any():
        raise ValueError(
            f"the object at {objects[far.argmax()].tolist()} is {far.max():.2f} m from the middle of the "
            f"work space, {robot.rig.target.round(2).tolist()}; it must be within {farthest:.2f} m"
        )


@lru_cache(maxsize=8)
def judging_draws(count: int, motors: int) -> Array:
    """The draws (1, count, m) by which all worlds are judged."""
    return np.random.default_rng(0).random((1, count, motors))


def least_in_view(robot: Robot, mounts: Mounts) -> float:
    """The share of the work space that both cameras must see."""
    return MIN_IN_VIEW if set(mounts) <= {ROOM, robot.bodies[0]} else MIN_IN_VIEW_ON_A_LINK


def first_in_view(
    draw: Callable[[int], World],
    workspaces: Workspaces,
    row: int,
    what: str,
    whole: bool = False,
    also: Callable[[World], bool] | None = None,
    also_asks: str = "",
    as_seen: Callable[[World], World] = lambda world: world,
) -> World:
    """The first of `draw(0)`, `draw(1)`, ... that is in view `as_seen`, and of which `also` says yes.

    Each is judged in a row of work spaces, which is in the last one then.

    Raises:
        ValueError: None of `ATTEMPTS` draws of `what` is; where some were in view, names what `also_asks`.
    """
    seen = 0
    for attempt in range(ATTEMPTS):
        world = draw(attempt)
        workspaces.set_world(row, as_seen(world))
        if workspaces.in_view(row, whole):
            if also is None or also(world):
                return world
            seen += 1
    robot, mounts = workspaces.robot, workspaces.mounts
    if seen:
        raise ValueError(
            f"{what} never serves on {robot.mount_name(mounts)}: of {ATTEMPTS} drawn worlds {seen} were in "
            f"view, but in none {also_asks}"
        )
    raise ValueError(
        f"{what} is never in view on {robot.mount_name(mounts)}: in {ATTEMPTS} draws no world had "
        f"{workspaces.in_view_means}"
    )
