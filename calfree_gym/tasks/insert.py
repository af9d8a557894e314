"""Inserting: the peg's end is below the plate, in the hole, as images tell (Yoshimi & Allen 1994)."""

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
    Floats,
    Observation,
    image_distances,
    joined,
    state_box,
    unit_box,
)
from calfree_gym.engine.vector import ArmVectorEnv
from calfree_gym.errors import check_choice
from calfree_gym.geometry import Array, Rows
from calfree_gym.image import PIXELS_PER_UNIT, lengths
from calfree_gym.robot.inserting import OBJECT, POINTS, RADIUS, Holes, InsertingArm, InsertSimulation
from calfree_gym.tasks.contact import ContactArms
from calfree_gym.world import World, WorldChoice

OBSERVATIONS = ("points",)
"""No tracker finds pegs and holes in images yet."""
LEAST_CLEARANCE, MOST_CLEARANCE = 0.1, 10.0
"""Of the hole's diameter less the peg's, in mm. Choice: the hole's corners fill a tighter one, and there is
no plate around a wider one."""
INSERTED_MM = 10.0
"""A peg is in, in truth, whose end is so deep below the plate's upper side, in the hole. Derived: images tell
16 mm, within 2 mm by noise (a deviation); perspective makes it up to 6 mm more."""
TIP, BASE, HOLE = ((2 * place, 2 * place + 1) for place in (0, 1, OBJECT))
"""Where the points of the peg's end, the gripper's base and the hole stand among the image points."""
_OTHERS = [place for place in range(2 * len(POINTS)) if place not in (*TIP, *HOLE)]
"""Image points other than those of the goals."""
DEPTH = 0.17
"""The peg is in where its end is seen so deep, in gripper lengths (0.092 m): 16 mm. Choice: four plates
deep."""
BESIDE = 0.3
"""Farther from the hole's axis, in gripper lengths (28 mm), no peg is below the plate: it may hang beside it.
Derived: the plate ends at half a length."""
DEEPEST = 1.0
"""No depth is told that is larger (a guard: where the gripper's length is hardly seen, it tells nothing)."""


def depth_told(tip: Floats, base: Floats, hole: Floats, visible: NDArray[np.bool_]) -> Floats:
    """How deep the peg's end is below the hole's centre, in gripper lengths (N,), as both images tell.

    By least squares: the way from the hole to the peg's end, along that from gripper base to peg's end. Above
    the plate it is negative. Where more than `BESIDE` of that way is left across, it is not positive.

    Args:
        tip: Image points (N, 2, 2) of the peg's end, left and right.
        base: Of the gripper's base.
        hole: Of the hole's centre.
        visible: Whether all of these are seen (N,); else `-DEEPEST` is told.
    """
    axis, way = (tip - base).reshape(-1, 4), (tip - hole).reshape(-1, 4)
    squares = np.maximum(np.square(axis).sum(-1), np.finfo(float).tiny)
    depth = np.clip((axis * way).sum(-1) / squares, -DEEPEST, DEEPEST)
    across = way - depth[:, None] * axis
    beside = np.square(across).sum(-1) > BESIDE**2 * squares
    return np.where(visible, np.where(beside, np.minimum(depth, 0.0), depth), -DEEPEST)


def hole_distances(achieved: Floats, desired: Floats) -> Floats:
    """Distances (..., 2) in image units, per camera, of the peg's end from the hole's centre.

    Args:
        achieved: The sensor vector of the peg's end, and how deep it is (..., 5).
        desired: That of the hole's centre, and how deep it is to be (..., 5).
    """
    return image_distances(achieved[..., :4], desired[..., :4])


def inserted(achieved: Floats, desired: Floats, tolerance: float | np.float32) -> NDArray[np.bool_]:
    """Whether (...) the peg's end is deep enough, within `tolerance` of the hole's centre in both images."""
    near = np.maximum.reduce(hole_distances(achieved, desired), axis=-1) <= tolerance
    return np.asarray(near & (achieved[..., 4] >= desired[..., 4]))


@dataclass(kw_only=True)
class InsertConfig(Config):
    """The arguments of `InsertEnv`."""

    clearance: float = 2.0
    world: WorldChoice | Sequence[WorldChoice] = "wild"
    camera_mount: str | Sequence[str] = "waist"
    observation: str = "points"
    tolerance_px: float = 24.0
    perturbations: Any = None
    redraw: str = "never"
    pool: int | None = None
    terminate_on_success: bool = True
    keep_in_view: bool = True
    truth: bool = True
    render_mode: str | None = None
    width: int = 1080
    height: int = 720

    def __post_init__(self) -> None:
        check_choice("observation", self.observation, OBSERVATIONS)
        clearance = self.clearance
        number = isinstance(clearance, int | float | np.number) and not isinstance(clearance, bool)
        if not number or not LEAST_CLEARANCE <= clearance <= MOST_CLEARANCE:
            raise ValueError(
                f"clearance is {clearance!r}; it must be a number from {LEAST_CLEARANCE} to "
                f"{MOST_CLEARANCE}, in mm"
            )
        self.clearance = float(clearance)
        super().__post_init__()


class InsertArms(ContactArms):
    """N arms, whose cameras see `robot.inserting.POINTS`.

    Attributes:
        forces: Of the gripper and the peg on table and plate (N, 2) in the last motion, in N: the largest.
        largest: Of the plate's, the largest in this trial (N,).
        poses: Of the plates (N, 7): the hole's centre in m, and a quaternion.
    """

    task = "insert"
    config_of = InsertConfig
    shown_points: ClassVar[tuple[int, int, int, int]] = (*TIP, *HOLE)
    state_names: ClassVar[tuple[str, ...]] = (*ContactArms.state_names, "forces", "largest", "poses")
    config: InsertConfig
    simulation: InsertSimulation

    def __init__(self, rows: int, threads: int, config: InsertConfig) -> None:
        robot = InsertingArm(config.clearance / MM)
        simulation = InsertSimulation(rows, robot, robot.mounts(config.camera_mount), threads)
        super().__init__(simulation, robot, 2 * len(POINTS), config)
        self._holes = Holes(robot, self._workspaces, config.keep_in_view)
        self.forces, self.largest, self.poses = np.zeros((rows, 2)), np.zeros(rows), np.zeros((rows, 7))
        self.delivered = (self.points, self.visible)

    def make_spaces(self) -> tuple[spaces.Dict[Any], spaces.Box[Any]]:
        words, points = len(self.robot.motors), 2 * len(POINTS)
        boxes: dict[str, spaces.Space[Any]] = {key: unit_box(5) for key in ("achieved_goal", "desired_goal")}
        boxes["observation"] = state_box(points, words, 2 * len(_OTHERS), self.register_bound)
        return spaces.Dict(boxes), unit_box(words)

    def serves(self, row: int, world: World) -> bool:
        """See `ContactArms`: there is a place for holes."""
        return self._holes.serves(row, world)

    def next_objects(self, rows: NDArray[np.intp], given: Array | None) -> Array:
        """See `Arms`: poses of plates (n, 7); given are holes' centres (n, 3)."""
        for i, row in enumerate(rows.tolist()):
            which = row, self._seeds[row] or 0, int(self.trials[row]), self.world(row)
            self.poses[row] = (
                self._holes.draw(*which) if given is None else self._holes.given(*which, given[i])
            )
        return self.poses[rows]

    def begun(self, rows: Rows) -> None:
        self.forces[rows], self.largest[rows] = 0.0, 0.0

    def execute(self, rows: Rows, joints: Array, words: Array) -> Array:
        """See `Arms`: the jaws stay closed on the peg."""
        seconds, motion = self.travelled(rows, joints, np.full(len(self._all[rows]), RADIUS))
        self.forces[rows] = motion.forces
        self.largest[rows] = np.maximum(self.largest[rows], motion.forces[:, 1])
        return seconds

    def observe(self) -> None:
        self.look()
        self.delivered = self._latency.deliver(self.motions_of_trial, self.points, self.visible)

    def outcome(self) -> tuple[Observation, NDArray[Any], NDArray[np.bool_]]:
        rows = self.rows
        points, visible = self.delivered
        tip, base, hole = (points[:, pair] for pair in (TIP, BASE, HOLE))
        seen = np.asarray(visible[:, [*TIP, *BASE, *HOLE]].all(1))
        depth = depth_told(tip, base, hole, seen)
        wanted = np.full((rows, 1), DEPTH)
        achieved = joined(tip.reshape(rows, 4), depth[:, None])
        desired = joined(hole.reshape(rows, 4), wanted)
        observed: Observation = {
            "achieved_goal": achieved,
            "desired_goal": desired,
            "observation": joined(visible, self.told_registers(), points[:, _OTHERS].reshape(rows, -1)),
        }
        return observed, *self.judged(achieved, desired)

    def judged(self, achieved: Any, desired: Any) -> tuple[Any, Any]:
        distances = hole_distances(achieved, desired)
        return distances, inserted(achieved, desired, self.tolerance)

    def is_solved(self, truth: Mapping[str, Any]) -> bool:
        beside = truth["lateral_mm"] > MM * RADIUS + self.config.clearance / 2
        return bool(truth["depth_mm"] >= INSERTED_MM and not beside)

    def truth(self) -> dict[str, Any]:
        depth, lateral = self.simulation.tips()
        told = {"depth_mm": MM * depth, "lateral_mm": MM * lateral, "force": self.largest.copy()}
        return super().truth() | told

    def events(self) -> Events:
        return {
            "force_table": self.forces[:, 0].copy(),
            "force_plate": self.forces[:, 1].copy(),
            "diverged": self.simulation.diverged.copy(),
        }

    def cut_short(self, events: Events) -> NDArray[np.bool_]:
        return events["diverged"]

    def set_state(self, row: int, state: RowState) -> None:
        super().set_state(row, state)
        self.simulation.set_plate(row, self.poses[row])

    def error_px(self) -> Array:
        """Noise-free image distances (N,) in pixels of pegs' ends from holes' centres."""
        away = self.true_points[:, TIP] - self.true_points[:, HOLE]
        return np.asarray(PIXELS_PER_UNIT * lengths(away).max(1))


class InsertEnv(ArmEnv, arms=InsertArms):
    """The paper's arm, with a peg in its gripper, whose task is to put it into a hole (Yoshimi & Allen 1994).

    ## Description
    A thin plate with a hole stands above a table. The controller brings the peg over the hole, and puts it
    in. Cameras, arm and motors are unknown to it: they are the hidden `World`. Physics is whole: gravity,
    contacts, friction. The peg is a dowel of 16 mm with a chamfer (3 mm at 15 degrees), and sticks out of the
    jaws by 45 mm. The gripper gives way to a peg that presses by 3 N/mm, along its axis and to the side.

    The arm cannot tilt the peg: the wrist keeps the gripper at one angle, which wrong joint zeros tilt by up
    to 28 degrees. So the plate leans: the hole's axis is that of the gripper there, but for up to 5 degrees,
    which are drawn.

    ## Action space
    `Box(-1, 1, (4,), float32)`: one control word each, as in `GraspEnv`, for waist, shoulder, elbow and the
    wrist's turn. The jaws are closed on the peg for good, and have no word.

    One step is one motion. An arm that presses with more than 12 N goes back about half of the way that it
    has come: registers tell where it stands.

    ## Observation space
    A `Dict` of a goal environment. Image points are (x, y), x right and y down, +-1 the image border.

    | key | shape | content |
    |---|---|---|
    | achieved_goal | (5,) | sensor vector of the peg's end: (xa, ya, xb, yb); its depth, as images tell it |
    | desired_goal | (5,) | sensor vector of the hole's centre; 0.17, the depth that is wanted |
    | observation | (62,) | see below |

    `observation`: 22 flags, 1 where a point is seen now, left and right of: peg's end, gripper base, lower
    ends of jaw 1 and 2, edges 1 and 2, the hole's centre, four points of the plate around it; 4 registers;
    and 18 image points (x, y), as the flags but without the peg's end and the hole's centre. Points are where
    projection puts them, with noise; nothing hides them.

    *Depth*, in gripper lengths (0.092 m): the way from the hole's centre to the peg's end along the gripper's
    axis, as both images show it (perspective bends it by up to a quarter); -1 where one of these points is
    not seen. More than 28 mm beside the hole, as far as images tell, no depth is told that is positive: there
    a peg may hang beside the plate.

    ## Rewards
    0 on the motion after which the peg is so deep, within `tolerance_px` of the hole's centre in both images,
    -1 on every other. There is no dense reward. On the waist mount the hole moves in the images: hindsight
    relabelling is not valid.

    ## Starting state
    The arm is at home. The plate stands where both cameras see it, and where the peg can be put in.
    `reset(seed=k)` draws the world, plates and noise from k; `reset()` places the next plate in the same
    world. `reset(options={"object": (x, y, z)})` places the hole's centre there (m).

    ## Episode end
    Terminated with the peg in, unless `terminate_on_success=False`. Truncated after `max_episode_steps` (60)
    motions, and where the physics diverged.

    ## Information
    As in `StereoArmEnv`; besides `force_table` and `force_plate`: the largest force (N) of gripper and peg on
    these in the motion, all contacts together; and `diverged`. `truth`: `error_px`: of the peg's end from the
    hole's centre; `depth_mm` below the plate's upper side; `lateral_mm` from the hole's axis; `force`: the
    largest on the plate in this trial. A peg is in, in truth, 10 mm deep.

    Args:
        clearance: The hole's diameter less the peg's, 0.1 to 10 mm.
        world, camera_mount, perturbations, redraw, pool: As for `StereoArmEnv`.
        terminate_on_success, keep_in_view, truth: As for `StereoArmEnv`.
        render_mode, width, height: As for `StereoArmEnv`.
        observation: "points".
        tolerance_px: Image distance within which the peg's end is at the hole, in pixels of 512.

    Raises:
        ValueError: An argument is not allowed, or the world is not in view.

    ## Version history
    v0: first version.
    """


class InsertVectorEnv(ArmVectorEnv, arms=InsertArms):
    """Many arms that insert, stepped together; row i is `InsertEnv` reset with seed + i.

    Args:
        num_envs, max_episode_steps, autoreset_mode, threads: As for `StereoArmVectorEnv`.
        world: As for `StereoArmEnv`, or a list of one a row.
        **arguments: As for `InsertEnv`.
    """
