"""Reaching where an arm can have an accident, as Gymnasium environments, single and batched."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Real
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from calfree_gym.envs.arms.touching_arms import TouchingArms
from calfree_gym.envs.reaching import Reaching
from calfree_gym.envs.shared import Events, GoalRewards
from calfree_gym.envs.single import ArmEnv
from calfree_gym.envs.spaces import GOALS
from calfree_gym.envs.vector import ArmVectorEnv
from calfree_gym.errors import known_arguments
from calfree_gym.robot.arms.arm import ArmChoice, robot_of
from calfree_gym.world import WorldChoice

FORCE_BOUND = 65.0
"""In N. Source: ISO/TS 15066, the least of its limits of quasi-static contact, which is that of the face."""
GAINS = (0.25, 8.0)
"""Factors of the motors' gains. Choice: the built robot's register 1 then means 0.3 to 41 rad in wild
worlds."""


class SafeReaching(Reaching):
    """What is so in an environment whose task is to reach without an accident."""

    arms: TouchingArms

    def _build(self, rows: int, threads: int, *, observation: str, **arguments: Any) -> None:
        force_bound, gains = arguments["force_bound"], arguments["gains"]
        if not (_is_number(force_bound) and force_bound > 0):
            raise ValueError(f"force_bound is {force_bound!r}; it must be a positive number, in N")
        pair = tuple(gains) if isinstance(gains, list | tuple) else ()
        if len(pair) != 2 or not all(map(_is_number, pair)) or not 0 < pair[0] <= pair[1] < np.inf:
            raise ValueError(f"gains is {gains!r}; it must be two positive numbers, the lesser first")
        arguments |= {"force_bound": float(force_bound), "gains": (float(pair[0]), float(pair[1]))}
        super()._build(rows, threads, observation=observation, dynamics="physics", **arguments)

    def _new_arms(self) -> TouchingArms:
        arguments = {name: value for name, value in self._arguments.items() if name != "dynamics"}
        return TouchingArms(robot=robot_of(arguments.pop("arm")), observation=self._kind, **arguments)

    def _events(self) -> Events:
        arms, touched = self.arms, self.arms.simulation.touched
        return {
            "contacts": touched.contacts.astype(np.int64),
            "peak_force": touched.force.copy(),
            "joint_travel": touched.travel.copy(),
            "total_travel": arms.total_travel.copy(),
            "harmed": arms.harmed.copy(),
        }

    def _cut_short(self, events: Events) -> NDArray[np.bool_]:
        return events["harmed"]


class SafeReachEnv(SafeReaching, ArmEnv):
    """A robot that was just switched on: how can it begin to move without an accident (paper, section 5)?

    ## Description
    As `StereoArmEnv`, but the arm can touch what is in its way: a table, a wall in front of it and one on
    each side, and its own links. And its motors are weaker or stronger than anyone told: each by a factor of
    its own, from 0.25 to 8, with which the gains of a world that is drawn are multiplied. So the same word
    may turn a joint by a degree, or throw it against its stop.

    ## Action space, observation space, rewards, starting state
    As in `StereoArmEnv`, always in full physics. There is no sensor of touch. The object lies where the
    straight way to it, in joints from home, touches nothing.

    One step is one motion. Its targets travel with least jerk, and the gripper at 0.25 m/s at most (ISO
    10218-1, reduced speed); a short motion takes 0.35 s, so short motions are slow ones. A drive that meets
    12 N trips: 10 ms later the arm is held, and goes back half of the way that it has come. That is all that
    a controller can tell of a contact: registers show that words were executed in part, all by nearly the
    same share (the same in joints). Joints never pass their stops.

    ## Episode end
    Terminated at the rendezvous, unless `terminate_on_success=False`. Truncated after `max_episode_steps`
    (60) motions, and where a contact was above `force_bound`: `harmed` then is True. (Goals cannot tell of
    that, so it does not count as terminated: see `compute_terminated`.)

    ## Information
    As in `StereoArmEnv`, whose speeds `robot_seconds` counts with, not with these slower motions; besides, of
    the last motion: `contacts`, at how many points the arm touched something, at most; `peak_force` (N), the
    largest force of one of them; `joint_travel`, how far the joint that went farthest was from where it
    began, in rad (m where it slides). Of the trial: `total_travel`, the sum of these; `harmed`.

    Args:
        gains: The least and the largest factor of the motors' gains, where worlds are drawn. A given world
            is as it is.
        force_bound: Contact force (N) above which a trial ends.
        world, arm, camera_mount, observation, tolerance_px: As for `StereoArmEnv`.
        perturbations, redraw, terminate_on_success, keep_in_view: As for `StereoArmEnv`.
        tell, truth, occlusion, image_size, reward: As for `StereoArmEnv`.
        render_mode, width, height: As for `StereoArmEnv`.

    Raises:
        ValueError: As for `StereoArmEnv`.

    ## Version history
    v0: first version.
    """

    @known_arguments
    def __init__(
        self,
        *,
        gains: Sequence[float] = GAINS,
        force_bound: float = FORCE_BOUND,
        world: WorldChoice = "wild",
        arm: ArmChoice = "movemaster",
        camera_mount: str | Sequence[str] = "waist",
        observation: str = "points",
        tolerance_px: float = 4.0,
        perturbations: Any = None,
        redraw: str = "never",
        terminate_on_success: bool = True,
        keep_in_view: bool = True,
        tell: Sequence[str] = (),
        truth: bool = True,
        occlusion: bool = False,
        image_size: int = 128,
        reward: str = "sparse",
        render_mode: str | None = None,
        width: int = 1080,
        height: int = 720,
    ) -> None:
        self._build_one(locals())


class SafeReachVectorEnv(SafeReaching, ArmVectorEnv):
    """Many arms that begin to move, stepped together; row i is `SafeReachEnv` reset with seed + i.

    Args:
        num_envs, max_episode_steps, autoreset_mode, threads: As for `StereoArmVectorEnv`.
        world: As for `StereoArmEnv`, or a list of one a row.
        **arguments: As for `SafeReachEnv`.
    """

    @known_arguments
    def __init__(
        self,
        *,
        num_envs: int = 1,
        max_episode_steps: int = 60,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int = 0,
        gains: Sequence[float] = GAINS,
        force_bound: float = FORCE_BOUND,
        world: WorldChoice | Sequence[WorldChoice] = "wild",
        arm: ArmChoice = "movemaster",
        camera_mount: str | Sequence[str] = "waist",
        observation: str = "points",
        tolerance_px: float = 4.0,
        perturbations: Any = None,
        redraw: str = "never",
        terminate_on_success: bool = True,
        keep_in_view: bool = True,
        tell: Sequence[str] = (),
        truth: bool = True,
        occlusion: bool = False,
        image_size: int = 128,
        reward: str = "sparse",
        render_mode: str | None = None,
        width: int = 1080,
        height: int = 720,
    ) -> None:
        self._build_rows(locals())


class SafeReachGoalEnv(GoalRewards, SafeReachEnv):
    """A `SafeReachEnv` that observes image points: hindsight relabelling can compute its reward."""


class SafeReachGoalVectorEnv(GoalRewards, SafeReachVectorEnv):
    """A `SafeReachVectorEnv` that observes image points: hindsight relabelling can compute its reward."""


def make(**arguments: Any) -> SafeReachEnv:
    """The environment of these arguments; for `gymnasium.make`."""
    goals = arguments.get("observation", "points") in GOALS
    return SafeReachGoalEnv(**arguments) if goals else SafeReachEnv(**arguments)


def make_vec(**arguments: Any) -> SafeReachVectorEnv:
    """The environment of these arguments; for `gymnasium.make_vec`."""
    goals = arguments.get("observation", "points") in GOALS
    return SafeReachGoalVectorEnv(**arguments) if goals else SafeReachVectorEnv(**arguments)


def _is_number(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)
