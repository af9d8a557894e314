"""What the single and the batched environment share: arguments, spaces, observations, rewards."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from calfree_gym.envs.spec import plain
from calfree_gym.envs.state import Copyable
from calfree_gym.envs.stereo_arms import StereoArms
from calfree_gym.errors import check_choice
from calfree_gym.robot.arms.arm import Arm, ArmChoice, robot_of
from calfree_gym.robot.arms.robot import Robot
from calfree_gym.robot.workspace import check_near
from calfree_gym.tasks import reach

Observation = dict[str, NDArray[np.float32]]
REWARDS = {"sparse": reach.sparse_reward, "dense": reach.dense_reward}
OBSERVATIONS = ("points",)
RENDER_MODES = ("rgb_array",)


class Privileged(NamedTuple):
    """A true quantity that a controller may get beside its image points, where it asks with `tell`.

    Attributes:
        size: How many numbers, for an arm.
        bound: Of their magnitude, for an arm.
        of: Gives them for all rows (N, size).
    """

    size: Callable[[Robot], int]
    bound: Callable[[Robot], float]
    of: Callable[[StereoArms], NDArray[np.float64]]


PRIVILEGED = {
    "joint_angles": Privileged(
        lambda robot: len(robot.built_home),
        lambda robot: max(2 * np.pi, 1.1 * float(np.abs(robot.stops).max())),  # repeatability passes stops
        lambda arms: arms.simulation.joints(),
    ),
    "joint_zeros": Privileged(
        lambda robot: len(robot.joints),
        lambda robot: np.pi,
        lambda arms: np.stack([arms.world(r).joint_zeros for r in range(arms.rows)]),
    ),
    "gripper_position": Privileged(
        lambda robot: 3,
        lambda robot: max(5.0, float(np.abs(robot.rig.target).max()) + 4 * robot.rig.scale),
        lambda arms: arms.simulation.positions()[0],
    ),
    "object_registers": Privileged(
        lambda robot: len(robot.motors), lambda robot: 1.0, lambda arms: arms.object_registers()
    ),
}
"""True joint positions (rad or m; of the RV-M2 J1-J5), joint zeros (of the RV-M2 J1-J4), the gripper point in
the room (m), and the registers that bring the gripper to the object."""


def observation_space(tell: Sequence[str], robot: Robot) -> spaces.Dict[Any]:
    """The observations of one arm, with the privileged quantities that `tell` names."""
    sizes = {"achieved_goal": 4, "desired_goal": 4, "observation": 4 + len(robot.motors)}
    boxes: dict[str, spaces.Space[Any]] = {
        key: spaces.Box(-1.0, 1.0, (size,), np.float32) for key, size in sizes.items()
    }
    for name in tell:
        quantity = PRIVILEGED[name]
        boxes[name] = spaces.Box(
            -quantity.bound(robot), quantity.bound(robot), (quantity.size(robot),), np.float32
        )
    return spaces.Dict(boxes)


def action_space(robot: Robot) -> spaces.Box[Any]:
    """The control words of one arm."""
    return spaces.Box(-1.0, 1.0, (len(robot.motors),), np.float32)


def control_words(action: Any, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Control words from an action, clipped to [-1, 1].

    Raises:
        ValueError: The action has another shape, or is not finite.
    """
    try:
        words = np.asarray(action, np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"the action is {action!r}; it must be numbers of shape {shape}") from None
    if words.shape != shape:
        raise ValueError(f"the action has shape {words.shape}; it must be {shape}, one word a motor")
    if np.maximum.reduce(np.abs(words), axis=None) <= 1:
        return words
    if not np.isfinite(words).all():
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(words))[0])
        raise ValueError(f"the action at {where} is {words[where]}; control words must be finite, in [-1, 1]")
    return np.clip(words, -1.0, 1.0)


class StereoArmGoal(Copyable):
    """What the single and the batched environment share: arguments, observations, rewards."""

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
        arm: ArmChoice,
        **arms: Any,
    ) -> None:
        check_choice("reward", reward, tuple(REWARDS))
        check_choice("observation", observation, OBSERVATIONS)
        if isinstance(tell, str):
            raise ValueError(f"tell is {tell!r}; it must be a sequence of names, such as ({tell!r},)")
        for name in tell:
            check_choice("tell", name, tuple(PRIVILEGED))
        if render_mode is not None:
            check_choice("render_mode", render_mode, RENDER_MODES)
        self._arm = Arm.from_dict(arm) if isinstance(arm, Mapping) else arm
        self._arguments = {"rows": rows, "threads": threads, **arms}
        self.arms = self._new_arms()
        self.render_mode = render_mode
        self._ends = terminate_on_success
        self._tell = tuple(tell)
        if not isinstance(truth, bool):
            raise ValueError(f"truth is {truth!r}; allowed: True, False")
        self._gives_truth = truth
        self.tolerance_px = float(arms["tolerance_px"])
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

    def _outcome(self) -> tuple[Observation, NDArray[np.float32], NDArray[np.bool_]]:
        """The last observation: batched observations, image distances (N, 2), and rendezvous (N,)."""
        points, visible = self.arms.delivered
        goals = points.astype(np.float32).reshape(-1, 8)
        distances = reach.image_distances(goals[:, :4], goals[:, 4:])
        state = np.empty((self.arms.rows, 4 + self.arms.registers.shape[1]), np.float32)
        state[:, :4] = visible
        state[:, 4:] = self.arms.registers
        observation = {"achieved_goal": goals[:, :4], "desired_goal": goals[:, 4:], "observation": state}
        for name in self._tell:
            observation[name] = PRIVILEGED[name].of(self.arms).astype(np.float32)
        return observation, distances, reach.rendezvous(distances, self.arms.tolerance)

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
            gym.logger.warn("render() shows nothing without render_mode='rgb_array'; give it to gym.make")
            return None
        if self._renderer is None:
            from calfree_gym.envs.rendering import SceneRenderer

            self._renderer = SceneRenderer()
        frame: NDArray[np.uint8] = self._renderer.draw(self.arms, row)
        return frame

    def _free_renderer(self) -> None:
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


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
