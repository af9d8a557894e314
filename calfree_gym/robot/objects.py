"""Objects that are drawn, and what the cameras see of them past the arm and what stands in the way."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import Array, Flags
from calfree_gym.image import CAMERAS, IMAGE_UNIT
from calfree_gym.pool import OfWorlds
from calfree_gym.robot.rays import MARKS, shares_by_camera
from calfree_gym.robot.simulation import Simulation
from calfree_gym.robot.workspace import ATTEMPTS, CHECKED, Candidates, Workspaces, judging_draws
from calfree_gym.streams import CounterStreams

if TYPE_CHECKING:
    from calfree_gym.world.value import World

NOWHERE = np.full(3, 1e3)
"""Where an object hides nothing (m)."""


class LinesOfSight:
    """Which points the cameras of N worlds see past the arm, the marks and what stands in the way.

    The gripper point is seen where both of its marks are.

    Args:
        simulation: The N worlds.
        radius: Of the marks (m).
    """

    LEAST_SHARE = 0.5
    """Of a ball that must be in sight. Choice: of half a ball the middle is still found."""

    def __init__(self, simulation: Simulation, radius: float) -> None:
        self._simulation, self._radius = simulation, radius
        self._picture = simulation.picture()
        model, prefix = self._picture[0], simulation.prefix
        self._balls = [model.geom(prefix + name).id for name in MARKS]
        self._cameras = [model.camera(prefix + name).id for name in CAMERAS]

    def in_sight(self, row: int) -> Flags:
        """Which points (4,) are seen now: gripper left and right, object left and right."""
        return self.shares(row) >= self.LEAST_SHARE

    def gripper_in_sight(self, row: int, joints: Array) -> bool:
        """Whether nothing hides the gripper with joints at (j,)."""
        return bool(self.shares(row, joints, NOWHERE)[:2].min() == 1)

    def shares(self, row: int, joints: Array | None = None, object_: Array | None = None) -> Array:
        """Which share (4,) of each point's marks is in sight: gripper left and right, object left and right.

        Args:
            row: The row.
            joints: Joint positions (j,), where they are to be others than now.
            object_: Where the object would be (3,).
        """
        picture = self._simulation.show(row, self._picture, joints, object_)
        balls = picture[1].geom_xpos[self._balls]
        left, right = shares_by_camera(picture, self._cameras, balls, self._radius)
        return np.array([left[:2].min(), right[:2].min(), left[2], right[2]])


BLOCK = 16
"""Candidates that one place of a stream holds."""
ALL = ATTEMPTS * BLOCK
"""Candidates of which one must be an object."""
AT_ONCE = 2048
"""About so many candidates, of all rows, are judged at once (a guard: it saves time)."""
AHEAD = 8
"""An arm that begins another trial in its world draws the objects of so many (a guard: it saves time)."""
APART_SIGMAS, MOST_APART = 6, 0.5
"""The distance of a new object from the gripper exceeds the tolerance by this many times the noise, but by no
more than a quarter of the image (in image units; choice: few objects are farther away)."""


class ObjectDraws(OfWorlds):
    """Draws objects for N arms, each from a stream of its own: a pure function of seed and trial.

    Args:
        workspaces: Of the N worlds.
        tolerance: Of the rendezvous, in image units.
        keep_in_view: Whether both cameras must see an object, from home and with the gripper there.
        lines: Tells what hides it, where that matters.
        way_is_free: Whether an arm gets from joints (j,) to others in a row, where that matters.
    """

    of_world: ClassVar[tuple[str, ...]] = ("_apart",)

    def __init__(
        self,
        workspaces: Workspaces,
        tolerance: float,
        keep_in_view: bool,
        lines: LinesOfSight | None,
        way_is_free: Callable[[int, Array, Array], bool] | None = None,
    ) -> None:
        self._way_is_free = way_is_free
        self._workspaces, self._motors, self._lines = workspaces, workspaces.motors, lines
        self._tolerance, self._keep_in_view = tolerance, keep_in_view
        rows, self._count = self._motors.shape
        self._apart = np.zeros((rows, 1))
        self._streams = CounterStreams(rows, "objects")
        self._ahead: list[dict[int, tuple[Array, Array]]] = [{} for _ in range(rows)]

    def seed(self, row: int, seed: int) -> None:
        """Starts `row` anew from `seed`."""
        self._streams.seed(row, seed)
        self._ahead[row].clear()

    def set_world(self, row: int, world: World) -> None:
        """Gives `row` the noise of `world`: no object starts where noise may show a rendezvous."""
        of_noise = np.minimum(APART_SIGMAS * world.point_noise * IMAGE_UNIT, MOST_APART)
        self._apart[row] = self._tolerance + of_noise
        self._ahead[row].clear()

    def note_worlds(self) -> None:
        """See `OfWorlds`: what was drawn ahead is of other worlds."""
        for ahead in self._ahead:
            ahead.clear()

    def draw(self, rows: NDArray[np.intp], trials: NDArray[np.int64]) -> tuple[Array, Array]:
        """The next objects of some rows: the first candidates that are seen and not yet reached.

        Args:
            rows: These rows (n,).
            trials: Trials begun in each row (N,).

        Returns:
            Objects (n, 3) in m, and positions (n, m) of the motors' joints at which the gripper is there.

        Raises:
            ValueError: There is none in a row.
        """
        trials = trials[rows]
        if len(rows) > 1 or self._lines is not None or self._way_is_free is not None:
            return self._drawn(rows, trials, len(rows))[:2]
        row, trial = int(rows[0]), int(trials[0])
        ahead = self._ahead[row]
        if trial not in ahead:
            count = AHEAD if ahead else 1
            objects, drawn_at, open_ = self._drawn(np.full(count, row), trial + np.arange(count), 1)
            ahead.clear()
            for i in {*range(count)}.difference(open_.tolist()):
                ahead[trial + i] = objects[i, None], drawn_at[i, None]
        return ahead[trial]

    def _drawn(
        self, rows: NDArray[np.intp], trials: NDArray[np.int64], needed: int
    ) -> tuple[Array, Array, NDArray[np.intp]]:
        """As `draw`, the objects of these trials (n,) in these rows (n,): of the first ones that are needed.

        Others are drawn as far as the same blocks of candidates have them; also returns which are still open.
        """
        objects, drawn_at = np.empty((len(rows), 3)), np.empty((len(rows), self._count))
        open_ = np.arange(len(rows))
        for block in range(ATTEMPTS):
            draws = np.empty((len(open_), BLOCK, self._count))
            for i, (row, trial) in enumerate(zip(rows[open_].tolist(), trials[open_].tolist(), strict=True)):
                self._streams.go_to(row, trial, block)
                self._streams.generator.random(out=draws[i])
            while draws.size:
                part = max(1, AT_ONCE // len(open_))
                at, good = self._judged(draws[:, :part], rows[open_])
                found = good.any(1)
                first = good[found].argmax(1)
                objects[open_[found]] = at.points[found, first]
                drawn_at[open_[found]] = at.positions[found, first]
                open_, draws = open_[~found], draws[~found, part:]
            if not (open_ < needed).any():
                return objects, drawn_at, open_
        hidden = ""
        if self._lines is not None:
            hidden = ", and hidden by nothing (as images and occlusion=True need; by the arm: see check-arm)"
        hidden += "" if self._way_is_free is None else ", with nothing in the way to it"
        apart_px = self._apart[rows[open_[0]], 0] / IMAGE_UNIT
        raise ValueError(
            f"no object in {ALL} candidates is within reach and in view of both "
            f"cameras{hidden}, and seen more than {apart_px:.0f} px from the "
            "gripper at home (the tolerance, and what noise may add to it), in row "
            f"{rows[open_[0]]}, trial {trials[open_[0]]}: see its world"
        )

    def exists(self, row: int, candidates: int = CHECKED) -> bool:
        """Whether one of so many candidates, the same for all worlds, can be an object in `row`."""
        _, good = self._judged(judging_draws(candidates, self._count), np.array([row]))
        return bool(good.any())

    def _judged(self, draws: Array, rows: NDArray[np.intp]) -> tuple[Candidates, Flags]:
        """Candidates of draws (n, k, m), and which of them (n, k) are good: at least the first of a row."""
        at = self._workspaces.candidates(draws, rows)
        good = at.seen & at.reached & (at.apart > self._apart[rows])
        if not self._keep_in_view:
            good |= at.within & at.reached & ~at.seen
        in_sight = self._lines if self._keep_in_view else None
        if in_sight is not None or self._way_is_free is not None:
            good = self._first_good(in_sight, rows, at, good)
        return at, good

    def _first_good(
        self, lines: LinesOfSight | None, rows: NDArray[np.intp], at: Candidates, good: Flags
    ) -> Flags:
        """Of good candidates (n, k) the first that nothing hides, and to which nothing is in the way."""
        first, homes = np.zeros_like(good), self._motors.joints(np.zeros((len(rows), self._count)), rows)
        for i, (row, home) in enumerate(zip(rows.tolist(), homes, strict=True)):
            for j in np.flatnonzero(good[i]).tolist():
                there = self._motors.angles(at.positions[i, j][None], rows[i, None])[0]
                if lines is not None and not _in_sight(lines, row, home, there, at.points[i, j]):
                    continue
                if self._way_is_free is None or self._way_is_free(row, home, there):
                    first[i, j] = True
                    break
        return first


def _in_sight(lines: LinesOfSight, row: int, home: Array, there: Array, point: Array) -> bool:
    """Whether nothing hides a point (3,), from home, nor point or gripper with joints `there` (j,)."""
    from_home = lines.shares(row, home, point)[2:]
    return bool(from_home.min() == 1 and lines.shares(row, there, point).min() == 1)
