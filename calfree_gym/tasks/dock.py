"""Docking: bring a mobile base to its dock, by marks that are to meet in the images of its own cameras."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, cast

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from calfree_gym.engine.arms import LOOK_SECONDS, MM, Arms
from calfree_gym.engine.config import Config, check_told
from calfree_gym.engine.single import ArmEnv
from calfree_gym.engine.spaces import (
    GOALS,
    Observation,
    given_option,
    image_distances,
    joined,
    state_box,
    unit_box,
)
from calfree_gym.engine.vector import ArmVectorEnv
from calfree_gym.errors import check_choice, check_whole
from calfree_gym.geometry import Array, Flags, Rows
from calfree_gym.image import PIXELS_PER_UNIT, lengths
from calfree_gym.robot.arms.robot import Robot
from calfree_gym.robot.docking.base import BASES, MARKS, MOST_CAMERAS, WHEEL_RADIUS, Base
from calfree_gym.robot.docking.berths import DOCKED_DEGREES, DOCKED_M, Berths
from calfree_gym.robot.docking.driven import DrivenSimulation
from calfree_gym.robot.docking.simulation import RollingSimulation
from calfree_gym.robot.docking.tagged import TaggedBerths
from calfree_gym.robot.docking.wheels import FARTHEST, Odometer
from calfree_gym.robot.simulation import DYNAMICS, Simulation
from calfree_gym.robot.workspace import Workspaces
from calfree_gym.streams import MotionNumbers
from calfree_gym.tasks.dock_frames import DockFrame, DockViewer
from calfree_gym.tasks.reach import kept_apart, rendezvous
from calfree_gym.vision.tracking.dock_tracker import DockTracker
from calfree_gym.world import World, WorldChoice

GOALS_OF_DOCKING = ("marks", "shown")
FARTHEST_TOLD = 1000.0
"""Privileged quantities are told within this, in m and rad (a guard)."""


@dataclass(kw_only=True)
class DockConfig(Config):
    """The arguments of `DockEnv`."""

    world: WorldChoice | Sequence[WorldChoice] = "wild"
    base: str = "differential"
    cameras: int = 1
    marks: int = len(MARKS)
    goal: str = "marks"
    observation: str = "points"
    tolerance_px: float = 2.5
    dynamics: str = "kinematic"
    perturbations: Any = None
    redraw: str = "never"
    pool: int | None = None
    terminate_on_success: bool = True
    keep_in_view: bool = True
    tell: Sequence[str] = ()
    truth: bool = True
    reward: str = "sparse"
    render_mode: str | None = None
    width: int = 1080
    height: int = 720
    camera_mount = "base"  # no argument

    def __post_init__(self) -> None:
        check_choice("base", self.base, BASES)
        check_choice("goal", self.goal, GOALS_OF_DOCKING)
        check_choice("observation", self.observation, GOALS)
        check_choice("dynamics", self.dynamics, DYNAMICS)
        check_whole("cameras", self.cameras, 1, MOST_CAMERAS)
        check_whole("marks", self.marks, 2, len(MARKS))
        check_told(self.tell, tuple(PRIVILEGED))
        super().__post_init__()


class DockArms(Arms):
    """N bases, each before its dock: `points` are the dock's marks, then the own marks. See `Arms`.

    Of each mark there is a point in each camera, in turn.
    """

    task = "dock"
    config_of = DockConfig
    state_names: ClassVar[tuple[str, ...]] = (*Arms.state_names, "_goal", "_shown")
    config: DockConfig
    _workspaces: Berths  # type: ignore[assignment]

    def __init__(self, rows: int, threads: int, config: DockConfig) -> None:
        self.base = Base(config.base, config.cameras, config.marks)
        physics = config.dynamics == "physics"
        self.rolling = (
            DrivenSimulation(rows, self.base, threads) if physics else RollingSimulation(rows, self.base)
        )
        self._half = config.marks * config.cameras
        motors = len(self.base.motors)
        self._slip_numbers = MotionNumbers(rows, "slip", (motors,), normal=True)
        # a base has what the engine asks of an arm, apart from its chain of joints
        simulation, robot = cast(Simulation, self.rolling), cast(Robot, self.base)
        super().__init__(simulation, robot, 2 * self._half, config)
        self.delivered = (self.points, self.visible)
        self._goal, self._shown = np.zeros((rows, self._half, 2)), np.zeros(rows, bool)

    def new_workspaces(self, rows: int, points: int = 2) -> Workspaces:
        """See `Arms`: what the cameras see of the docks."""
        berths = TaggedBerths if self.config.observation == "vision" else Berths
        return cast(Workspaces, berths(rows, self.base, self.mounts, float(self.tolerance)))

    def new_tracker(self) -> DockTracker:
        return DockTracker(self.config.marks)

    def new_registers(self, bound: float) -> Odometer:
        """See `Arms`."""
        return Odometer(self._workspaces.motors, FARTHEST)

    def make_spaces(self) -> tuple[spaces.Dict[Any], spaces.Box[Any]]:
        motors = len(self.base.motors)
        boxes: dict[str, spaces.Space[Any]] = {
            "achieved_goal": unit_box(2 * self._half),
            "desired_goal": unit_box(2 * self._half),
            "observation": state_box(2 * self._half, motors, 0, self.register_bound),
        }
        for name in self.config.tell:
            shape = PRIVILEGED[name](self).shape[1:]
            boxes[name] = spaces.Box(-FARTHEST_TOLD, FARTHEST_TOLD, shape, np.float32)
        return spaces.Dict(boxes), unit_box(motors)

    def seed_streams(self, row: int, seed: int) -> None:
        super().seed_streams(row, seed)
        self._slip_numbers.seed(row, seed)

    def seed(self, row: int, seed: int) -> None:
        super().seed(row, seed)
        self._shown[row] = False

    def set_world(self, row: int, world: World) -> None:
        super().set_world(row, world)
        self._shown[row] = False

    def _redraw(self, rows: NDArray[np.intp]) -> None:
        super()._redraw(rows)
        self._shown[rows] &= [isinstance(self._choices[row], World) for row in rows.tolist()]

    def objects_of(self, options: dict[str, Any] | None) -> Array | None:
        """The pose of reset's options (N, 3), or None without one.

        Raises:
            ValueError: It is no pose.
        """
        return given_option(options, "pose", self.rows, "(x, y, heading) in m and rad")

    def next_objects(self, rows: NDArray[np.intp], given: Array | None) -> Array:
        """See `Arms`: poses (n, 3) before the docks.

        Where a goal was not shown yet, it is, and where the trial begins at the dock.

        Raises:
            ValueError: From a given pose the dock is not seen, or from none that is drawn; or a goal cannot
                be shown.
        """
        berths, in_view = self._workspaces, self._keep_in_view
        if given is None:
            seeds = [self._seeds[row] or 0 for row in rows.tolist()]
            poses = berths.starts(seeds, self.trials[rows], rows, in_view)
        elif in_view and not (seen := berths.seen(given[:, None], rows)[:, 0]).all():
            raise ValueError(
                f"from the pose {given[~seen][0].tolist()} the dock is out of view; give another one, or "
                "keep_in_view=False"
            )
        else:
            poses = given
        if self.config.goal == "shown":
            self._show(rows[~poses.any(1) | ~self._shown[rows]])
        return poses

    def _show(self, shown: NDArray[np.intp]) -> None:
        """Shows these rows their goals.

        Raises:
            ValueError: A camera at the dock does not see all of its marks.
        """
        images, seen = self._workspaces.images(np.zeros((len(shown), 1, 3)), shown)
        if not seen.all() or np.abs(images).max(initial=0) > 1:
            raise ValueError(
                "goal='shown' shows the image of the dock's marks as it is seen at the dock; not all of them "
                "are in view there"
            )
        self._goal[shown], self._shown[shown] = images.reshape(len(shown), self._half, 2), True

    def execute(self, rows: Rows, joints: Array, words: Array) -> Array:
        slip = self._slip_numbers.at(self.trials, self.motions_of_trial)[rows]
        return self.rolling.roll(rows, joints, 1 + self.rolling.slip[rows] * slip)

    def observe(self) -> None:
        self.look()
        points, visible = self.points, self.visible
        if self.config.goal == "shown":
            points, visible = points.copy(), visible.copy()
            points[:, self._half :], visible[:, self._half :] = self._goal, True
        points = kept_apart(points, visible, float(self.tolerance))
        self.delivered = self._latency.deliver(self.motions_of_trial, points, visible)

    def outcome(self) -> tuple[Observation, NDArray[Any], NDArray[np.bool_]]:
        points, visible = self.delivered
        goals = points.astype(np.float32).reshape(self.rows, -1)
        achieved, desired = goals[:, : 2 * self._half], goals[:, 2 * self._half :]
        observed: Observation = {
            "achieved_goal": achieved,
            "desired_goal": desired,
            "observation": joined(visible, self.told_registers()),
        }
        for name in self.config.tell:
            told = np.clip(PRIVILEGED[name](self), -FARTHEST_TOLD, FARTHEST_TOLD)
            observed[name] = told.astype(np.float32)
        return observed, *self.judged(achieved, desired)

    def shown(self, row: int) -> tuple[Array, Flags, Array]:
        """See `Arms`: the dock's marks, then their goals (2 M, C, 2), seen (2 M, C); the goals (M, C, 2)."""
        points, seen = (each[row].copy() for each in self.delivered)
        points = points.reshape(2 * self.config.marks, self.config.cameras, 2)
        return points, seen.reshape(points.shape[:2]), points[self.config.marks :]

    def judged(self, achieved: Any, desired: Any) -> tuple[Any, Any]:
        distances = image_distances(achieved, desired)
        return distances, rendezvous(distances, self.tolerance)

    def error_px(self) -> Array:
        """Noise-free image distances (N,) in pixels of the mark that is farthest from its goal."""
        goals = self._goal if self.config.goal == "shown" else self.true_points[:, self._half :]
        return np.asarray(PIXELS_PER_UNIT * lengths(self.true_points[:, : self._half] - goals).max(-1))

    def truth(self) -> dict[str, Any]:
        pose = self.rolling.before_dock()
        return {
            "error_px": self.error_px(),
            "offset_mm": MM * np.hypot(pose[:, 0], pose[:, 1]),
            "heading_deg": np.degrees(np.abs(pose[:, 2])),
            "points": self.true_points.reshape(self.rows, -1),
            "pose": pose,
        }

    def is_solved(self, truth: Mapping[str, Any]) -> bool:
        return bool(truth["offset_mm"] <= MM * DOCKED_M and truth["heading_deg"] <= DOCKED_DEGREES)

    def home_seconds(self) -> Array:
        """That of a look: the next trial starts elsewhere, and who brings the base there is not asked."""
        return np.full(self.rows, LOOK_SECONDS)

    def wheels(self) -> Array:
        """What words do in all rows (N, 4 m): the arc (3,) of a word of 1 of each motor, then its curvatures.

        An arc is how far a base comes ahead and to the left, in m, and about, in rad, but for the curve and
        what `longest_motion` cuts off.
        """
        worlds = [None if self.needs_seed(row) else self.world(row) for row in range(self.rows)]
        motors = len(self.base.motors)
        told = np.zeros((self.rows, 4 * motors))
        for row, world in enumerate(worlds):
            if world is not None:
                executed = (1 - world.shortfall) * world.word_gain
                rolled = WHEEL_RADIUS * self.base.span * world.motor_sign * world.motor_gain * executed
                arcs = self.base.arc(np.diag(rolled), world.link_lengths)
                told[row] = np.concatenate([arcs.ravel(), world.motor_curvature])
        return told


PRIVILEGED = {
    "pose": lambda arms: arms.rolling.before_dock(),
    "wheels": DockArms.wheels,
}
"""True quantities (N, ...) that a controller may get, where it asks with `tell`."""


class DockEnv(ArmEnv, arms=DockArms):
    """A mobile robot with cameras and no calibration, whose task is to dock.

    ## Description
    A robot on wheels stands before its dock, and looks ahead by one or two cameras of its own. On its front
    it has four marks, two 0.45 m and two 0.8 m ahead of the camera, each a pair about its point; the dock has
    four alike, single ones. Docked, each of the dock's marks is in the middle of a pair. The controller sends
    one control word to each wheel's motor and gets image points back. Cameras, wheels, marks and dock are
    unknown to it: they are the hidden `World`. After V. Graefe, "Calibration-Free Robots" (1999), whose first
    example is a coarsely calibrated vehicle, and Cooperstock & Milios (1993).

    A base on two wheels has three freedoms and two motors: no word moves it sideways. One on omnidirectional
    wheels has three.

    ## Action space
    `Box(-1, 1, (2,), float32)`: one control word each for the left and the right wheel; with `base="omni"`
    three, left, right, rear. Sign and size of what a word does are unknown, smooth, and 0 moves nothing. All
    wheels take the same time in a constant ratio, so that a motion is one arc; it ends at rest. A word of 1
    rolls a wheel by 1 m, times its motor's unknown gain, of which the wheel's radius is a part.

    ## Observation space
    A `Dict` of a goal environment, of M marks (4) and C cameras (1). Image points are (x, y), x right and y
    down, +-1 the image border: of mark 0 in each camera, then of mark 1 in each, and so on. So
    `achieved_goal.reshape(M, C, 2)[k, c]` is mark k in camera c.

    | key | shape | content |
    |---|---|---|
    | achieved_goal | (2 M C,) | the dock's marks: the two near ones, right then left, and the two far ones |
    | desired_goal | (2 M C,) | the own marks in the same order; or the dock's as once shown, see Goals |
    | observation | (2 M C + m,) | 1 where seen now, of these 2 M C points; then the odometer's m numbers |

    The odometer tells, for each motor, the sum of the words that were executed since the trial began, as
    exactly as the world does, within +-60. It means no place. A point is seen if it is in front of a camera
    and inside its image. One that is not seen keeps its last value of this trial; before it is first seen it
    is (0, 0), the centre. One that would show a rendezvous by that is moved to just beyond the tolerance.

    ## Images
    With `observation="vision"` marks are found in images of 512 x 512 that the cameras render in the world's
    lens and light, by printed tags: one at each of the dock's marks, a pair about each of the robot's own.
    There what is hidden by another print is not seen, too. Points have no other noise than by the images.

    ## Rewards
    `CalFree/Dock-v0`: 0 on the motion that reaches the rendezvous, -1 on every other. `CalFree/DockDense-v0`:
    minus the mean of the 4 image distances (of each camera), in image units. Both follow from the observed
    points alone.

    ## Starting state
    0.3 to 1.5 m before where the dock stands as built, up to 0.5 m aside and 25 degrees turned, with the dock
    in view of all cameras. `reset(seed=k)` draws the world (if `world` names a distribution), starts and
    noise from k. `reset()` starts the next trial in the same world. `reset(options={"pose": (x, y,
    heading)})` puts the robot there before its dock, in m and rad: docked it is at (0, 0, 0), before it x is
    negative, and y is to the left. From there the dock must be in view, unless `keep_in_view=False`.

    ## Episode end
    Terminated at the rendezvous: every mark within `tolerance_px` of its goal in every camera, and all of
    them seen now, unless `terminate_on_success=False`. Truncated after `max_episode_steps` (60) motions.

    Worlds are such that a robot whose four marks all meet within the tolerance is within 2 cm and 2 degrees
    of the docked pose: others are drawn again. With fewer marks this is not so.

    ## Goals
    "marks": the robot's own marks, which its cameras see. A camera that is knocked sees both shifted.
    "shown": the image of the dock's marks, free of noise, as it was when the robot stood at the dock: when
    its first trial in a world began, or a trial that began at pose (0, 0, 0). It dies with the camera: after
    a knock, the same image is seen elsewhere.

    ## Information
    As in `StereoArmEnv`. `truth`: `error_px` (image distance of the mark that is farthest from its goal, free
    of noise), `offset_mm` and `heading_deg`, how far the robot is from the docked pose; `pose` (3,) in m and
    rad, as in reset's options; `points` (4 M C,) in image units. `is_solved(truth)`: within 20 mm and 2
    degrees.

    ## Arguments

    Args:
        world: A `World`, also as the dict of its `to_dict`, or the distribution to draw from: "nominal",
            "coarse" (a forward camera up to 20 degrees off in any direction), "wild", "rough".
        base: "differential" or "omni".
        cameras: 1 ("front") or 2 ("left", "right").
        marks: How many, 2 to 4: the near ones first.
        goal: "marks" or "shown", see above.
        observation: "points" or "vision", see above. With vision, worlds and starts are drawn again until all
            tags are seen whole, and large enough to be found.
        tolerance_px: Image distance of the rendezvous, in pixels of 512. From about 4 on, four marks may tell
            the docked pose too coarsely in all worlds: then none is found.
        dynamics: "kinematic": the robot follows the arc; or "physics": MuJoCo drives it there,
            within 5 mm and 1 degree of that in a motion of 30 cm or 40 degrees.
        perturbations, redraw, pool, terminate_on_success: As for `StereoArmEnv`. Perturbations of wheels and
            dock are `wheel_radius`, `track`, `slip` and `dock_moved`.
        keep_in_view: Whether worlds, perturbations and starts are drawn again from which the dock is not
            seen, or by which the docked pose is not.
        tell: Privileged quantities, as further observation keys: "pose" (3,), and "wheels" (4 m,): how
            far a word of 1 of each motor brings the base ahead, to the left (m) and about (rad); then the
            curvature of each, c in w + c w (w**2 - 1).
        truth, reward, render_mode, width, height: As for `StereoArmEnv`.

    Raises:
        ValueError: An argument is not allowed, or the given world is not in view; says how exactly its marks
            tell the docked pose.

    ## Version history
    v0: first version.
    """

    frame_of, viewer_of = DockFrame, DockViewer


class DockVectorEnv(ArmVectorEnv, arms=DockArms):
    """Many bases that dock, stepped together; row i is `DockEnv` reset with seed + i.

    Args:
        num_envs, max_episode_steps, autoreset_mode, threads: As for `StereoArmVectorEnv`.
        world: As for `StereoArmEnv`, or a list of one a row.
        **arguments: As for `DockEnv`.
    """

    frame_of, viewer_of = DockFrame, DockViewer
