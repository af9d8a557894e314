"""Grasping as Gymnasium environments, single and batched."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from calfree_gym.envs.arms.grasping_arms import ANY, HELD, LYING, ORIENTATIONS, GraspingArms
from calfree_gym.envs.shared import ArmShared, Events, GoalRewards
from calfree_gym.envs.single import ArmEnv
from calfree_gym.envs.spaces import (
    GOALS,
    Observation,
    action_space,
    joined,
    pixel_box,
    pixels_of,
    state_box,
    unit_box,
)
from calfree_gym.envs.vector import ArmVectorEnv
from calfree_gym.errors import check_choice, known_arguments
from calfree_gym.robot.grasping.shapes import ShapeChoice, check_shape
from calfree_gym.robot.grasping.simulation import POINTS
from calfree_gym.tasks import grasp
from calfree_gym.world import WorldChoice

OBSERVATIONS = (*GOALS, "pixels")
_BEFORE, _AFTER = slice(HELD.start), slice(HELD.stop, None)
"""Image points other than the object's, which is a goal of its own."""
MM = 1000.0
LIFTED_MM = 50.0
"""An object is lifted, in truth, that is so high above where it lay, for a second."""


class Grasping(ArmShared):
    """What is so in an environment whose task is to grasp."""

    arms: GraspingArms

    def _build(self, rows: int, threads: int, *, observation: str, **arguments: Any) -> None:
        check_choice("observation", observation, OBSERVATIONS)
        check_shape(arguments["shape"])
        check_choice("orientation", arguments["orientation"], tuple(ORIENTATIONS))
        if arguments["orientation"] == ANY and observation != "points":
            raise ValueError(f"orientation='any' is observed by 'points' alone; found {observation!r}")
        super()._build(rows, threads, observation=observation, tell=(), **arguments)

    def _new_arms(self) -> GraspingArms:
        return GraspingArms(observation=self._kind, **self._arguments)

    def _spaces(self) -> tuple[spaces.Dict[Any], spaces.Box[Any]]:
        registers, bound = len(self.arms.robot.motors), self.arms.register_bound
        flags, others = 2 * len(POINTS), 2 * (2 * len(POINTS) - 2)
        boxes: dict[str, spaces.Space[Any]]
        if self._kind in GOALS:
            boxes = {key: unit_box(5) for key in ("achieved_goal", "desired_goal")}
            boxes["observation"] = state_box(flags, registers, 2 + others, bound)
        else:
            boxes = {"pixels": pixel_box(self._arguments["image_size"])}
            boxes["observation"] = state_box(0, registers, 2, bound)
        return spaces.Dict(boxes), action_space(registers + 1)

    def is_solved(self, truth: Mapping[str, Any]) -> bool:
        """Whether the truth of an arm's info says that the task is done."""
        return bool(truth["lifted_mm"] >= LIFTED_MM)

    def _placed(self, options: dict[str, Any] | None) -> NDArray[np.float64] | None:
        return placed_things(options, self.arms.rows, self._arguments["orientation"])

    def _outcome(self) -> tuple[Observation, NDArray[Any], NDArray[np.bool_]]:
        arms, rows = self.arms, self.arms.rows
        points, visible, held, *images = arms.delivered
        achieved = joined(points[:, HELD].reshape(rows, 4), held[:, None])
        desired = joined(arms.goals, np.ones((rows, 1)))
        observed: Observation = {}
        openings = np.minimum(np.maximum(arms.openings, 0.0), 1.0)
        felt = [arms.told_registers(), arms.jaws[:, None], openings[:, None]]
        if self._kind in GOALS:
            others = (points[:, part].reshape(rows, -1) for part in (_BEFORE, _AFTER))
            state = [visible, *felt, *others]
            observed |= {"achieved_goal": achieved, "desired_goal": desired}
        else:
            state, observed["pixels"] = felt, pixels_of(images[0])
        observed["observation"] = joined(*state)
        return observed, *self._judged(achieved, desired)

    def _judged(self, achieved: Any, desired: Any) -> tuple[Any, Any]:
        distances = grasp.place_distances(achieved, desired)
        return distances, grasp.lifted(distances, achieved, desired, self.arms.tolerance)

    def _truth(self) -> dict[str, Any]:
        arms = self.arms
        gripper, object_ = arms.simulation.positions()
        return {
            "error_px": arms.error_px(),
            "distance_mm": MM * np.sqrt(np.square(gripper - object_).sum(-1)),
            "lifted_mm": MM * arms.lifted,
            "points": arms.true_points.reshape(arms.rows, -1),
            "gripper": gripper,
            "object": object_,
            "joints": arms.simulation.joints(),
        }

    def _events(self) -> Events:
        arms = self.arms
        return {
            "force_table": arms.forces[:, 0].copy(),
            "force_object": arms.forces[:, 1].copy(),
            "off_table": arms.off_table,
            "diverged": arms.simulation.diverged.copy(),
        }

    def _cut_short(self, events: Events) -> NDArray[np.bool_]:
        return events["off_table"] | events["diverged"]


class GraspEnv(Grasping, ArmEnv):
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
        world, camera_mount, perturbations, redraw: As for `StereoArmEnv`.
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

    @known_arguments
    def __init__(
        self,
        *,
        shape: ShapeChoice = None,
        orientation: str = LYING,
        world: WorldChoice = "wild",
        camera_mount: str | Sequence[str] = "waist",
        observation: str = "points",
        image_size: int = 128,
        tolerance_px: float = 24.0,
        perturbations: Any = None,
        redraw: str = "never",
        terminate_on_success: bool = True,
        keep_in_view: bool = True,
        truth: bool = True,
        reward: str = "sparse",
        render_mode: str | None = None,
        width: int = 1080,
        height: int = 720,
    ) -> None:
        self._build_one(locals())


class GraspVectorEnv(Grasping, ArmVectorEnv):
    """Many arms that grasp, stepped together; row i is `GraspEnv` reset with seed + i.

    Args:
        num_envs, max_episode_steps, autoreset_mode, threads: As for `StereoArmVectorEnv`.
        world: As for `StereoArmEnv`, or a list of one a row.
        **arguments: As for `GraspEnv`.
    """

    @known_arguments
    def __init__(
        self,
        *,
        num_envs: int = 1,
        max_episode_steps: int = 60,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int = 0,
        shape: ShapeChoice = None,
        orientation: str = LYING,
        world: WorldChoice | Sequence[WorldChoice] = "wild",
        camera_mount: str | Sequence[str] = "waist",
        observation: str = "points",
        image_size: int = 128,
        tolerance_px: float = 24.0,
        perturbations: Any = None,
        redraw: str = "never",
        terminate_on_success: bool = True,
        keep_in_view: bool = True,
        truth: bool = True,
        reward: str = "sparse",
        render_mode: str | None = None,
        width: int = 1080,
        height: int = 720,
    ) -> None:
        self._build_rows(locals())


class GraspGoalEnv(GoalRewards, GraspEnv):
    """A `GraspEnv` that observes image points: hindsight relabelling can compute its reward."""


class GraspGoalVectorEnv(GoalRewards, GraspVectorEnv):
    """A `GraspVectorEnv` that observes image points: hindsight relabelling can compute its reward."""


def make(**arguments: Any) -> GraspEnv:
    """The environment of these arguments; for `gymnasium.make`."""
    goals = arguments.get("observation", "points") in GOALS
    return GraspGoalEnv(**arguments) if goals else GraspEnv(**arguments)


def make_vec(**arguments: Any) -> GraspVectorEnv:
    """The environment of these arguments; for `gymnasium.make_vec`."""
    goals = arguments.get("observation", "points") in GOALS
    return GraspGoalVectorEnv(**arguments) if goals else GraspVectorEnv(**arguments)


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
