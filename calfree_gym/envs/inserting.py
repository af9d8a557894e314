"""Inserting as Gymnasium environments, single and batched."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from calfree_gym.envs.arms.inserting_arms import BASE, HOLE, TIP, InsertingArms
from calfree_gym.envs.reaching import placed_objects
from calfree_gym.envs.shared import ArmShared, Events, GoalRewards
from calfree_gym.envs.single import ArmEnv
from calfree_gym.envs.spaces import Observation, action_space, joined, state_box, unit_box
from calfree_gym.envs.vector import ArmVectorEnv
from calfree_gym.errors import check_choice, known_arguments
from calfree_gym.image import IMAGE_SIZE
from calfree_gym.robot.inserting.peg import RADIUS
from calfree_gym.robot.inserting.simulation import POINTS
from calfree_gym.tasks import insert
from calfree_gym.world import WorldChoice

OBSERVATIONS = ("points",)
"""No tracker finds pegs and holes in images yet."""
LEAST_CLEARANCE, MOST_CLEARANCE = 0.1, 10.0
"""Of the hole's diameter less the peg's, in mm. Choice: the hole's corners fill a tighter one, and there is
no plate around a wider one."""
INSERTED_MM = 10.0
"""A peg is in, in truth, whose end is so deep below the plate's upper side, in the hole. Derived: images tell
16 mm, within 2 mm by noise (a deviation); perspective makes it up to 6 mm more."""
MM = 1000.0
_OTHERS = [place for place in range(2 * len(POINTS)) if place not in (*TIP, *HOLE)]
"""Image points other than those of the goals."""


class Inserting(GoalRewards, ArmShared):
    """What is so in an environment whose task is to insert."""

    arms: InsertingArms

    def _build(self, rows: int, threads: int, *, observation: str, **arguments: Any) -> None:
        check_choice("observation", observation, OBSERVATIONS)
        clearance = arguments["clearance"]
        number = isinstance(clearance, int | float | np.number) and not isinstance(clearance, bool)
        if not number or not LEAST_CLEARANCE <= clearance <= MOST_CLEARANCE:
            raise ValueError(
                f"clearance is {clearance!r}; it must be a number from {LEAST_CLEARANCE} to "
                f"{MOST_CLEARANCE}, in mm"
            )
        self.clearance = float(clearance)
        arguments |= {"clearance": self.clearance / MM, "image_size": IMAGE_SIZE}
        super()._build(rows, threads, observation=observation, tell=(), reward="sparse", **arguments)

    def _new_arms(self) -> InsertingArms:
        arguments = {name: each for name, each in self._arguments.items() if name != "image_size"}
        return InsertingArms(observation=self._kind, **arguments)

    def _spaces(self) -> tuple[spaces.Dict[Any], spaces.Box[Any]]:
        words, points = len(self.arms.robot.motors), 2 * len(POINTS)
        boxes: dict[str, spaces.Space[Any]] = {key: unit_box(5) for key in ("achieved_goal", "desired_goal")}
        boxes["observation"] = state_box(points, words, 2 * len(_OTHERS), self.arms.register_bound)
        return spaces.Dict(boxes), action_space(words)

    def is_solved(self, truth: Mapping[str, Any]) -> bool:
        """Whether the truth of an arm's info says that the task is done."""
        beside = truth["lateral_mm"] > MM * RADIUS + self.clearance / 2
        return bool(truth["depth_mm"] >= INSERTED_MM and not beside)

    def _placed(self, options: dict[str, Any] | None) -> NDArray[np.float64] | None:
        return placed_objects(options, self.arms.rows, self.arms.robot)

    def _outcome(self) -> tuple[Observation, NDArray[Any], NDArray[np.bool_]]:
        arms, rows = self.arms, self.arms.rows
        points, visible = arms.delivered
        tip, base, hole = (points[:, pair] for pair in (TIP, BASE, HOLE))
        seen = np.asarray(visible[:, [*TIP, *BASE, *HOLE]].all(1))
        depth = insert.depth_told(tip, base, hole, seen)
        wanted = np.full((rows, 1), insert.DEPTH)
        achieved = joined(tip.reshape(rows, 4), depth[:, None])
        desired = joined(hole.reshape(rows, 4), wanted)
        observed: Observation = {
            "achieved_goal": achieved,
            "desired_goal": desired,
            "observation": joined(visible, arms.told_registers(), points[:, _OTHERS].reshape(rows, -1)),
        }
        return observed, *self._judged(achieved, desired)

    def _judged(self, achieved: Any, desired: Any) -> tuple[Any, Any]:
        distances = insert.hole_distances(achieved, desired)
        return distances, insert.inserted(achieved, desired, self.arms.tolerance)

    def _truth(self) -> dict[str, Any]:
        arms = self.arms
        tip, hole = arms.simulation.positions()
        depth, lateral = arms.simulation.tips()
        return {
            "error_px": arms.error_px(),
            "distance_mm": MM * np.sqrt(np.square(tip - hole).sum(-1)),
            "depth_mm": MM * depth,
            "lateral_mm": MM * lateral,
            "force": arms.largest.copy(),
            "points": arms.true_points.reshape(arms.rows, -1),
            "gripper": tip,
            "object": hole,
            "joints": arms.simulation.joints(),
        }

    def _events(self) -> Events:
        arms = self.arms
        return {
            "force_table": arms.forces[:, 0].copy(),
            "force_plate": arms.forces[:, 1].copy(),
            "diverged": arms.simulation.diverged.copy(),
        }

    def _cut_short(self, events: Events) -> NDArray[np.bool_]:
        return events["diverged"]


class InsertEnv(Inserting, ArmEnv):
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
        world, camera_mount, perturbations, redraw: As for `StereoArmEnv`.
        terminate_on_success, keep_in_view, truth: As for `StereoArmEnv`.
        render_mode, width, height: As for `StereoArmEnv`.
        observation: "points".
        tolerance_px: Image distance within which the peg's end is at the hole, in pixels of 512.

    Raises:
        ValueError: An argument is not allowed, or the world is not in view.

    ## Version history
    v0: first version.
    """

    @known_arguments
    def __init__(
        self,
        *,
        clearance: float = 2.0,
        world: WorldChoice = "wild",
        camera_mount: str | Sequence[str] = "waist",
        observation: str = "points",
        tolerance_px: float = 24.0,
        perturbations: Any = None,
        redraw: str = "never",
        terminate_on_success: bool = True,
        keep_in_view: bool = True,
        truth: bool = True,
        render_mode: str | None = None,
        width: int = 1080,
        height: int = 720,
    ) -> None:
        self._build_one(locals())


class InsertVectorEnv(Inserting, ArmVectorEnv):
    """Many arms that insert, stepped together; row i is `InsertEnv` reset with seed + i.

    Args:
        num_envs, max_episode_steps, autoreset_mode, threads: As for `StereoArmVectorEnv`.
        world: As for `StereoArmEnv`, or a list of one a row.
        **arguments: As for `InsertEnv`.
    """

    @known_arguments
    def __init__(
        self,
        *,
        num_envs: int = 1,
        max_episode_steps: int = 60,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int = 0,
        clearance: float = 2.0,
        world: WorldChoice | Sequence[WorldChoice] = "wild",
        camera_mount: str | Sequence[str] = "waist",
        observation: str = "points",
        tolerance_px: float = 24.0,
        perturbations: Any = None,
        redraw: str = "never",
        terminate_on_success: bool = True,
        keep_in_view: bool = True,
        truth: bool = True,
        render_mode: str | None = None,
        width: int = 1080,
        height: int = 720,
    ) -> None:
        self._build_rows(locals())
