"""What environments have whose task is to reach: points, rendezvous, truth."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from calfree_gym.envs.arms.stereo_arms import StereoArms
from calfree_gym.envs.shared import ArmShared
from calfree_gym.envs.spaces import (
    GOALS,
    IMAGES,
    Observation,
    action_space,
    observation_space,
    observations,
)
from calfree_gym.errors import check_choice, check_flag
from calfree_gym.image import lengths
from calfree_gym.robot.arms.arm import Arm, robot_of
from calfree_gym.robot.arms.robot import Robot
from calfree_gym.robot.reach_simulation import DYNAMICS
from calfree_gym.robot.workspace import check_near
from calfree_gym.tasks import goals, reach


class Reaching(ArmShared):
    """What is so in an environment whose task is to reach."""

    arms: StereoArms

    def _build(self, rows: int, threads: int, *, observation: str, **arguments: Any) -> None:
        check_choice("observation", observation, (*GOALS, *IMAGES))
        check_choice("dynamics", arguments["dynamics"], DYNAMICS)
        check_flag("occlusion", arguments["occlusion"])
        if isinstance(arm := arguments["arm"], Mapping):
            arguments["arm"] = Arm.from_dict(arm)
        super()._build(rows, threads, observation=observation, **arguments)

    def _new_arms(self) -> StereoArms:
        arguments = dict(self._arguments)
        return StereoArms(robot=robot_of(arguments.pop("arm")), observation=self._kind, **arguments)

    def _spaces(self) -> tuple[spaces.Dict[Any], spaces.Box[Any]]:
        robot, size = self.arms.robot, self._arguments["image_size"]
        observed = observation_space(self._kind, size, self._tell, robot, self.arms.register_bound)
        return observed, action_space(len(robot.motors))

    def is_solved(self, truth: Mapping[str, Any]) -> bool:
        """Whether the truth of an arm's info says that the task is done."""
        return bool(truth["error_px"] <= self.tolerance_px)

    def _placed(self, options: dict[str, Any] | None) -> NDArray[np.float64] | None:
        return placed_objects(options, self.arms.rows, self.arms.robot)

    def _outcome(self) -> tuple[Observation, NDArray[Any], NDArray[np.bool_]]:
        """The last observation: batched observations, image distances (N, 2), and rendezvous (N,)."""
        observed = observations(self._kind, self._tell, self.arms)
        if self._kind in GOALS:
            return observed, *self._judged(observed["achieved_goal"], observed["desired_goal"])
        points, visible = self.arms.delivered[:2]
        distances = lengths(points[:, :2] - points[:, 2:])
        return observed, distances, reach.rendezvous(distances, self.arms.tolerance) & visible.all(1)

    def _judged(self, achieved: Any, desired: Any) -> tuple[Any, Any]:
        distances = goals.image_distances(achieved, desired)
        return distances, reach.rendezvous(distances, self.arms.tolerance)

    def _truth(self) -> dict[str, Any]:
        gripper, object_ = self.arms.simulation.positions()
        apart = gripper - object_
        return {
            "error_px": self.arms.error_px(),
            "distance_mm": 1000.0 * np.sqrt((apart * apart).sum(-1)),
            "points": self.arms.true_points.reshape(-1, 8),
            "gripper": gripper,
            "object": object_,
            "joints": self.arms.simulation.joints(),
        }


def placed_objects(options: dict[str, Any] | None, rows: int, robot: Robot) -> NDArray[np.float64] | None:
    """The object of reset's options (rows, 3) in m, or None without one."""
    options = checked_options(options)
    if not options:
        return None
    if unknown := sorted(options.keys() - {"object"}):
        raise ValueError(f"reset has no option {', '.join(map(repr, unknown))}; allowed: 'object'")
    try:
        position = np.asarray(options["object"], np.float64)
    except (TypeError, ValueError):
        position = np.empty(0)
    if position.shape not in ((3,), (rows, 3)) or not np.isfinite(position).all():
        raise ValueError(f"options['object'] is {options['object']!r}; it must be (x, y, z) in metres")
    objects = np.broadcast_to(position, (rows, 3))
    check_near(objects, robot)
    return objects


def checked_options(options: Any) -> dict[str, Any]:
    """Reset's options, a copy; none where there are none.

    Raises:
        ValueError: They are no dict.
    """
    if options is not None and not isinstance(options, dict):
        raise ValueError(
            f"reset's options are {options!r}; they must be a dict, such as {{'object': (x, y, z)}}"
        )
    return dict(options or {})
