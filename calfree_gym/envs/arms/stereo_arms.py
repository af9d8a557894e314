"""N stereo arms that reach for objects. Both environments step them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from calfree_gym.envs.arms.base import Arms
from calfree_gym.envs.arms.sight import Seen, sight_of
from calfree_gym.envs.arms.state import RowState
from calfree_gym.geometry import Array, Rows
from calfree_gym.image import IMAGE_SIZE, IMAGE_UNIT, PIXELS_PER_UNIT, inside, lengths
from calfree_gym.robot.arms.marks import RADIUS as MARK_RADIUS
from calfree_gym.robot.arms.robot import Mounts, Robot
from calfree_gym.robot.line_of_sight import LinesOfSight
from calfree_gym.robot.objects import ObjectDraws
from calfree_gym.robot.reach_simulation import ReachSimulation
from calfree_gym.tasks import reach
from calfree_gym.vision.tracking.tracker import StereoTracker
from calfree_gym.world import World


class StereoArms(Arms):
    """N arms, two points each: `points` are gripper left, right, object left, right.

    Args:
        rows: N.
        robot: The arm.
        dynamics: "physics" or "kinematic".
        tolerance_px: Image distance of the rendezvous; no object starts nearer.
        threads: Threads of the simulation; they change no number.
        observation: "points", or what is rendered: "vision", "pixels", "rgb" or "depth".
        occlusion: Whether what hides a point from a camera matters; always where images are rendered.
        image_size: Width and height in pixels of images that are delivered.
        **shared: See `Arms`.

    Raises:
        ValueError: See `Arms`.
    """

    simulation: ReachSimulation
    state_names: ClassVar[tuple[str, ...]] = (*Arms.state_names, "_drawn_at")
    parts: ClassVar[tuple[str, ...]] = (*Arms.parts, "_sight")
    also_asks = "is the gripper's mark at home hidden by nothing, as images and occlusion=True need"

    def __init__(
        self,
        rows: int,
        *,
        robot: Robot,
        camera_mount: str | tuple[str, ...],
        dynamics: str,
        tolerance_px: float,
        keep_in_view: bool,
        threads: int,
        observation: str = "points",
        occlusion: bool = False,
        image_size: int = IMAGE_SIZE,
        **shared: Any,
    ) -> None:
        simulation = self._new_simulation(rows, robot, robot.mounts(camera_mount), dynamics, threads)
        super().__init__(simulation, robot, 4, camera_mount=camera_mount, keep_in_view=keep_in_view, **shared)
        self.tolerance = np.float32(tolerance_px * IMAGE_UNIT)
        self._sight = sight_of(self, observation, image_size, StereoTracker)
        self.delivered: Seen = (self.points, self.visible, *self._sight.images)
        self._lines: LinesOfSight | None = None
        if occlusion or self._sight.renders:
            self._lines = LinesOfSight(self.simulation, MARK_RADIUS * robot.rig.scale)
        self._moved = np.zeros(rows, bool)
        self._objects = self._new_objects(keep_in_view)
        self._solved: list[tuple[World, bytes] | None] = [None] * rows
        self._object_registers = np.zeros_like(self.registers)
        self._drawn_at = np.full_like(self.registers, np.nan)

    def _new_simulation(
        self, rows: int, robot: Robot, mounts: Mounts, dynamics: str, threads: int
    ) -> ReachSimulation:
        return ReachSimulation(rows, robot, mounts, dynamics, threads)

    def _new_objects(self, keep_in_view: bool) -> ObjectDraws:
        tolerance = float(self.tolerance)
        return ObjectDraws(self._workspaces, self.motors, tolerance, keep_in_view, self._lines)

    def seed_streams(self, row: int, seed: int) -> None:
        """See `Arms`."""
        super().seed_streams(row, seed)
        self._sight.seed(row, seed)
        self._objects.seed(row, seed)

    def enter(self, row: int, world: World) -> None:
        """See `Arms`."""
        super().enter(row, world)
        self._sight.set_world(row, world)
        self._objects.set_world(row, world)
        self._moved[row] = True

    def also_in_view(self, row: int) -> Callable[[World], bool] | None:
        """See `Arms`: nothing hides the gripper at home."""
        lines = self._lines
        return None if lines is None else partial(lines.gripper_in_sight, row, self.motors)

    def next_objects(self, rows: NDArray[np.intp], given: Array | None) -> Array:
        """See `Arms`: points (n, 3) in m."""
        self._drawn_at[rows] = np.nan
        if given is not None:
            return given
        objects, self._drawn_at[rows] = self._objects.draw(rows, self.trials)
        return objects

    def begun(self, rows: Rows) -> None:
        """See `Arms`."""
        self._sight.begin_trial(self._all[rows])
        self._moved[rows] = True

    def execute(self, rows: Rows, words: Array) -> Array:
        """See `Arms`."""
        self._moved[rows] = True
        return self.simulation.move(rows, self.targets(rows, words))

    def observe(self) -> None:
        """See `Arms`."""
        self.simulation.refresh()
        pixels, depth = self.simulation.pinhole_pixels()
        true, shown = self._workspaces.cameras.through_lens(pixels)
        visible = shown & (depth > 0) & inside(true)
        self.true_points = true
        motions = self.motions_of_trial
        if self._lines is not None and not self._sight.finds:
            visible &= np.stack([self._lines.in_sight(row) for row in range(self.rows)])
        seen, self.visible, *images = self._sight.look(true, visible, self._moved)
        self._moved[:] = False
        self.points = np.where(self.visible[:, :, None], seen, self.points)
        points = reach.kept_apart(self.points, self.visible, float(self.tolerance))
        self.delivered = self._latency.deliver(motions, points, self.visible, *images)

    def set_state(self, row: int, state: RowState) -> None:
        """See `Arms`."""
        super().set_state(row, state)
        self._solved[row] = None

    def close(self) -> None:
        """See `Arms`."""
        self._sight.close()

    def object_registers(self) -> Array:
        """Registers (N, m), as sums of words, at which the gripper is at the object, or as near as can be.

        Where several postures lead there, the one by which the object was drawn, which the cameras see.
        """
        objects = self.simulation.positions()[1]
        for row in range(self.rows):
            wanted = self.world(row), objects[row].tobytes()
            if self._solved[row] != wanted:
                self._solved[row] = wanted
                drawn_at: Array = self._drawn_at[row]
                near = None if np.isnan(drawn_at).any() else drawn_at
                self._object_registers[row] = self._workspaces.registers_at(row, objects[row], near)
        return self._registers.in_words(self._object_registers)

    def error_px(self) -> Array:
        """Noise-free image distances (N,) in pixels, of the camera that sees the larger one."""
        left, right = lengths(self.true_points[:, :2] - self.true_points[:, 2:]).T
        return np.asarray(PIXELS_PER_UNIT * np.maximum(left, right))
