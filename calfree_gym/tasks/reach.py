"""Reaching: bring the gripper point to the object point in both images, and so in the world (paper, 3.1)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from calfree_gym.engine.arms import Arms, RowState
from calfree_gym.engine.config import Config, check_told
from calfree_gym.engine.sight import Tracker
from calfree_gym.engine.single import ArmEnv
from calfree_gym.engine.spaces import (
    GOALS,
    Floats,
    Observation,
    image_distances,
    joined,
    over_points,
    pixel_box,
    pixels_of,
    state_box,
    unit_box,
)
from calfree_gym.engine.vector import ArmVectorEnv
from calfree_gym.errors import check_choice, check_flag
from calfree_gym.geometry import Array, Flags, Rows
from calfree_gym.image import CAMERAS, PIXELS_PER_UNIT, lengths
from calfree_gym.pool import OfWorlds
from calfree_gym.robot.arms.arm import Arm, ArmChoice, robot_of
from calfree_gym.robot.arms.robot import Mounts, Robot
from calfree_gym.robot.arms.scene import RADIUS as MARK_RADIUS
from calfree_gym.robot.kinematic import KinematicSimulation
from calfree_gym.robot.objects import ALL, LinesOfSight, ObjectDraws
from calfree_gym.robot.simulation import DYNAMICS, ReachSimulation
from calfree_gym.vision.tracking.tracker import StereoTracker
from calfree_gym.world import World, WorldChoice

REDRAWN = 2
"""So many worlds without an object are drawn anew. Choice: one in 1,500 has none where images are seen; arms
that hide all objects take a search each time."""
IMAGES = ("pixels", "rgb", "depth")
"""Observations of images."""
FARTHEST = 100.0
"""Bound of depths (m)."""
NEAR = 1.01
"""What is hidden and this many tolerances away may show a rendezvous in single precision."""
BEYOND = 1.1
"""A hidden point that showed a rendezvous is shown this many tolerances away (a guard: in single precision,
too, it is none)."""


def rendezvous(distances: Floats, tolerance: float | np.float32) -> Floats:
    """Whether (...) all cameras see all that is to meet within `tolerance`, in image units."""
    return over_points(np.maximum, distances) <= tolerance


def kept_apart(points: Floats, visible: Floats, tolerance: float) -> Floats:
    """Points (N, p, 2) of which none that is hidden shows a rendezvous by where it was seen last.

    Where one would, it is moved to just beyond the tolerance, in one image: so reward and end follow from the
    points alone, and need all of them to be seen now.

    Args:
        points: What is moved, and as many points where it is to be, such as gripper left and right, object
            left and right, in image units.
        visible: Which of them are seen now (N, p).
        tolerance: Of the rendezvous, in image units.
    """
    if np.count_nonzero(visible) == visible.size:  # faster than all
        return points
    half = points.shape[1] // 2
    near = rendezvous(lengths(points[:, :half] - points[:, half:]), NEAR * tolerance)
    if not (mistaken := near & ~visible.all(1)).any():
        return points
    points = points.copy()
    for row in np.flatnonzero(mistaken):
        hidden = int(np.flatnonzero(~visible[row])[0])
        other = points[row, (hidden + half) % (2 * half)]
        away = np.where(other > 0, -1.0, 1.0) / np.sqrt(2)  # towards the middle: never out of the image
        points[row, hidden] = other + BEYOND * tolerance * away
    return points


class ReachingConfig(Config):
    """The arguments that tasks of reaching have besides those of every task."""

    arm: ArmChoice
    dynamics: str
    occlusion: bool

    def __post_init__(self) -> None:
        check_choice("observation", self.observation, (*GOALS, *IMAGES))
        check_choice("dynamics", self.dynamics, DYNAMICS)
        check_flag("occlusion", self.occlusion)
        if isinstance(self.arm, Mapping):
            self.arm = Arm.from_dict(self.arm)
        check_told(self.tell, tuple(PRIVILEGED))
        super().__post_init__()


@dataclass(kw_only=True)
class ReachConfig(ReachingConfig):
    """The arguments of `StereoArmEnv`."""

    world: WorldChoice | Sequence[WorldChoice] = "wild"
    arm: ArmChoice = "movemaster"
    camera_mount: str | Sequence[str] = "waist"
    observation: str = "points"
    tolerance_px: float = 4.0
    dynamics: str = "physics"
    perturbations: Any = None
    redraw: str = "never"
    pool: int | None = None
    terminate_on_success: bool = True
    keep_in_view: bool = True
    tell: Sequence[str] = ()
    truth: bool = True
    occlusion: bool = False
    image_size: int = 128
    reward: str = "sparse"
    render_mode: str | None = None
    width: int = 1080
    height: int = 720


class ReachArms(Arms):
    """N arms, two points each: `points` are gripper left, right, object left, right. See `Arms`."""

    task = "reach"
    config_of: ClassVar[type[Config]] = ReachConfig
    state_names: ClassVar[tuple[str, ...]] = (*Arms.state_names, "_drawn_at")
    also_asks = (
        "are the gripper's mark at home and an object hidden by nothing, as images and occlusion=True need"
    )
    config: ReachingConfig
    simulation: ReachSimulation

    def __init__(self, rows: int, threads: int, config: ReachingConfig) -> None:
        robot = robot_of(config.arm)
        self.config = config
        simulation = self._new_simulation(rows, robot, robot.mounts(config.camera_mount), threads)
        super().__init__(simulation, robot, 4, config)
        self.delivered = (self.points, self.visible, *self._sight.images)
        self._lines: LinesOfSight | None = None
        if config.occlusion or self._sight.renders:
            self._lines = LinesOfSight(self.simulation, MARK_RADIUS * robot.rig.scale)
        self._objects = self._new_objects()
        self._solved: list[tuple[World, bytes] | None] = [None] * rows
        self._object_registers = np.zeros_like(self.registers)
        self._drawn_at = np.full_like(self.registers, np.nan)

    def _new_simulation(self, rows: int, robot: Robot, mounts: Mounts, threads: int) -> ReachSimulation:
        kind = KinematicSimulation if self.config.dynamics == "kinematic" else ReachSimulation
        return kind(rows, robot, mounts, threads)

    def _new_objects(self) -> ObjectDraws:
        tolerance = float(self.tolerance)
        return ObjectDraws(self._workspaces, tolerance, self._keep_in_view, self._lines)

    def new_tracker(self) -> Tracker:
        return StereoTracker()

    def make_spaces(self) -> tuple[spaces.Dict[Any], spaces.Box[Any]]:
        config, robot = self.config, self.robot
        images = config.observation, config.image_size
        observed = observation_space(*images, config.tell, robot, self.register_bound)
        return observed, unit_box(len(robot.motors))

    def seed_streams(self, row: int, seed: int) -> None:
        super().seed_streams(row, seed)
        self._objects.seed(row, seed)

    def enter(self, row: int, world: World) -> None:
        self._objects.set_world(row, world)
        super().enter(row, world)

    def of_worlds(self) -> Sequence[OfWorlds]:
        """See `Arms`."""
        return (*super().of_worlds(), self._objects)

    def also_in_view(self, row: int) -> Callable[[World], bool] | None:
        """See `Arms`: a trial can begin, and nothing hides the gripper at home."""
        lines, can_begin = self._lines, self.can_begin(row)
        if lines is None or can_begin is None:
            return can_begin
        return lambda world: lines.gripper_in_sight(row, self.home_in(row, world)) and can_begin(world)

    def can_begin(self, row: int) -> Callable[[World], bool] | None:
        """See `Arms`: where something may hide them, not all objects are hidden."""
        return None if self._lines is None else self._has_object(row)

    def _has_object(self, row: int) -> Callable[[World], bool]:
        """Whether worlds have an object; of some that have none, the last is taken: drawing one tells why."""
        others = iter(range(REDRAWN))

        def has_object(world: World) -> bool:
            self.home_in(row, world)
            found = self._objects.exists(row) or self._objects.exists(row, ALL)
            return found or next(others, None) is None

        return has_object

    def home_in(self, row: int, world: World) -> Array:
        """Joint positions (j,) at home in a world, into which the row is put as far as this takes."""
        for part in (self._workspaces, self.simulation, self._objects):
            part.set_world(row, world)
        return self._workspaces.home(row)

    def next_objects(self, rows: NDArray[np.intp], given: Array | None) -> Array:
        """See `Arms`: points (n, 3) in m."""
        self._drawn_at[rows] = np.nan
        if given is not None:
            return given
        objects, self._drawn_at[rows] = self._objects.draw(rows, self.trials)
        return objects

    def execute(self, rows: Rows, joints: Array, words: Array) -> Array:
        return self.simulation.move(rows, joints)

    def in_sight(self) -> Flags | None:
        if self._lines is None or self._sight.finds:
            return None
        return np.stack([self._lines.in_sight(row) for row in range(self.rows)])

    def observe(self) -> None:
        images = self.look()
        points = kept_apart(self.points, self.visible, float(self.tolerance))
        self.delivered = self._latency.deliver(self.motions_of_trial, points, self.visible, *images)

    def outcome(self) -> tuple[Observation, NDArray[Any], NDArray[np.bool_]]:
        observed = observations(self)
        if self.config.observation in GOALS:
            return observed, *self.judged(observed["achieved_goal"], observed["desired_goal"])
        points, visible = self.delivered[:2]
        distances = lengths(points[:, :2] - points[:, 2:])
        return observed, distances, rendezvous(distances, self.tolerance) & visible.all(1)

    def judged(self, achieved: Any, desired: Any) -> tuple[Any, Any]:
        distances = image_distances(achieved, desired)
        return distances, rendezvous(distances, self.tolerance)

    def is_solved(self, truth: Mapping[str, Any]) -> bool:
        return bool(truth["error_px"] <= float(self.config.tolerance_px))

    def set_state(self, row: int, state: RowState) -> None:
        super().set_state(row, state)
        self._solved[row] = None

    def object_registers(self) -> Array:
        """Registers (N, m), as sums of words, at which the gripper is at the object, or as near as can be.

        Where several postures lead there, the one by which the object was drawn, which the cameras see.
        """
        objects = self.simulation.positions()[1]
        for row in range(self.rows):
            if self.needs_seed(row):
                continue
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


def observation_space(
    kind: str, image_size: int, tell: Sequence[str], robot: Robot, register_bound: float = 1.0
) -> spaces.Dict[Any]:
    """The observations of one arm.

    Args:
        kind: One of `GOALS` or `IMAGES`.
        image_size: Width and height in pixels of the images.
        tell: Names of privileged quantities, see `PRIVILEGED`.
        robot: The arm.
        register_bound: Of registers.
    """
    boxes: dict[str, spaces.Space[Any]] = {}
    registers, size = len(robot.motors), image_size
    if kind in GOALS:
        boxes |= {key: unit_box(4) for key in ("achieved_goal", "desired_goal")}
    elif kind == "pixels":
        boxes["pixels"] = pixel_box(size)
    elif kind == "rgb":
        boxes |= {f"{name}_image": spaces.Box(0, 255, (size, size, 3), np.uint8) for name in CAMERAS}
    else:
        boxes |= {f"{name}_depth": spaces.Box(0.0, FARTHEST, (size, size), np.float32) for name in CAMERAS}
    boxes["observation"] = state_box(4 * (kind in GOALS), registers, 0, register_bound)
    for name in tell:
        quantity = PRIVILEGED[name]
        bound = quantity.bound(robot, register_bound)
        boxes[name] = spaces.Box(-bound, bound, (quantity.size(robot),), np.float32)
    return spaces.Dict(boxes)


def observations(arms: ReachArms) -> Observation:
    """What all rows deliver now, batched."""
    kind = arms.config.observation
    registers = arms.told_registers()
    points, visible, *images = arms.delivered
    observed: Observation
    if kind in GOALS:
        goals = points.astype(np.float32).reshape(-1, 8)
        state = joined(visible, registers)
        observed = {"achieved_goal": goals[:, :4], "desired_goal": goals[:, 4:], "observation": state}
    else:
        (stereo,) = images
        if kind == "pixels":
            observed = {"pixels": pixels_of(stereo)}
        else:
            what = "image" if kind == "rgb" else "depth"
            delivered = np.minimum(stereo, FARTHEST) if kind == "depth" else stereo.copy()
            observed = {f"{name}_{what}": delivered[:, i] for i, name in enumerate(CAMERAS)}
        observed["observation"] = registers.astype(np.float32)
    for name in arms.config.tell:
        observed[name] = PRIVILEGED[name].of(arms).astype(np.float32)
    return observed


class Privileged(NamedTuple):
    """A true quantity that a controller may get beside its image points, where it asks with `tell`.

    Attributes:
        size: How many numbers, for an arm.
        bound: Of their magnitude, for an arm whose registers have this bound.
        of: Gives them for all rows (N, size).
    """

    size: Callable[[Robot], int]
    bound: Callable[[Robot, float], float]
    of: Callable[[ReachArms], NDArray[np.float64]]


def joint_zeros(arms: ReachArms) -> NDArray[np.float64]:
    """Of all rows (N, k); zeros where a row was never in a world."""
    zeros = np.zeros((arms.rows, len(arms.robot.joints)))
    for row in range(arms.rows):
        if not arms.needs_seed(row):
            zeros[row] = arms.world(row).joint_zeros
    return np.clip(zeros, -np.pi, np.pi)


PRIVILEGED = {
    "joint_angles": Privileged(
        lambda robot: len(robot.built_home),
        lambda robot, _: max(2 * np.pi, 1.1 * float(np.abs(robot.stops).max())),  # repeatability passes stops
        lambda arms: arms.simulation.joints(),
    ),
    "joint_zeros": Privileged(
        lambda robot: len(robot.joints),
        lambda robot, _: np.pi,
        joint_zeros,
    ),
    "gripper_position": Privileged(
        lambda robot: 3,
        lambda robot, _: max(5.0, float(np.abs(robot.rig.target).max()) + 4 * robot.rig.scale),
        lambda arms: arms.simulation.positions()[0],
    ),
    "object_registers": Privileged(
        lambda robot: len(robot.motors), lambda robot, bound: bound, lambda arms: arms.object_registers()
    ),
}
"""True joint positions (rad or m; of the RV-M2 J1-J5), joint zeros (of the RV-M2 J1-J4), the gripper point in
the room (m), and the registers that bring the gripper to the object."""


class StereoArmEnv(ArmEnv, arms=ReachArms):
    """A robot arm with two cameras and no calibration, whose task is to reach an object.

    ## Description
    A robot arm is seen by two cameras. It must bring its gripper to an object. The controller sends one
    control word to each motor and gets image points back. Cameras, arm and motors are unknown to it: they are
    the hidden `World`. After V. Graefe, "Calibration-Free Robots" (1999).

    The tables below are those of the paper's arm, which has five joints and three motors. Any other, given as
    `arm`, has three to seven motors: so many words and registers.

    ## Action space
    `Box(-1, 1, (3,), float32)`: one control word each for the motors of waist, shoulder and elbow.

    | num | word | effect |
    |---|---|---|
    | 0 | waist | unknown sign and size, smooth, 0 moves nothing; adds up in a register, up to the stop |
    | 1 | shoulder | the same |
    | 2 | elbow | the same |

    One step is one motion, executed until the arm has settled. Words outside the box are clipped to it.

    ## Observation space
    A `Dict` of a goal environment. Image points are (x, y), x right and y down, +-1 the image border.

    | key | shape | content |
    |---|---|---|
    | achieved_goal | (4,) | the gripper's sensor vector: (xa, ya, xb, yb), cameras a (left) and b (right) |
    | desired_goal | (4,) | the object's sensor vector |
    | observation | (7,) | 1 where seen now: gripper left, right, object left, right; then 3 registers |

    Registers tell what was executed, as exactly as the world does. They are within +-1, or as far as words of
    the worlds that the environment is made with add up (`World.word_gain`).

    A point is seen if it is in front of a camera and inside its image; with `occlusion` also only where
    neither the arm nor a mark nor a thing in the way hides its marks. A point that is not seen keeps its last
    value of this trial; before it is first seen it is (0, 0), the centre. One that would show a rendezvous
    by that is moved to just beyond the tolerance.

    ## Images
    Other observations come from images, rendered through each camera's lens in the world's light.

    | observation | keys |
    |---|---|
    | "vision" | as above: the points that `calfree_gym.vision.StereoTracker` finds in images of 512 x 512 |
    | "pixels" | pixels (s, s, 6), uint8, left then right; observation (3,): the registers |
    | "rgb" | left_image, right_image (s, s, 3), uint8; observation (3,) |
    | "depth" | left_depth, right_depth (s, s), in m along the camera's axis; observation (3,) |

    s is `image_size`. With images, points are hidden as with `occlusion`; reward, end and `is_success` follow
    from the true points, where all are seen now, and there is no `compute_reward` (but with "vision").

    ## Rewards
    `CalFree/Reach-v0`: 0 on the motion that reaches the rendezvous, -1 on every other.
    `CalFree/ReachDense-v0`: minus the mean of both image distances, in image units. Both follow from the
    observed points, also where latency delivers them late.

    ## Starting state
    The arm is at home, with registers zero. The object is in the work space, and both cameras see it.
    `reset(seed=k)` draws the world (if `world` names a distribution), objects and noise from k.
    `reset()` places the next object in the same world. `reset(options={"object": (x, y, z)})` places it at
    this point (in m), seen or not, if it is within 2 m of the middle of the work space (of another arm:
    in proportion to its size).

    ## Episode end
    Terminated at the rendezvous: both observed image distances within `tolerance_px`, unless
    `terminate_on_success=False`. Truncated after `max_episode_steps` (60) motions.

    ## Information
    The same keys, shapes and types at every step and reset. `is_success`: the observed rendezvous (an array
    without axes). `robot_seconds`: the time that a real arm would need. `perturbed`: how many perturbations
    were applied before the motion (a drift counts once, at its first step); `env.unwrapped.applied` lists
    them, with all that they drew.
    `truth`, unless `truth=False`: for scoring only, never for a controller: `error_px` (larger noise-free
    image distance), `distance_mm`, `points` (8,) in image units, `gripper` and `object` (3,) in m, `joints`
    (5,) in rad (of another arm: its motors' joints).

    ## Arguments

    Args:
        world: A `World`, also as the dict of its `to_dict`, or the distribution to draw from: "nominal",
            "coarse", "wild", "rough", "wilder".
        arm: "movemaster" (the paper's), a `calfree_gym.Arm`, or a mapping of its arguments.
        camera_mount: "waist" (cameras on the body that the first motor moves, turning with it: the object
            then moves in the images, and hindsight relabelling is not valid), "stand" (in the room), the name
            of a body, or a pair of these, left and right.
        observation: "points", "vision", "pixels", "rgb" or "depth", see above.
        tolerance_px: Image distance of the rendezvous, in pixels of 512.
        dynamics: "physics", or "kinematic": the arm is placed where physics would settle.
        perturbations: A schedule, `[{"at": {"motion": 2000}, "do": {"type": "camera_roll"}}]`, see
            `calfree_gym.perturbations.parse_schedule`; the types and their settings are the classes of
            `calfree_gym.perturbations`.
        redraw: "never", or "trial": every trial in a new world, if `world` is a distribution.
        pool: With redraw "trial", the worlds of the seeds from 0 on, so many of them, are drawn once, and
            every trial is in one of these: training over worlds, as fast as in one. Test in worlds of other
            seeds.
        terminate_on_success: Whether the rendezvous ends the trial.
        keep_in_view: Whether worlds, perturbations and objects that the cameras do not see are drawn again.
        tell: Privileged quantities, as further observation keys: "joint_angles" (5,) and "joint_zeros" (4,)
            in rad (of another arm: its motors' joints; m where they slide), "gripper_position" (3,) in m,
            "object_registers" (3,): those that reach the object.
        truth: Whether `info` holds `truth`. A step is faster without it.
        occlusion: Whether points can be hidden. Then both cameras see all of the marks at home and at the
            rendezvous: worlds and objects are drawn again until they do. Always so where images are rendered.
        image_size: Width and height in pixels of "pixels", "rgb" and "depth".
        reward: "sparse" or "dense".
        render_mode: None, "rgb_array", or "human": MuJoCo's viewer.
        width: Of a frame, in pixels.
        height: Of a frame, in pixels: even, and at most the width.

    Raises:
        ValueError: An argument is not allowed, the arm cannot be used, or the given world is not in view.

    ## Version history
    v0: first version.
    """


class StereoArmVectorEnv(ArmVectorEnv, arms=ReachArms):
    """Many stereo arms stepped together by MuJoCo's threads; row i is `StereoArmEnv` reset with seed + i.

    Each row counts its own motions and trials, and perturbations are applied by these counts.

    Args:
        num_envs: Rows.
        max_episode_steps: Motions after which a trial is truncated; -1: never.
        autoreset_mode: Of `gymnasium.vector.AutoresetMode`. NEXT_STEP: a row whose trial is over begins the
            next one at the next step, which ignores its action. SAME_STEP: at once; its last observation is
            in `infos["final_obs"][row]`. DISABLED: by `reset(options={"reset_mask": ...})`.
        threads: Threads of the simulation (0: all cores); they change no number.
        world: As for `StereoArmEnv`, or a list of one a row.
        **arguments: As for `StereoArmEnv`.
    """
