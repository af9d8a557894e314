"""Grasping: hold the object, and lift it to a place in both images (paper, 3.1 and 3.5)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from calfree_gym.engine.arms import MM, Events, RowState
from calfree_gym.engine.config import Config
from calfree_gym.engine.single import ArmEnv
from calfree_gym.engine.spaces import (
    GOALS,
    Floats,
    Observation,
    image_distances,
    joined,
    pixel_box,
    pixels_of,
    state_box,
    unit_box,
)
from calfree_gym.engine.vector import ArmVectorEnv
from calfree_gym.errors import check_choice
from calfree_gym.geometry import Array, Flags, Rows
from calfree_gym.image import IMAGE_UNIT, PIXELS_PER_UNIT, lengths
from calfree_gym.robot.grasping.gripping_arm import STROKE, GrippingArm, TiltingArm
from calfree_gym.robot.grasping.held import HeldPlacing, HeldSimulation
from calfree_gym.robot.grasping.placing import InSight, Placed, Placing
from calfree_gym.robot.grasping.shapes import ShapeChoice, check_shape
from calfree_gym.robot.grasping.simulation import OBJECT, POINTS, GraspSimulation
from calfree_gym.tasks.contact import ContactArms
from calfree_gym.world import World, WorldChoice

OBSERVATIONS = (*GOALS, "pixels")
TABLE = np.array([[-0.32, -0.62], [0.92, 0.62]])
"""From where to where the table goes (m): (x, y)."""
LYING, ANY = "lying", "any"
ORIENTATIONS: dict[str, tuple[type[GrippingArm], Any, type[Placing]]] = {
    LYING: (GrippingArm, GraspSimulation, Placing),
    ANY: (TiltingArm, HeldSimulation, HeldPlacing),
}
"""Of things, as they lie on the table or held in the air: the arm, the physics, and where they are."""
GRIPPER, HELD = slice(0, 2), slice(2 * OBJECT, 2 * OBJECT + 2)
"""Where the points of the gripper and of the object stand among the image points."""
_BEFORE, _AFTER = slice(HELD.start), slice(HELD.stop, None)
"""Image points other than the object's, which is a goal of its own."""
LIFTED_MM = 50.0
"""An object is lifted, in truth, that is so high above where it lay, for a second."""
BLOCKED = 0.06
"""Jaws that stay open by this share more than they were told have something between them. Choice: on nothing
they close to a hundredth."""
MOVED = 8 * IMAGE_UNIT
"""The gripper has moved where its image point has moved so far, in one image. Choice: ten times the noise."""
ALIKE = 0.5
"""The object has moved with it where their image points differ by less than this share of the way. Derived: a
thing that stays differs by all of it, one that goes with it by none."""


def blocked(opening: Floats, register: Floats) -> Floats:
    """Whether (...) something is between jaws, by how far they are open (share), and their register (...)."""
    return opening - (1 - register) > BLOCKED


def held(blocked: Floats, before: Floats, gripper_way: Floats, object_way: Floats, seen: Floats) -> Floats:
    """Whether (N,) the gripper holds the object, as jaws and images tell.

    Where the gripper has hardly moved, or not all is seen, as before.

    Args:
        blocked: Whether (N,) something is between its jaws.
        before: Whether (N,) it held it before.
        gripper_way: Of its image points (N, 2, 2) in the last motion.
        object_way: Of the object's (N, 2, 2).
        seen: Whether (N,) all four were seen before and after.
    """
    far = np.maximum.reduce(lengths(gripper_way), -1)
    apart = np.maximum.reduce(lengths(object_way - gripper_way), -1)
    return blocked & np.where(seen & (far > MOVED), apart < ALIKE * far, before)


def place_distances(achieved: Floats, desired: Floats) -> Floats:
    """Distances (..., 2) in image units, per camera, of the object from where it is to be lifted to.

    Args:
        achieved: The object's sensor vector, and whether it is held (..., 5).
        desired: The wanted one, and 1 (..., 5).
    """
    return image_distances(achieved[..., :4], desired[..., :4])


def lifted(
    distances: Floats, achieved: Floats, desired: Floats, tolerance: float | np.float32
) -> NDArray[Any]:
    """Whether (...) the object is held, within `tolerance` of the wanted place in both images.

    Args:
        distances: What `place_distances` tells (..., 2).
        achieved: See `place_distances`.
        desired: See `place_distances`.
        tolerance: In image units.
    """
    near = np.maximum.reduce(distances, axis=-1) <= tolerance
    return near & (np.abs(achieved[..., 4] - desired[..., 4]) < 0.5)


@dataclass(kw_only=True)
class GraspConfig(Config):
    """The arguments of `GraspEnv`."""

    shape: ShapeChoice = None
    orientation: str = LYING
    world: WorldChoice | Sequence[WorldChoice] = "wild"
    camera_mount: str | Sequence[str] = "waist"
    observation: str = "points"
    image_size: int = 128
    tolerance_px: float = 24.0
    perturbations: Any = None
    redraw: str = "never"
    pool: int | None = None
    terminate_on_success: bool = True
    keep_in_view: bool = True
    truth: bool = True
    reward: str = "sparse"
    render_mode: str | None = None
    width: int = 1080
    height: int = 720

    def __post_init__(self) -> None:
        check_choice("observation", self.observation, OBSERVATIONS)
        check_shape(self.shape)
        check_choice("orientation", self.orientation, tuple(ORIENTATIONS))
        if self.orientation == ANY and self.observation != "points":
            raise ValueError(f"orientation='any' is observed by 'points' alone; found {self.observation!r}")
        super().__post_init__()


class GraspArms(ContactArms):
    """N arms, whose cameras see `robot.grasping.simulation.POINTS`.

    Attributes:
        jaws: Registers of the jaws (N,), from 0, open, to 1, closed.
        openings: How far jaws are open (N,), as a share.
        held: Whether the object is held (N,), as jaws and images tell.
        goals: Image points (N, 4) to which objects are to be lifted.
        forces: Largest force (N, 2) of the gripper on table and object in the last motion, in N.
        lifted: How high above where it lay the object stayed (N,) for a second, with something between the
            jaws, in m; else 0.
        off_table: Whether the object has left the table (N,).
    """

    task = "grasp"
    config_of = GraspConfig
    shown_points: ClassVar[tuple[int, int, int, int]] = (0, 1, 2 * OBJECT, 2 * OBJECT + 1)
    state_names: ClassVar[tuple[str, ...]] = (
        *ContactArms.state_names,
        *("jaws", "openings", "held", "goals", "forces", "lifted", "placed", "_waited"),
    )
    config: GraspConfig

    def __init__(self, rows: int, threads: int, config: GraspConfig) -> None:
        arm, simulation_of, placing_of = ORIENTATIONS[config.orientation]
        robot = arm()
        simulation = simulation_of(rows, robot, robot.mounts(config.camera_mount), threads)
        super().__init__(simulation, robot, 2 * len(POINTS), config)
        in_sight = InSight(self.simulation) if self._sight.renders else None
        things = config.shape, config.keep_in_view, in_sight
        self.placing = placing_of(robot, self._workspaces, *things)
        self.jaws, self.openings = np.zeros(rows), np.ones(rows)
        self.held, self._waited = np.zeros(rows, bool), np.zeros(rows, bool)
        self.goals, self.forces, self.lifted = np.zeros((rows, 4)), np.zeros((rows, 2)), np.zeros(rows)
        self.placed: list[Placed | None] = [None] * rows
        self._lay = np.zeros(rows)  # the height of what was placed
        self.delivered = (self.points, self.visible, self.held, *self._sight.images)

    def make_spaces(self) -> tuple[spaces.Dict[Any], spaces.Box[Any]]:
        registers, bound = len(self.robot.motors), self.register_bound
        flags, others = 2 * len(POINTS), 2 * (2 * len(POINTS) - 2)
        boxes: dict[str, spaces.Space[Any]]
        if self.config.observation in GOALS:
            boxes = {key: unit_box(5) for key in ("achieved_goal", "desired_goal")}
            boxes["observation"] = state_box(flags, registers, 2 + others, bound)
        else:
            boxes = {"pixels": pixel_box(self.config.image_size)}
            boxes["observation"] = state_box(0, registers, 2, bound)
        return spaces.Dict(boxes), unit_box(registers + 1)

    def objects_of(self, options: dict[str, Any] | None) -> Array | None:
        """See `Arms`: places (N, 2), or with an angle (N, 3), or poses (N, 7)."""
        return placed_things(options, self.rows, self.config.orientation)

    def entered(self, row: int, world: World) -> None:
        """See `Arms`: a thing keeps its shape, and gets the mass and the friction of the world."""
        super().entered(row, world)
        if (placed := self.placed[row]) is not None:
            self._weigh(row, placed)

    def serves(self, row: int, world: World) -> bool:
        """See `ContactArms`: things can be grasped there."""
        return self.placing.serves(row, world)

    def _weigh(self, row: int, placed: Placed) -> None:
        world = self.world(row)
        self.simulation.set_thing(row, placed.thing, float(world.object_mass), float(world.object_friction))
        self._lay[row] = placed.pose[2]

    def next_objects(self, rows: NDArray[np.intp], given: Array | None) -> Array:
        """See `Arms`: poses (n, 4) or (n, 7); given are places (n, 2), or with an angle (n, 3), or poses."""
        poses = []
        for i, row in enumerate(rows.tolist()):
            which = row, self._seeds[row] or 0, int(self.trials[row]), self.world(row)
            placed = self.placing.draw(*which) if given is None else self.placing.given(*which, given[i])
            self.placed[row] = placed
            self._weigh(row, placed)
            self.goals[row] = np.clip(placed.goal, -1, 1)
            poses.append(placed.pose)
        return np.array(poses)

    def begun(self, rows: Rows) -> None:
        """See `Arms`: the jaws are open."""
        self.jaws[rows], self.openings[rows], self.held[rows] = 0.0, 1.0, False
        self.forces[rows], self.lifted[rows], self._waited[rows] = 0.0, 0.0, False

    def execute(self, rows: Rows, joints: Array, words: Array) -> Array:
        """See `Arms`: with something between its jaws, an arm waits for a second after each motion."""
        indices, simulation = self._all[rows], self.simulation
        self.jaws[rows] = jaws = np.minimum(np.maximum(self.jaws[rows] + words[..., -1], 0.0), 1.0)
        seconds, motion = self.travelled(rows, joints, STROKE * (1 - jaws))
        self.forces[rows] = motion.forces
        self.openings[rows] = simulation.openings()[rows] / STROKE
        self._waited[rows] = False
        heights = simulation.heights()
        holding = indices[blocked(self.openings[rows], jaws) & ~simulation.diverged[rows]]
        if len(holding):
            forces, heights[holding] = simulation.wait(holding)
            simulation.recover()
            self.forces[holding] = np.maximum(self.forces[holding], forces)
            self.openings[holding] = simulation.openings()[holding] / STROKE
            self._waited[holding] = True
        waited = self._waited[rows] & ~simulation.diverged[rows]
        self.lifted[rows] = np.where(waited, heights[rows] - self._lay[rows], 0.0)
        return seconds + self._waited[rows]

    def observe(self) -> None:
        motions, before, saw = self.motions_of_trial, self.points, self.visible
        images = self.look()
        way, both = self.points - before, self.visible & saw
        self.held = held(
            blocked(self.openings, self.jaws) & (motions > 0),
            self.held,
            way[:, GRIPPER],
            way[:, HELD],
            np.logical_and.reduce(both[:, GRIPPER] & both[:, HELD], 1),
        )
        seen_now = self.points, self.visible, self.held, *images
        self.delivered = self._latency.deliver(motions, *seen_now)

    def outcome(self) -> tuple[Observation, NDArray[Any], NDArray[np.bool_]]:
        rows = self.rows
        points, visible, held, *images = self.delivered
        achieved = joined(points[:, HELD].reshape(rows, 4), held[:, None])
        desired = joined(self.goals, np.ones((rows, 1)))
        observed: Observation = {}
        openings = np.minimum(np.maximum(self.openings, 0.0), 1.0)
        felt = [self.told_registers(), self.jaws[:, None], openings[:, None]]
        if self.config.observation in GOALS:
            others = (points[:, part].reshape(rows, -1) for part in (_BEFORE, _AFTER))
            state = [visible, *felt, *others]
            observed |= {"achieved_goal": achieved, "desired_goal": desired}
        else:
            state, observed["pixels"] = felt, pixels_of(images[0])
        observed["observation"] = joined(*state)
        return observed, *self.judged(achieved, desired)

    def judged(self, achieved: Any, desired: Any) -> tuple[Any, Any]:
        distances = place_distances(achieved, desired)
        return distances, lifted(distances, achieved, desired, self.tolerance)

    def is_solved(self, truth: Mapping[str, Any]) -> bool:
        return bool(truth["lifted_mm"] >= LIFTED_MM)

    def truth(self) -> dict[str, Any]:
        return super().truth() | {"lifted_mm": MM * self.lifted}

    def events(self) -> Events:
        return {
            "force_table": self.forces[:, 0].copy(),
            "force_object": self.forces[:, 1].copy(),
            "off_table": self.off_table,
            "diverged": self.simulation.diverged.copy(),
        }

    def cut_short(self, events: Events) -> NDArray[np.bool_]:
        return events["off_table"] | events["diverged"]

    def set_state(self, row: int, state: RowState) -> None:
        super().set_state(row, state)
        if (placed := self.placed[row]) is not None:
            self._weigh(row, placed)

    def shown(self, row: int) -> tuple[Array, Flags, Array]:
        """See `Arms`: the target is where the object is to be lifted to."""
        return *super().shown(row)[:2], self.goals[row].copy().reshape(1, 2, 2)

    @property
    def off_table(self) -> Flags:
        """Whether the object of a row has left the table (N,)."""
        place = self.simulation.positions()[1][:, :2]
        outside = (place < TABLE[0]) | (place > TABLE[1])
        return outside[:, 0] | outside[:, 1]

    def error_px(self) -> Array:
        """Noise-free image distances (N,) in pixels of objects from where they are to be lifted to."""
        away = self.true_points[:, HELD] - self.goals.reshape(-1, 2, 2)
        return np.asarray(PIXELS_PER_UNIT * np.sqrt(np.square(away).sum(-1)).max(1))


def placed_things(
    options: dict[str, Any] | None, rows: int, orientation: str = LYING
) -> NDArray[np.float64] | None:
    """The place of the object in reset's options (rows, 2, 3 or 7), or None without one.

    Raises:
        ValueError: It is none; says what was found and what is allowed.
    """
    if not options:
        return None
    lying = orientation == LYING
    allowed = "(x, y) or (x, y, angle)" if lying else "(x, y, z, qw, qx, qy, qz)"
    if not isinstance(options, Mapping) or set(options) != {"object"}:
        raise ValueError(f"reset's options are {options!r}; allowed: {{'object': {allowed}}}")
    try:
        place = np.asarray(options["object"], np.float64)
    except (TypeError, ValueError):
        place = np.empty(0)
    sizes = (2, 3) if lying else (7,)
    if (
        place.shape not in [*((n,) for n in sizes), *((rows, n) for n in sizes)]
        or not np.isfinite(place).all()
    ):
        raise ValueError(f"options['object'] is {options['object']!r}; it must be {allowed}")
    return np.broadcast_to(place, (rows, place.shape[-1]))


class GraspEnv(ArmEnv, arms=GraspArms):
    """The paper's arm, with a gripper that can hold, whose task is to lift an object (paper, 3.1 and 3.5).

    ## Description
    An object lies on a table. The controller brings the gripper over it, turns the jaws, closes them and
    lifts the object to a place in both images. Cameras, arm, motors and the object's mass and friction are
    unknown to it: they are the hidden `World`. Physics is whole: gravity, contacts, friction.

    ## Action space
    `Box(-1, 1, (5,), float32)`: one control word each, as in `StereoArmEnv`; all add up in registers.

    | num | word | effect |
    |---|---|---|
    | 0-2 | waist, shoulder, elbow | unknown sign and size |
    | 3 | wrist_turn | turns the gripper about its axis (J5), by unknown sign and size |
    | 4 | jaws | + closes: register 0 is open, 1 closed |

    With `orientation="any"` there are six: 3 is wrist_tilt (J4), 4 wrist_turn, 5 jaws. Nothing then keeps the
    gripper vertical.

    One step is one motion. Its targets travel with least jerk, and the gripper at 0.4 m/s at most along the
    straight line between the ends of its way. An arm that presses with more than 12 N goes back about half of
    the way that it has come: registers tell where it stands. With something between its jaws it waits for a
    second after each motion.

    ## Observation space
    A `Dict` of a goal environment. Image points are (x, y), x right and y down, +-1 the image border.

    | key | shape | content |
    |---|---|---|
    | achieved_goal | (5,) | the object's sensor vector: (xa, ya, xb, yb); 1 where it is held |
    | desired_goal | (5,) | the sensor vector to which it is to be lifted, fixed in the images; 1 |
    | observation | (56,), with six words (57,) | see below |

    `observation`: 18 flags, 1 where a point is seen now, left and right of: gripper point, gripper base,
    lower ends of jaw 1 and 2, edges 1 and 2, object, ends 1 and 2 of its main axis; registers; how far the
    jaws are open, 0 to 1; and 16 image points (x, y), as the flags but without the object's.
    With "points" they are where projection puts them, nothing hides them, and an upright cylinder's and a
    sphere's main axis is upright. With "vision" a `GraspTracker` finds them in images of 512 pixels: it sees
    the gripper's coloured marks and the object's colour, of which the main axis is the longest way across.
    With "pixels" there are `pixels` (s, s, 6), uint8, both images, left before right, and `observation` (6,):
    registers and opening. Success then is by the true points, and there is no `compute_reward`.

    *Held* is what jaws and images tell: the jaws stay open though they should have closed, the object's
    image has moved with the gripper's, and so it has stayed for a second.

    ## Rewards
    `CalFree/Grasp-v0`: 0 on the motion after which the object is held within `tolerance_px` of the desired
    place in both images, -1 on every other. `CalFree/GraspDense-v0`: minus the mean of both distances from
    it, in image units. The place is fixed in the images: hindsight relabelling is valid on both mounts.

    ## Starting state
    The arm is at home, jaws open. The object lies where both cameras see it (with "vision" nothing hides it
    then), and where the gripper can grasp it from above. `reset(seed=k)` draws the world, objects and noise
    from k; `reset()` places the next object in the same world. `reset(options={"object": (x, y)})` places it
    there (m), `(x, y, angle)` also at an angle (rad) about the vertical.

    With `orientation="any"` the object is held in the air, 10 to 13 cm above the table, at any orientation at
    which the gripper can grasp it. What holds it gives way to 5 N and 0.2 N m, and lets go when jaws have
    closed on it. `reset(options={"object": (x, y, z, qw, qx, qy, qz)})` gives its pose.

    ## Episode end
    Terminated with the object held at its place, unless `terminate_on_success=False`. Truncated after
    `max_episode_steps` (60) motions, where the object has left the table, and where the physics diverged.

    ## Information
    As in `StereoArmEnv`; besides `force_table` and `force_object`: the largest force (N) of one contact of
    the gripper in the motion; `off_table` and `diverged`. `truth`: `error_px`: of the object from its place;
    `lifted_mm`: how high above where it lay the object stayed for a whole second, with something between the
    jaws (else 0).

    Args:
        shape: "cylinder", "sphere", "box", "bar" or "l_shape"; a mapping of `shape` and all its sizes in m,
            such as {"shape": "sphere", "radius": 0.02}; or None: any.
        orientation: "lying": things lie or stand on the table; "any": they are held in the air (paper, 3.5),
            and `observation` is "points".
        world, camera_mount, perturbations, redraw, pool: As for `StereoArmEnv`.
        terminate_on_success, keep_in_view, truth, reward: As for `StereoArmEnv`.
        render_mode, width, height: As for `StereoArmEnv`.
        observation: "points", "vision" or "pixels".
        image_size: Width and height of "pixels", 16 to 1024; shadows from 256.
        tolerance_px: Image distance within which the object is at its place, in pixels of 512.

    Raises:
        ValueError: An argument is not allowed, the jaws cannot hold the object, or the world is not in view.

    ## Version history
    v0: first version.
    """


class GraspVectorEnv(ArmVectorEnv, arms=GraspArms):
    """Many arms that grasp, stepped together; row i is `GraspEnv` reset with seed + i.

    Args:
        num_envs, max_episode_steps, autoreset_mode, threads: As for `StereoArmVectorEnv`.
        world: As for `StereoArmEnv`, or a list of one a row.
        **arguments: As for `GraspEnv`.
    """
