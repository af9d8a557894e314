"""N arms, each in its own world and at its own trial: what all tasks share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from calfree_gym.envs.arms.events import apply_due, undivided
from calfree_gym.envs.arms.state import RowState, arm_state, check_fits, check_state, restore, state_of
from calfree_gym.geometry import Array, Flags, Rows
from calfree_gym.perturbations.application import Applied, PerturbationScheduler
from calfree_gym.robot.arms.robot import Robot
from calfree_gym.robot.motors import MotorErrors, MotorMap, Registers
from calfree_gym.robot.simulation import Simulation
from calfree_gym.robot.workspace import Workspaces, check_in_view, first_in_view
from calfree_gym.vision.latency import Latency
from calfree_gym.world import World, WorldChoice, WorldDistribution, world_choices

LOOK_SECONDS = 4.0
"""Assumed seconds in which the arm settles and the vision system delivers still image points. With this
value a reach by test motions takes most of the paper's 50 s a grasp, and one learned motion a few seconds."""


class Arms(ABC):
    """N arms with stereo cameras, stepped together.

    Attributes:
        registers: Sums of what was executed since home (N, m), in [-1, 1].
        register_bound: Registers are told within +- this.
        points: Image points (N, p, 2) as last seen, left and right of each point in turn.
        visible: Which of them (N, p) the last observation saw.
        delivered: Image points (N, p, 2), flags (N, p) and what else is observed (N, ...), as the controller
            gets them: delayed where there is latency.
        true_points: Where noise-free cameras see them now (N, p, 2), not clipped to the image.
        tolerance: Image distance within which the task is done, in image units.
        motions: Motions since reset with a seed (N,).
        trials: Trials begun since reset with a seed (N,).

    Args:
        simulation: Of the N arms.
        robot: The arm.
        points: p.
        world: A `World`, a distribution or its name, or a sequence of N of them.
        camera_mount: "waist", "stand", the name of a body of the arm, or a pair of these, left and right.
        perturbations: A schedule, see `perturbations.parse_schedule`.
        redraw: "never", or "trial": every trial in a new world, where `world` is a distribution.
        keep_in_view: Whether worlds and objects that the cameras do not see are drawn again.

    Raises:
        ValueError: An argument is unknown, or a given world is not in view.
    """

    state_names: ClassVar[tuple[str, ...]] = (
        *("_choices", "_seeds", "_worlds", "motions", "trials", "_motions_before"),
        *("registers", "points", "visible", "true_points", "_begun"),
    )
    may_stop_short: ClassVar[bool] = False
    """Whether something may stop an arm on its way, see `stopped_short`."""
    parts: ClassVar[tuple[str, ...]] = ("simulation", "_registers", "_motor_errors", "_latency", "_scheduler")
    """Names of what has a state of its own."""
    shown_points: ClassVar[tuple[int, int, int, int]] = (0, 1, 2, 3)
    """Which of the image points are the gripper's and the object's, left and right of each."""
    also_asks: ClassVar[str] = ""
    """What `also_in_view` asks, in words."""
    delivered: tuple[NDArray[Any], ...]
    tolerance: np.float32

    def __init__(
        self,
        simulation: Simulation,
        robot: Robot,
        points: int,
        *,
        world: WorldChoice | Sequence[WorldChoice],
        camera_mount: str | Sequence[str],
        perturbations: Any,
        redraw: str,
        keep_in_view: bool,
    ) -> None:
        self.simulation, self.robot = simulation, robot
        self.rows = rows = simulation.rows
        self.mounts = robot.mounts(camera_mount)
        motors = len(robot.motors)
        self.motors = MotorMap(rows, robot)
        self._motor_errors = MotorErrors(rows, motors)
        self._workspaces = Workspaces(rows, robot, self.mounts, points // 2)
        self._scheduler = PerturbationScheduler(
            rows, perturbations, robot, self.mounts, keep_in_view, self.as_seen, self.can_begin
        )
        self._choices = world_choices(world, rows)
        self.register_bound = max(choice.register_bound for choice in self._choices)
        self._registers = Registers(self.motors, self.register_bound)
        self.registers = self._registers.executed
        self._redraws = redraw == "trial"
        self._keep_in_view = keep_in_view
        for choice in dict.fromkeys(self._choices):
            if isinstance(choice, World):
                self._check_world(choice)
                if self._redraws:
                    raise ValueError("redraw='trial' draws worlds: `world` must be a distribution")
        self._worlds: list[World | None] = [None] * rows
        self.points = np.zeros((rows, points, 2))
        self.visible = np.zeros((rows, points), bool)
        self.true_points = np.zeros((rows, points, 2))
        self.motions = np.zeros(rows, np.int64)
        self.trials = np.zeros(rows, np.int64)
        self._motions_before = np.zeros(rows, np.int64)
        self._begun = np.zeros(rows, bool)
        self._seeds: list[int | None] = [None] * rows
        self._latency = Latency(rows)
        self._all = np.arange(rows)

    @abstractmethod
    def observe(self) -> None:
        """Updates what the cameras see, after every row has moved or begun a trial."""

    @abstractmethod
    def next_objects(self, rows: NDArray[np.intp], given: Array | None) -> Array:
        """Where the objects of the next trial of some rows (n,) are: drawn, unless they are given."""

    def shown(self, row: int) -> tuple[Array, Flags, Array]:
        """What frames show of a row, by camera: gripper and object points (2, 2, 2), seen (2, 2), target.

        The target (1, 2, 2), around which the task is done, is the object, unless the task has another.
        """
        pairs = list(self.shown_points)
        points, visible = (each[row, pairs] for each in self.delivered[:2])
        return points.reshape(2, 2, 2), visible.reshape(2, 2), points.reshape(2, 2, 2)[1:]

    @abstractmethod
    def begun(self, rows: Rows) -> None:
        """These rows have begun a trial; the arms are at home."""

    @abstractmethod
    def close(self) -> None:
        """Frees what renders images; it comes back with the next image."""

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
        self._begun[row] = False
        self.seed_streams(row, seed)
        self.motions[row] = self.trials[row] = self._motions_before[row] = 0
        choice = self._choices[row]
        self.enter(row, choice if isinstance(choice, World) else self._draw_world(choice, row, seed, 0))

    def seed_streams(self, row: int, seed: int) -> None:
        """Gives all that draws numbers in `row` its streams."""
        self._seeds[row] = seed
        self._registers.seed(row, seed)
        self._motor_errors.seed(row, seed)
        self._scheduler.seed(row, seed)

    def enter(self, row: int, world: World) -> None:
        """Puts all of a row into `world`."""
        self._worlds[row] = world
        arm = self.motors, self._registers, self._motor_errors, self.simulation
        for part in (*arm, self._workspaces, self._latency):
            part.set_world(row, world)

    def _draw_world(self, distribution: WorldDistribution, row: int, seed: int, trial: int) -> World:
        def draw(attempt: int) -> World:
            return distribution.sample(seed, attempt, trial, self.robot)

        if not self._keep_in_view:
            return draw(0)
        return first_in_view(
            draw,
            self.robot,
            self.mounts,
            f"a {distribution.name} world",
            whole=True,
            also=self.also_in_view(row),
            also_asks=self.also_asks,
        )

    def as_seen(self, world: World) -> World:
        """A world as it is judged whether it is in view."""
        return world

    def also_in_view(self, row: int) -> Callable[[World], bool] | None:
        """What a drawn world must fulfil besides, if anything."""
        return None

    def can_begin(self, row: int) -> Callable[[World], bool] | None:
        """What of that a world must fulfil after a perturbation: else no trial could begin."""
        return None

    def set_world(self, row: int, world: World) -> None:
        """Puts `row` into `world` from now on; seeds then draw objects and noise only.

        Raises:
            ValueError: The world is not in view, or its registers go beyond the observation space.
            TypeError: It is no `World`.
        """
        if not isinstance(world, World):
            raise TypeError(f"set_world got {type(world).__name__}; it takes a calfree_gym.World")
        self._check_world(world)
        self._choices[row] = world
        self._scheduler.forget(row)
        self.enter(row, world)

    def begin_trial(self, rows: Rows, objects: Array | None = None) -> list[Applied]:
        """Sends the arms of `rows` home and places the next objects, or the given ones (n, ...).

        Where there is none, worlds stay as they were, and these rows must be reset again.

        Returns:
            The perturbations that were applied before; `observe` updates what is seen now.
        """
        indices = self._all[rows]
        self._begun[rows] = False
        with undivided(self, self._scheduler, indices.tolist()):
            if self._redraws:
                self._redraw(indices)
            applied = apply_due(self, self._scheduler, "trial", self.trials, indices)
            objects = self.next_objects(indices, objects)
        self._begun[rows] = True
        self.trials[rows] += 1
        self._motions_before[rows] = self.motions[rows]
        home = self._registers.home(rows)
        home = self._motor_errors.at_home(rows, home, self.trials, self.motions_of_trial)
        self.simulation.place(rows, self.motors.angles(home, rows), objects)
        self.points[rows] = 0.0
        self.begun(rows)
        return applied

    def check_begun(self, rows: Rows = slice(None)) -> None:
        """Raises ResetNeeded where no trial has begun in some of these rows."""
        if not self._begun[rows].all():
            raise gym.error.ResetNeeded("no trial has begun: call reset() first")

    def move(self, rows: Rows, words: Array) -> tuple[Array, list[Applied]]:
        """Executes one motion of control words (n, m) in `rows`.

        Returns:
            Robot time of the motions (n,) in seconds, and the perturbations that were applied before them.

        Raises:
            gymnasium.error.ResetNeeded: No trial has begun.
        """
        self.check_begun(rows)
        if self.may_stop_short:
            self._registers.depart(rows)
        applied = apply_due(self, self._scheduler, "motion", self.motions, self._all[rows])
        return self.execute(rows, words) + LOOK_SECONDS, applied

    @abstractmethod
    def execute(self, rows: Rows, words: Array) -> Array:
        """Executes control words (n, ...); how long the arms travel (n,), in seconds."""

    def targets(self, rows: Rows, words: Array) -> Array:
        """Adds control words (n, m) to the registers: joint positions (n, j) to which the arms are sent."""
        positions = self._registers.move(rows, words)
        self.motions[rows] += 1
        positions = self._motor_errors.after_a_motion(rows, positions, self.trials, self.motions_of_trial)
        return self.motors.angles(positions, rows)

    def stopped_short(self, row: int, share: float) -> None:
        """An arm stopped at this share of its way in joint positions: registers are of where it stands.

        Also where the world has changed right before the motion: the way begins where the arm stood.
        """
        self._motor_errors.stopped(row, self._registers.stop(row, share), share)

    def told_registers(self) -> Array:
        """Registers (N, m) as the controller gets them."""
        return self._registers.told(self.trials, self.motions_of_trial)

    @property
    def motions_of_trial(self) -> NDArray[np.int64]:
        """Motions of the present trial (N,)."""
        return self.motions - self._motions_before

    def home_seconds(self) -> Array:
        """Robot time (N,) of the way home from here, in seconds."""
        home = self.motors.joints(np.zeros_like(self.registers), slice(None))
        return self.simulation.travel(slice(None), home) + LOOK_SECONDS

    def get_state(self, row: int) -> dict[str, Any]:
        """All that the next motions of a row follow from, apart from the arguments."""
        parts = {name: state_of(getattr(self, name), row) for name in self.parts}
        delivered = tuple(each[row].copy() for each in self.delivered)
        return (
            state_of(self, row) | parts | {"arm": arm_state(self.robot, self.mounts), "delivered": delivered}
        )

    def set_state(self, row: int, state: RowState) -> None:
        """Brings a row into a state that `get_state` gave; `simulation.refresh` then updates positions.

        Raises:
            ValueError: It is the state of another arm, or of an environment that observes something else;
                the row is then as before.
        """
        check_state(state, self.robot, self.mounts, (*self.parts, "delivered"))
        if (world := state["_worlds"]) is not None:
            self._registers.check_fits(world)
        check_fits(self, row, state)
        for name in self.parts:
            check_fits(getattr(self, name), row, state[name], f"{name}.")
        if (found := len(state["delivered"])) != len(self.delivered):
            raise ValueError(f"the state delivers {found} arrays; it must be {len(self.delivered)}")
        if (seed := state["_seeds"]) is not None and seed != self._seeds[row]:
            self.seed_streams(row, seed)
        if world is not None and world is not self._worlds[row]:
            self.enter(row, world)
        self.true_points = self.true_points.copy()  # infos have given it away
        restore(self, row, state)
        for name in self.parts:
            restore(getattr(self, name), row, state[name])
        self.delivered = tuple(each.copy() for each in self.delivered)
        for delivered, of_row in zip(self.delivered, state["delivered"], strict=True):
            delivered[row] = of_row

    def _redraw(self, rows: NDArray[np.intp]) -> None:
        """Puts rows whose first trial is over into the next trial's world."""
        for row in rows[self.trials[rows] > 0]:
            choice, seed = self._choices[row], self._seeds[row] or 0
            if isinstance(choice, WorldDistribution):
                self._scheduler.forget(row)
                self.enter(row, self._draw_world(choice, row, seed, int(self.trials[row])))

    def _check_world(self, world: World) -> None:
        world.check_fits(self.robot)
        self._registers.check_fits(world)
        if self._keep_in_view:
            check_in_view(self.as_seen(world), self.robot, self.mounts)
