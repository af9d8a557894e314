"""N arms, each in its own world and at its own trial: the engine under every task, and its states.

One motion, from top to bottom: `Arms.move` applies the perturbations that are due, adds control words to the
registers, makes joint positions of these, and has the task `execute` them; `Arms.observe` then looks.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, ClassVar, Protocol

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from calfree_gym.engine.config import Config
from calfree_gym.engine.sight import ObservationQueues, Sight, Tracker, sight_of
from calfree_gym.engine.spaces import Observation, placed_objects
from calfree_gym.geometry import ONE_MORE, ZERO, Array, Flags, Rows
from calfree_gym.image import IMAGE_UNIT, LOOK_SECONDS, inside
from calfree_gym.perturbations.schedule import Applied, PerturbationScheduler
from calfree_gym.pool import OfWorlds, WorldPool
from calfree_gym.robot.arms.robot import Mounts, Robot
from calfree_gym.robot.motors import MotorErrors, Registers
from calfree_gym.robot.simulation import Simulation
from calfree_gym.robot.workspace import Workspaces, first_in_view
from calfree_gym.streams import MotionNumbers
from calfree_gym.world import World, WorldDistribution, world_choices

RowState = Mapping[str, Any]
"""Numbers, arrays and frozen values of one row; it shares nothing with the environment that it came from."""


class HasState(Protocol):
    """A part of N rows.

    Attributes:
        state_names: Names of the arrays and lists whose entries, one a row, are its state.
    """

    state_names: ClassVar[tuple[str, ...]]


def state_of(part: HasState, row: int) -> dict[str, Any]:
    """The state of a row of a part."""
    return {name: _own(getattr(part, name)[row]) for name in part.state_names}


def restore(part: HasState, row: int, state: RowState) -> None:
    """Brings a row of a part into a state that `state_of` gave."""
    for name in part.state_names:
        getattr(part, name)[row] = _own(state[name])


def _own(value: Any) -> Any:
    return value.copy() if hasattr(value, "copy") else value


def arm_state(robot: Robot, mounts: Mounts) -> dict[str, Any]:
    """By what the state of an arm is told from that of another."""
    links = dict(zip(robot.links, robot.lengths.tolist(), strict=True))
    return {"motors": robot.motors, "links": links, "camera mounts": mounts}


def check_state(state: RowState, robot: Robot, mounts: Mounts, parts: Sequence[str]) -> None:
    """Raises where something is no state of a row with this arm, or has not all of its parts.

    Raises:
        ValueError: It is none, or that of another arm; says what was found and what is allowed.
    """
    if not isinstance(state, Mapping) or not {"arm", *parts} <= state.keys():
        found = repr(state)
        raise ValueError(
            f"the state is {found[:100] + '...' * (len(found) > 100)}; it must be what get_state() gave"
        )
    for name, here in arm_state(robot, mounts).items():
        if (there := state["arm"].get(name)) != here:
            raise ValueError(f"the state is of another arm: its {name} are {there}; here they are {here}")


def check_fits(part: HasState, row: int, state: RowState, prefix: str = "") -> None:
    """Raises where a state is not that of such a part of a row.

    Args:
        part: The part.
        row: The row.
        state: Its state.
        prefix: Of the names that errors tell.

    Raises:
        ValueError: An entry is missing, or of another shape; says which.
    """
    for name in part.state_names:
        if name not in state:
            raise ValueError(f"the state has no {prefix}{name}: its environment observes something else")
        found, here = (getattr(each, "shape", ()) for each in (state[name], getattr(part, name)[row]))
        if found != here:
            raise ValueError(f"the state's {prefix}{name} has shape {found}; it must have {here}")


Events = dict[str, NDArray[Any]]
"""What infos tell of the last motion: arrays (N,)."""

MM = 1000.0


class Arms(ABC):
    """N arms with stereo cameras at one task, stepped together.

    A task says what its arguments are, of which points its cameras tell, where its objects are, what a motion
    does, what is observed, and when it is done.

    Attributes:
        registers: Sums of what was executed since home (N, m), in [-1, 1].
        register_bound: Registers are told within +- this.
        points: Image points (N, p, 2) as last seen, left and right of each point in turn.
        visible: Which of them (N, p) the last observation saw.
        in_view: Which of them (N, p) are inside the images, and nothing stands before them.
        delivered: Image points (N, p, 2), flags (N, p) and what else is observed (N, ...), as the controller
            gets them: delayed where there is latency.
        true_points: Where noise-free cameras see them now (N, p, 2), not clipped to the image.
        tolerance: Image distance within which the task is done, in image units.
        motions: Motions since reset with a seed (N,).
        motions_of_trial: Of these, those of the present trial (N,).
        trials: Trials begun since reset with a seed (N,).

    Args:
        simulation: Of the N arms.
        robot: The arm.
        points: p.
        config: The arguments of the environment.

    Raises:
        ValueError: An argument is unknown, or a given world is not in view.
    """

    task: ClassVar[str]
    """What is asked, by the name that agents have for it."""
    config_of: ClassVar[type[Config]]
    """The arguments of its environments."""
    state_names: ClassVar[tuple[str, ...]] = (
        *("_choices", "_seeds", "_worlds", "motions", "trials", "motions_of_trial"),
        *("registers", "points", "visible", "true_points", "_begun"),
    )
    parts: ClassVar[tuple[str, ...]] = (
        *("simulation", "_registers", "_motor_errors", "_latency", "_scheduler", "_sight"),
    )
    """Names of what has a state of its own."""
    may_stop_short: ClassVar[bool] = False
    """Whether something may stop an arm on its way, see `stopped_short`."""
    shown_points: ClassVar[tuple[int, int, int, int]] = (0, 1, 2, 3)
    """Which of the image points are the gripper's and the object's, left and right of each."""
    also_asks: ClassVar[str] = ""
    """What `also_in_view` asks, in words."""
    delivered: tuple[NDArray[Any], ...]

    def __init__(self, simulation: Simulation, robot: Robot, points: int, config: Config) -> None:
        self.config = config
        self.simulation, self.robot = simulation, robot
        self.rows = rows = simulation.rows
        self.mounts = robot.mounts(config.camera_mount)
        self.tolerance = np.float32(config.tolerance_px * IMAGE_UNIT)
        motors = len(robot.motors)
        self._motor_errors = MotorErrors(rows, motors)
        self._workspaces = self.new_workspaces(rows, points // 2)
        self.motors = self._workspaces.motors
        keep_in_view = config.keep_in_view
        self._judge = self.new_workspaces(1)
        self._scheduler = PerturbationScheduler(
            rows,
            config.perturbations,
            robot,
            self.mounts,
            keep_in_view,
            self.as_seen,
            self.can_begin,
            self._judge,
        )
        self._choices = world_choices(config.world, rows)
        self._registers = self.new_registers(max(choice.register_bound for choice in self._choices))
        self.register_bound = self._registers.bound
        self.registers = self._registers.executed
        self._redraws, self._keep_in_view = config.redraw == "trial", keep_in_view
        for choice in dict.fromkeys(self._choices):
            if isinstance(choice, World):
                self._check_world(choice)
                if self._redraws:
                    raise ValueError("redraw='trial' draws worlds: `world` must be a distribution")
            elif config.pool is not None and choice != self._choices[0]:
                raise ValueError("a pool has worlds of one distribution; `world` names several")
        self._worlds: list[World | None] = [None] * rows
        self.points = np.zeros((rows, points, 2))
        self.visible = self.in_view = np.zeros((rows, points), bool)
        self.true_points = np.zeros((rows, points, 2))
        self.motions = np.zeros(rows, np.int64)
        self.trials = np.zeros(rows, np.int64)
        self.motions_of_trial = np.zeros(rows, np.int64)
        self._begun = np.zeros(rows, bool)
        self._seeds: list[int | None] = [None] * rows
        self._latency = ObservationQueues(rows)
        images = config.observation, config.image_size, self.new_tracker
        self._sight: Sight = sight_of(simulation, robot.rig, points, *images)
        self._moved = np.zeros(rows, bool)
        self._all, self._nowhere = np.arange(rows), np.zeros(rows, bool)
        self._pool: WorldPool | None = None
        self._draws = MotionNumbers(rows, "pool", (), normal=False)

    def new_workspaces(self, rows: int, points: int = 2) -> Workspaces:
        """What so many robots reach and see; each of their cameras sees so many points."""
        return Workspaces(rows, self.robot, self.mounts, points)

    def new_registers(self, bound: float) -> Registers:
        """What counts the words that are executed; the worlds' own bound is this."""
        return Registers(self.motors, bound)

    @abstractmethod
    def new_tracker(self) -> Tracker:
        """What finds the points of one arm in images."""

    @abstractmethod
    def make_spaces(self) -> tuple[spaces.Dict[Any], spaces.Box[Any]]:
        """Observations and actions of one arm."""

    def objects_of(self, options: dict[str, Any] | None) -> Array | None:
        """The objects of reset's options (N, ...), points (N, 3) in m unless told; or None without them."""
        return placed_objects(options, self.rows, self.robot)

    @abstractmethod
    def next_objects(self, rows: NDArray[np.intp], given: Array | None) -> Array:
        """Where the objects of the next trial of some rows (n,) are: drawn, unless they are given."""

    def begun(self, rows: Rows) -> None:  # noqa: B027
        """These rows have begun a trial; the arms are at home."""

    @abstractmethod
    def execute(self, rows: Rows, joints: Array, words: Array) -> Array:
        """Sends the arms of `rows` to joint positions (n, j); how long they travel (n,), in seconds.

        Words (n, ...) are those of the motion: a task may have more of them than the arm has motors.
        """

    @abstractmethod
    def observe(self) -> None:
        """Updates what is delivered, after every row has moved or begun a trial: by `look`."""

    @abstractmethod
    def outcome(self) -> tuple[Observation, NDArray[Any], NDArray[np.bool_]]:
        """The last observation: batched observations, image distances (N, 2), and success (N,)."""

    @abstractmethod
    def judged(self, achieved: Any, desired: Any) -> tuple[Any, Any]:
        """Image distances (..., 2) of goals (..., g), and whether the task is done (...); pure."""

    @abstractmethod
    def error_px(self) -> Array:
        """Noise-free image distances (N,) in pixels of what is moved from where it is to be, the larger."""

    def truth(self) -> dict[str, Any]:
        """What is true of all rows: arrays (N, ...)."""
        gripper, object_ = self.simulation.positions()
        return {
            "error_px": self.error_px(),
            "distance_mm": MM * np.sqrt(np.square(gripper - object_).sum(-1)),
            "points": self.true_points.reshape(self.rows, -1),
            "gripper": gripper,
            "object": object_,
            "joints": self.simulation.joints(),
        }

    @abstractmethod
    def is_solved(self, truth: Mapping[str, Any]) -> bool:
        """Whether the truth of one arm says that the task is done."""

    def events(self) -> Events:
        """What else infos tell of the last motion."""
        return {}

    def cut_short(self, events: Events) -> NDArray[np.bool_]:
        """Where (N,) the trial cannot go on, by what `events` tells."""
        return self._nowhere

    def in_sight(self) -> Flags | None:
        """Which points (N, p) nothing hides from a camera, where that matters."""
        return None

    def as_seen(self, world: World) -> World:
        """A world as it is judged whether it is in view."""
        return world

    def also_in_view(self, row: int) -> Callable[[World], bool] | None:
        """What a drawn world must fulfil besides, if anything."""
        return None

    def can_begin(self, row: int) -> Callable[[World], bool] | None:
        """What of that a world must fulfil after a perturbation: else no trial could begin."""
        return None

    def shown(self, row: int) -> tuple[Array, Flags, Array]:
        """What frames show of a row, by camera: gripper and object points (2, 2, 2), seen (2, 2), target.

        The target (1, 2, 2), around which the task is done, is the object, unless the task has another. All
        are copies.
        """
        pairs = list(self.shown_points)
        points, visible = (each[row, pairs] for each in self.delivered[:2])
        return points.reshape(2, 2, 2), visible.reshape(2, 2), points.reshape(2, 2, 2)[1:]

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
        self.motions[row] = self.trials[row] = self.motions_of_trial[row] = 0
        choice = self._choices[row]
        with self._undivided([] if self._worlds[row] is None else [row]):
            if isinstance(choice, World):
                self.enter(row, choice)
            elif self.config.pool is None:
                self.enter(row, self._draw_world(choice, row, seed, 0))
            else:
                self._take_from_pool(np.array([row]))

    def seed_streams(self, row: int, seed: int) -> None:
        """Gives all that draws numbers in `row` its streams."""
        self._seeds[row] = seed
        for part in (self._registers, self._motor_errors, self._scheduler, self._sight, self._draws):
            part.seed(row, seed)

    def enter(self, row: int, world: World) -> None:
        """Puts all of a row into `world`."""
        for part in (
            *(self._workspaces, self._registers, self._motor_errors, self.simulation),
            *(self._latency, self._sight),
        ):
            part.set_world(row, world)
        self.entered(row, world)

    def entered(self, row: int, world: World) -> None:
        """All of a row is in `world`."""
        self._worlds[row] = world
        self._moved[row] = True

    def of_worlds(self) -> Sequence[OfWorlds]:
        """All parts that follow worlds."""
        return (
            *(self._workspaces, self._workspaces.motors, self._workspaces.cameras, self._registers),
            *(self._motor_errors, self.simulation, self._latency, self._sight, self._sight.measurement),
        )

    def _draw_world(self, distribution: WorldDistribution, row: int, seed: int, trial: int) -> World:
        def draw(attempt: int) -> World:
            return distribution.sample(seed, attempt, trial, self.robot)

        if not self._keep_in_view:
            return draw(0)
        return first_in_view(
            draw,
            self._workspaces,
            row,
            f"a {distribution.name} world",
            whole=True,
            also=self.also_in_view(row),
            also_asks=self.also_asks,
        )

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
        with self._undivided(indices.tolist()):
            if self._redraws:
                self._redraw(indices)
            applied = self._apply_due("trial", self.trials, indices)
            objects = self.next_objects(indices, objects)
        self._begun[rows] = True
        self.trials[rows] += 1
        self.motions_of_trial[rows] = 0
        home = self._registers.home(rows)
        home = self._motor_errors.at_home(rows, home, self.trials, self.motions_of_trial)
        self.simulation.place(rows, self.motors.angles(home, rows), objects)
        self.points[rows] = 0.0
        self._sight.begin_trial(indices)
        self._moved[rows] = True
        self.begun(rows)
        return applied

    def _apply_due(self, clock: str, counts: NDArray[np.int64], rows: NDArray[np.intp]) -> list[Applied]:
        """Applies the events that are due in `rows` by "motion" or "trial"; so many (N,) are over."""
        if not (events := self._scheduler.events[clock]):
            return []
        due = [
            (place, event, row)
            for place, event in events
            for row in rows[event.is_due(counts[rows])].tolist()
        ]
        if not due:
            return []
        applied: list[Applied] = []
        worlds = {row: self.world(row) for *_, row in due}
        with self._undivided(worlds):
            for place, event, row in due:
                count = int(counts[row])
                worlds[row], perturbation = self._scheduler.apply(place, event, row, count, worlds[row])
                if perturbation is not None:
                    applied.append((row, perturbation))
            for row, world in worlds.items():
                self.enter(row, world)
        return applied

    @contextmanager
    def _undivided(self, rows: Iterable[int]) -> Iterator[None]:
        """Where an error leaves the block, worlds and schedules of these rows are as they were.

        So who catches it and goes on gets no event twice.
        """
        before = [(row, self.world(row), self._scheduler.kept(row)) for row in rows]
        try:
            yield
        except Exception:
            for row, world, kept in before:
                self.enter(row, world)
                self._scheduler.go_on_with(row, kept)
            raise

    def check_begun(self, rows: Rows = slice(None)) -> None:
        """Raises ResetNeeded where no trial has begun in some of these rows."""
        if np.count_nonzero(begun := self._begun[rows]) < len(begun):  # faster than all
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
        applied = self._apply_due("motion", self.motions, self._all[rows])
        positions = self._registers.move(rows, words[..., : len(self.robot.motors)])
        self.motions[rows] += ONE_MORE
        self.motions_of_trial[rows] += ONE_MORE
        positions = self._motor_errors.after_a_motion(rows, positions, self.trials, self.motions_of_trial)
        self._moved[rows] = True
        seconds = self.execute(rows, self.motors.angles(positions, rows), words)
        return seconds + LOOK_SECONDS, applied

    def look(self) -> tuple[NDArray[Any], ...]:
        """Takes in what the cameras see now; images, where they are delivered."""
        self.simulation.refresh()
        pixels, depth = self.simulation.pinhole_pixels()
        true, shown = self._workspaces.cameras.through_lens(pixels)
        visible = shown & (depth > ZERO) & inside(true)
        self.true_points = true
        if (in_sight := self.in_sight()) is not None:
            visible &= in_sight
        counts = self.trials, self.motions_of_trial
        self.in_view = visible
        seen, self.visible, *images = self._sight.look(true, visible, self._moved, *counts)
        self._moved[:] = False
        self.points = np.where(self.visible[:, :, None], seen, self.points)
        return tuple(images)

    def close(self) -> None:
        """Frees what renders images; it comes back with the next image."""
        self._sight.close()

    def stopped_short(self, row: int, share: float) -> None:
        """An arm stopped at this share of its way in joint positions: registers are of where it stands.

        Also where the world has changed right before the motion: the way begins where the arm stood.
        """
        self._motor_errors.stopped(row, self._registers.stop(row, share), share)

    def told_registers(self) -> Array:
        """Registers (N, m) as the controller gets them."""
        return self._registers.told(self.trials, self.motions_of_trial)

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
        self._moved[row] = False

    def _redraw(self, rows: NDArray[np.intp]) -> None:
        """Puts rows whose first trial is over into the next trial's world."""
        drawn = [isinstance(self._choices[row], WorldDistribution) for row in rows.tolist()]
        rows = rows[(self.trials[rows] > 0) & drawn]
        for row in rows.tolist():
            self._scheduler.forget(row)
            choice, seed = self._choices[row], self._seeds[row] or 0
            if self.config.pool is None and isinstance(choice, WorldDistribution):
                self.enter(row, self._draw_world(choice, row, seed, int(self.trials[row])))
        if self.config.pool is not None and len(rows):
            self._take_from_pool(rows)

    def _take_from_pool(self, rows: NDArray[np.intp]) -> None:
        """Puts rows into worlds of the pool: any, by the row's seed and trial."""
        size = self.config.pool
        assert size is not None
        if self._pool is None:
            self._pool = WorldPool(size, self.of_worlds())
        pool = self._pool
        shares = self._draws.at(np.zeros_like(self.trials), self.trials)[rows]
        places = (shares * size).astype(np.intp)
        for row, place in zip(rows.tolist(), places.tolist(), strict=True):
            if pool.worlds[place] is None:
                choice = self._choices[row]
                assert isinstance(choice, WorldDistribution)
                world = self._draw_world(choice, row, place, 0)
                self.enter(row, world)
                pool.keep(place, world, row)
        pool.put(rows, places)
        for row, place in zip(rows.tolist(), places.tolist(), strict=True):
            self.entered(row, pool.worlds[place])

    def _check_world(self, world: World) -> None:
        world.check_fits(self.robot)
        self._registers.check_fits(world)
        if self._keep_in_view:
            self._judge.set_world(0, self.as_seen(world))
            self._judge.check_in_view(0)
