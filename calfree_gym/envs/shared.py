"""What the single and the batched environment share: arguments, outcomes, truth and frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from calfree_gym.envs.arms.state import Copyable
from calfree_gym.envs.arms.stereo_arms import StereoArms
from calfree_gym.envs.privileged import PRIVILEGED
from calfree_gym.envs.rendering.scene_frame import SceneFrame, check_size
from calfree_gym.envs.rendering.viewer import Viewer
from calfree_gym.envs.spaces import GOALS, IMAGES, Observation, observations
from calfree_gym.envs.spec import plain
from calfree_gym.errors import check_choice, check_whole
from calfree_gym.image import IMAGE_SIZE, lengths
from calfree_gym.robot.arms.arm import Arm, ArmChoice, robot_of
from calfree_gym.robot.arms.robot import Robot
from calfree_gym.robot.reach_simulation import DYNAMICS
from calfree_gym.robot.workspace import check_near
from calfree_gym.tasks import reach

REWARDS = {"sparse": reach.sparse_reward, "dense": reach.dense_reward}
RENDER_MODES = ("rgb_array", "human")
REDRAWS = ("never", "trial")
SMALLEST_IMAGE, LARGEST_IMAGE = 16, 1024
"""Width and height in pixels of images that are delivered."""


class StereoArmShared(Copyable):
    """What the single and the batched environment share."""

    def _build(
        self,
        rows: int,
        threads: int,
        reward: str,
        observation: str,
        terminate_on_success: bool,
        tell: Sequence[str],
        truth: bool,
        render_mode: Any,
        width: int,
        height: int,
        arm: ArmChoice,
        **arms: Any,
    ) -> None:
        check_choice("reward", reward, tuple(REWARDS))
        check_choice("observation", observation, (*GOALS, *IMAGES))
        check_choice("dynamics", arms["dynamics"], DYNAMICS)
        check_choice("redraw", arms["redraw"], REDRAWS)
        for name, flag in (("truth", truth), ("occlusion", arms["occlusion"])):
            if not isinstance(flag, bool):
                raise ValueError(f"{name} is {flag!r}; allowed: True, False")
        tolerance_px = arms["tolerance_px"]
        if not (isinstance(tolerance_px, int | float | np.number) and 0 < tolerance_px < IMAGE_SIZE):
            raise ValueError(f"tolerance_px is {tolerance_px!r}; it must be a number in (0, {IMAGE_SIZE})")
        check_whole("image_size", arms["image_size"], SMALLEST_IMAGE, LARGEST_IMAGE)
        if isinstance(tell, str):
            raise ValueError(f"tell is {tell!r}; it must be a sequence of names, such as ({tell!r},)")
        for name in tell:
            check_choice("tell", name, tuple(PRIVILEGED))
        if render_mode is not None:
            check_choice("render_mode", render_mode, RENDER_MODES)
        check_size(width, height)
        self._frame_size = width, height
        self._arm = Arm.from_dict(arm) if isinstance(arm, Mapping) else arm
        self._arguments = {"rows": rows, "threads": threads, "observation": observation, **arms}
        self.arms = self._new_arms()
        self.render_mode = render_mode
        self._kind, self._ends = observation, terminate_on_success
        self._tell = tuple(tell)
        self._gives_truth = truth
        self.tolerance_px = float(tolerance_px)
        self._reward = REWARDS[reward]
        self._renderer: Any = None
        self._spec: EnvSpec | None = None

    def _new_arms(self) -> StereoArms:
        return StereoArms(robot=robot_of(self._arm), **self._arguments)

    @property
    def spec(self) -> EnvSpec | None:
        """How `gymnasium.make` made it, by plain arguments: `to_json` is exact."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None:
            arm = {"arm": self._arm} if "arm" in spec.kwargs else {}
            spec = replace(spec, kwargs=plain(spec.kwargs | arm))
        self._spec = spec

    def _outcome(self) -> tuple[Observation, NDArray[Any], NDArray[np.bool_]]:
        """The last observation: batched observations, image distances (N, 2), and rendezvous (N,)."""
        observed = observations(self._kind, self._tell, self.arms)
        if self._kind in GOALS:
            distances = reach.image_distances(observed["achieved_goal"], observed["desired_goal"])
            return observed, distances, reach.rendezvous(distances, self.arms.tolerance)
        points, visible = self.arms.delivered[:2]
        distances = lengths(points[:, :2] - points[:, 2:])
        return observed, distances, reach.rendezvous(distances, self.arms.tolerance) & visible.all(1)

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

    def _frame(self, row: int) -> NDArray[np.uint8] | None:
        if self.render_mode is None:
            gym.logger.warn(
                "render() shows nothing without a render_mode; give one to gym.make: "
                + ", ".join(RENDER_MODES)
            )
            return None
        if self._renderer is None:
            human = self.render_mode == "human"
            self._renderer = Viewer(self.arms) if human else SceneFrame(self.arms, *self._frame_size)
        frame: NDArray[np.uint8] | None = self._renderer.draw(row)
        return frame

    def _close(self) -> None:
        """Frees what draws."""
        self.arms.close()
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


class GoalRewards(StereoArmShared):
    """What a goal environment has besides: reward and end as pure functions of sensor vectors."""

    def compute_reward(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """The reward (...) for sensor vectors (..., 4); pure, and what `step` returns."""
        distances = reach.image_distances(achieved_goal, desired_goal)
        return self._reward(distances, reach.rendezvous(distances, self.arms.tolerance))

    def compute_terminated(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """Whether a trial ends (...) at sensor vectors (..., 4); pure, and what `step` returns."""
        distances = reach.image_distances(achieved_goal, desired_goal)
        ended = reach.rendezvous(distances, self.arms.tolerance)
        return ended if self._ends else np.zeros_like(ended)

    def compute_truncated(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """False: only the number of motions truncates a trial (see `max_episode_steps`)."""
        return np.zeros(np.shape(achieved_goal)[:-1], bool)


def placed_objects(options: dict[str, Any] | None, rows: int, robot: Robot) -> NDArray[np.float64] | None:
    """The object of reset's options (rows, 3) in m, or None without one."""
    if not options:
        return None
    if not isinstance(options, dict):
        raise ValueError(
            f"reset's options are {options!r}; they must be a dict, such as {{'object': (x, y, z)}}"
        )
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
