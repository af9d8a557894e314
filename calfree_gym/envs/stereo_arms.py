"""N stereo arms, each in its own world and at its own trial. Both environments step them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from calfree_gym.envs.sight import Seen, sight_of
from calfree_gym.envs.state import RowState, arm_state, check_state, restore, state_of
from calfree_gym.geometry import Array, Rows
from calfree_gym.image import IMAGE_SIZE, IMAGE_UNIT, PIXELS_PER_UNIT, inside, lengths
from calfree_gym.perturbations.application import Applied, PerturbationScheduler
from calfree_gym.robot.arms.marks import RADIUS as MARK_RADIUS
from calfree_gym.robot.arms.robot import Robot
from calfree_gym.robot.line_of_sight import LinesOfSight
from calfree_gym.robot.motor_errors import MotorErrors
from calfree_gym.robot.motors import MotorMap
from calfree_gym.robot.objects import ObjectDraws
from calfree_gym.robot.simulation import Simulation
from calfree_gym.robot.workspace import Workspaces, check_in_view, first_in_view
from calfree_gym.tasks import reach
from calfree_gym.vision.latency import Latency
from calfree_gym.world import World, WorldChoice, WorldDistribution, world_choices

LOOK_SECONDS = 4.0
"""Assumed seconds in which the arm settles and the vision system delivers still image points. With this
value a reach by test motions takes most of the paper's 50 s a grasp, and one learned motion a few seconds."""

_PARTS = ("simulation", "_motor_errors", "_latency", "_sight", "_scheduler")


class StereoArms:
    """N arms with stereo cameras, stepped together.

    Attributes:
        registers: Executed sums of control words since home (N, m).
        points: Image points (N, 4, 2) as last seen: gripper left, right, object left, right.
        visible: Which of the four points (N, 4) the last observation saw.
        delivered: Image points (N, 4, 2), flags (N, 4) and images (N, 2, ...), where there are any, as the
            controller gets them: delayed where there is latency.
        true_points: Where noise-free cameras see them now (N, 4, 2), not clipped to the image.
        motions: Motions since reset with a seed (N,).
        trials: Trials begun since reset with a seed (N,).

    Args:
        rows: N.
        world: A `World`, a distribution or its name, or a sequence of N of them.
        robot: The arm.
        camera_mount: "waist", "stand", the name of a body of the arm, or a pair of these, left and right.
        dynamics: "physics" or "kinematic".
        tolerance_px: Image distance of the rendezvous; no object starts nearer.
        perturbations: A schedule, see `perturbations.parse_schedule`.
        redraw: "never", or "trial": every trial in a new world, where `world` is a distribution.
        keep_in_view: Whether worlds and objects that the cameras do not see are drawn again.
        threads: Threads of the simulation; they change no number.
        observation: "points", or what is rendered: "vision", "pixels", "rgb" or "depth".
        occlusion: Whether what hides a point from a camera matters; always where images are rendered.
        image_size: Width and height in pixels of images that are delivered.

    Raises:
        ValueError: An argument is unknown, or a given world is not in view.
    """

    state_names: ClassVar[tuple[str, ...]] = (
        *("_choices", "_seeds", "_worlds", "motions", "trials", "_motions_before"),
        *("registers", "points", "visible", "true_points", "_drawn_at"),
    )

    def __init__(
        self,
        rows: int,
        *,
        robot: Robot,
        world: WorldChoice | Sequence[WorldChoice],
        camera_mount: str | Sequence[str],
        dynamics: str,
        tolerance_px: float,
        perturbations: Any,
        redraw: str,
        keep_in_view: bool,
        threads: int,
        observation: str = "points",
        occlusion: bool = False,
        image_size: int = IMAGE_SIZE,
    ) -> None:
        self.rows = rows
        self.robot, self.mounts = robot, robot.mounts(camera_mount)
        motors = len(robot.motors)
        self.tolerance = np.float32(tolerance_px * IMAGE_UNIT)
        self.simulation = Simulation(rows, robot, self.mounts, dynamics, threads)
        self.motors = MotorMap(rows, robot)
        self._motor_errors = MotorErrors(rows, motors)
        self._workspaces = Workspaces(rows, robot, self.mounts)
        self._scheduler = PerturbationScheduler(rows, perturbations, robot, self.mounts, keep_in_view)
        self._choices = world_choices(world, rows)
        self._redraws = redraw == "trial"
        self._keep_in_view = keep_in_view
        for choice in dict.fromkeys(self._choices):
            if isinstance(choice, World):
                self._check_in_view(choice)
                if self._redraws:
                    raise ValueError("redraw='trial' draws worlds: `world` must be a distribution")
        self._worlds: list[World | None] = [None] * rows
        self.registers = np.zeros((rows, motors))
        self.points = np.zeros((rows, 4, 2))
        self.visible = np.zeros((rows, 4), bool)
        self.true_points = np.zeros((rows, 4, 2))
        self.motions = np.zeros(rows, np.int64)
        self.trials = np.zeros(rows, np.int64)
        self._motions_before = np.zeros(rows, np.int64)
        self._seeds: list[int | None] = [None] * rows
        self._latency = Latency(rows)
        self._sight = sight_of(self, observation, image_size)
        self.delivered: Seen = (self.points, self.visible, *self._sight.images)
        self._lines: LinesOfSight | None = None
        if occlusion or self._sight.renders:
            self._lines = LinesOfSight(self.simulation, MARK_RADIUS * robot.rig.scale)
        self._moved = np.zeros(rows, bool)
        self._objects = ObjectDraws(
            self._workspaces, self.motors, float(self.tolerance), keep_in_view, self._lines
        )
        self._solved: list[tuple[World, bytes] | None] = [None] * rows
        self._object_registers = np.zeros((rows, motors))
        self._drawn_at = np.full((rows, motors), np.nan)
        self._all = np.arange(rows)

    def world(self, row: int) -> World:
        """The world of a row.

        Raises:
            gymnasium.error.ResetNeeded: There is none before the first reset.
        """
        world = self._worlds[row]
        if world is None:
            raise gym.error.ResetNeeded("there is no world before the first reset(); call it first")
        return world

    def needs_seed(self, row: int) -> bool:
        """Whether `row` was never seeded."""
        return self._seeds[row] is None

    def seed(self, row: int, seed: int) -> None:
        """Starts `row` anew from `seed`: its world, where that is to be drawn, objects and noise."""
        self._seed_streams(row, seed)
        self.motions[row] = self.trials[row] = self._motions_before[row] = 0
        choice = self._choices[row]
        self._enter(row, choice if isinstance(choice, World) else self._draw_world(choice, row, seed, 0))

    def _seed_streams(self, row: int, seed: int) -> None:
        self._seeds[row] = seed
        self._sight.seed(row, seed)
        self._motor_errors.seed(row, seed)
        self._objects.seed(row, seed)
        self._scheduler.seed(row, seed)

    def _draw_world(self, distribution: WorldDistribution, row: int, seed: int, trial: int) -> World:
        def draw(attempt: int) -> World:
            return distribution.sample(seed, attempt, trial, self.robot)

        if not self._keep_in_view:
            return draw(0)
        lines = self._lines
        also = None if lines is None else partial(lines.gripper_in_sight, row, self.motors)
        return first_in_view(
            draw, self.robot, self.mounts, f"a {distribution.name} world", whole=True, also=also
        )

    def set_world(self, row: int, world: World) -> None:
        """Puts `row` into `world` from now on; seeds then draw objects and noise only.

        Raises:
            ValueError: The world is not in view.
            TypeError: It is no `World`.
        """
        if not isinstance(world, World):
            raise TypeError(f"set_world got {type(world).__name__}; it takes a calfree_gym.World")
        self._check_in_view(world)
        self._choices[row] = world
        self._enter(row, world)

    def begin_trial(self, rows: Rows, objects: Array | None = None) -> list[Applied]:
        """Sends the arms of `rows` home and places the next objects, or the given ones (n, 3).

        Returns:
            The perturbations that were applied before; `observe` updates what is seen now.
        """
        indices = self._all[rows]
        if self._redraws:
            self._redraw(indices)
        applied = self._apply_due("trial", self.trials, rows)
        self.registers[rows] = 0.0
        self._drawn_at[rows] = np.nan
        if objects is None:
            objects, self._drawn_at[indices] = self._objects.draw(indices, self.trials)
        self.trials[rows] += 1
        self._motions_before[rows] = self.motions[rows]
        home = self.motors.positions(self.registers[rows], rows)
        home = self._motor_errors.at_home(rows, home, self.trials, self.motions_of_trial)
        self.simulation.place(rows, self.motors.angles(home, rows), objects)
        self._sight.begin_trial(indices)
        self._moved[rows] = True
        self.points[rows] = 0.0
        return applied

    def check_begun(self, rows: Rows = slice(None)) -> None:
        """Raises ResetNeeded where no trial has begun in some of these rows."""
        if not self.trials[rows].all():
            raise gym.error.ResetNeeded("no trial has begun: call reset() first")

    def move(self, rows: Rows, words: Array) -> tuple[Array, list[Applied]]:
        """Executes one motion of control words (n, m) in `rows`.

        Returns:
            Robot time of the motions (n,) in seconds, and the perturbations that were applied before them.

        Raises:
            gymnasium.error.ResetNeeded: No trial has begun.
        """
        self.check_begun(rows)
        applied = self._apply_due("motion", self.motions, rows)
        motors = self.motors
        registers = self.registers[rows] + words
        registers = np.minimum(np.maximum(registers, motors.lowest[rows]), motors.highest[rows])
        self.registers[rows] = registers
        self.motions[rows] += 1
        self._moved[rows] = True
        positions = self.motors.positions(registers, rows)
        positions = self._motor_errors.after_a_motion(rows, positions, self.trials, self.motions_of_trial)
        seconds = self.simulation.move(rows, self.motors.angles(positions, rows))
        return seconds + LOOK_SECONDS, applied

    def observe(self) -> None:
        """Updates what the cameras see, after every row has moved or begun a trial."""
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
        points = self.points
        if self._lines is not None:
            points = reach.kept_apart(points, self.visible, float(self.tolerance))
        self.delivered = self._latency.deliver(motions, points, self.visible, *images)

    @property
    def motions_of_trial(self) -> NDArray[np.int64]:
        """Motions of the present trial (N,)."""
        return self.motions - self._motions_before

    def home_seconds(self) -> Array:
        """Robot time (N,) of the way home from here, in seconds."""
        home = self.motors.joints(np.zeros_like(self.registers), slice(None))
        return self.simulation.travel_to(home) + LOOK_SECONDS

    def get_state(self, row: int) -> dict[str, Any]:
        """All that the next motions of a row follow from, apart from the arguments."""
        parts = {name: state_of(getattr(self, name), row) for name in _PARTS}
        delivered = tuple(each[row].copy() for each in self.delivered)
        return state_of(self, row) | parts | {"arm": arm_state(self.robot), "delivered": delivered}

    def set_state(self, row: int, state: RowState) -> None:
        """Brings a row into a state that `get_state` gave; `simulation.refresh` then updates positions.

        Raises:
            ValueError: It is the state of another arm.
        """
        check_state(state, self.robot)
        if (seed := state["_seeds"]) is not None and seed != self._seeds[row]:
            self._seed_streams(row, seed)
        if (world := state["_worlds"]) is not None and world is not self._worlds[row]:
            self._enter(row, world)
        self.true_points = self.true_points.copy()  # infos have given it away
        restore(self, row, state)
        for name in _PARTS:
            restore(getattr(self, name), row, state[name])
        self.delivered = tuple(each.copy() for each in self.delivered)
        for delivered, of_row in zip(self.delivered, state["delivered"], strict=True):
            delivered[row] = of_row
        self._solved[row] = None

    def close(self) -> None:
        """Frees what renders images; it comes back with the next image."""
        self._sight.close()

    def object_registers(self) -> Array:
        """Registers (N, m) at which the gripper is at the object, or as near as the motors let it.

        Where several postures lead there, the one by which the object was drawn, which the cameras see.
        """
        objects = self.simulation.positions()[1]
        for row in range(self.rows):
            wanted = self.world(row), objects[row].tobytes()
            if self._solved[row] != wanted:
                self._solved[row] = wanted
                drawn_at: Array | None = self._drawn_at[row]
                if not self.robot.ambiguous or np.isnan(self._drawn_at[row]).any():
                    drawn_at = None
                self._object_registers[row] = self._workspaces.registers_at(row, objects[row], drawn_at)
        return self._object_registers.copy()

    def error_px(self) -> Array:
        """Noise-free image distances (N,) in pixels, of the camera that sees the larger one."""
        left, right = lengths(self.true_points[:, :2] - self.true_points[:, 2:]).T
        return np.asarray(PIXELS_PER_UNIT * np.maximum(left, right))

    def _enter(self, row: int, world: World) -> None:
        self._worlds[row] = world
        self.motors.set_world(row, world)
        self._motor_errors.set_world(row, world)
        self.simulation.set_world(row, world)
        self._workspaces.set_world(row, world)
        self._sight.set_world(row, world)
        self._latency.set_world(row, world)
        self._moved[row] = True
        self._objects.set_world(row, world)

    def _redraw(self, rows: NDArray[np.intp]) -> None:
        """Puts rows whose first trial is over into the next trial's world."""
        for row in rows[self.trials[rows] > 0]:
            choice, seed = self._choices[row], self._seeds[row] or 0
            if isinstance(choice, WorldDistribution):
                self._enter(row, self._draw_world(choice, row, seed, int(self.trials[row])))

    def _check_in_view(self, world: World) -> None:
        world.check_fits(self.robot)
        if self._keep_in_view:
            check_in_view(world, self.robot, self.mounts)

    def _apply_due(self, clock: str, counts: NDArray[np.int64], rows: Rows) -> list[Applied]:
        """Applies the events that are due in `rows`; the stops of these arms may move."""
        applied: list[Applied] = []
        for place, event in self._scheduler.events[clock]:
            for row in self._all[rows][event.is_due(counts[rows])].tolist():
                count = int(counts[row])
                world, perturbation = self._scheduler.apply(place, event, row, count, self.world(row))
                self._enter(row, world)
                if perturbation is not None:
                    applied.append((row, perturbation))
        return applied
