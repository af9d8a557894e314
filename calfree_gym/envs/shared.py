"""What the single and the batched environment share: arguments, outcomes, truth and frames."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from enum import Enum
from os import PathLike, fspath
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from calfree_gym.envs.arms.base import Arms
from calfree_gym.envs.arms.privileged import PRIVILEGED
from calfree_gym.envs.arms.state import Copyable
from calfree_gym.envs.rendering.scene_frame import SceneFrame, check_size
from calfree_gym.envs.rendering.viewer import Viewer
from calfree_gym.envs.spaces import Observation
from calfree_gym.errors import check_choice, check_flag, check_whole
from calfree_gym.perturbations.schedule import parse_schedule
from calfree_gym.tasks import goals
from calfree_gym.tasks.reach import MOST_TOLERANCE
from calfree_gym.world import WorldDistribution

REWARDS = {"sparse": goals.sparse_reward, "dense": goals.dense_reward}
Events = dict[str, NDArray[Any]]
RENDER_MODES = ("rgb_array", "human")
REDRAWS = ("never", "trial")
SMALLEST_IMAGE, LARGEST_IMAGE = 16, 1024
"""Width and height in pixels of images that are delivered."""


class ArmShared(Copyable, ABC):
    """What the single and the batched environment share."""

    def _build(
        self,
        rows: int,
        threads: int,
        *,
        observation: str,
        terminate_on_success: bool,
        tell: Sequence[str],
        truth: bool,
        reward: str,
        render_mode: Any,
        width: int,
        height: int,
        **arms: Any,
    ) -> None:
        """Checks and keeps arguments, and makes the arms; `arms` are those of the task's own."""
        check_choice("reward", reward, tuple(REWARDS))
        check_choice("redraw", arms["redraw"], REDRAWS)
        check_flag("truth", truth)
        check_flag("terminate_on_success", terminate_on_success)
        check_flag("keep_in_view", arms["keep_in_view"])
        check_whole("image_size", arms["image_size"], SMALLEST_IMAGE, LARGEST_IMAGE)
        tolerance_px = arms["tolerance_px"]
        is_number = isinstance(tolerance_px, int | float | np.number) and not isinstance(tolerance_px, bool)
        if not (is_number and 0 < tolerance_px < MOST_TOLERANCE):
            raise ValueError(
                f"tolerance_px is {tolerance_px!r}; it must be a number in (0, {MOST_TOLERANCE})"
            )
        if isinstance(tell, str) or not isinstance(tell, Sequence):
            such = tell if isinstance(tell, str) else next(iter(PRIVILEGED))
            raise ValueError(f"tell is {tell!r}; it must be a sequence of names, such as ({such!r},)")
        for name in tell:
            check_choice("tell", name, tuple(PRIVILEGED))
        if render_mode is not None:
            check_choice("render_mode", render_mode, RENDER_MODES)
        check_size(width, height)
        self._frame_size = width, height
        self.render_mode = render_mode
        self._kind, self._ends = observation, terminate_on_success
        self._tell = tuple(tell)
        self._gives_truth = truth
        self.tolerance_px = float(tolerance_px)
        self._reward = REWARDS[reward]
        self._renderer: Any = None
        self._spec: EnvSpec | None = None
        arms["perturbations"] = parse_schedule(arms["perturbations"])  # an iterator would be used up
        self._arguments = {"rows": rows, "threads": threads, **arms}
        self.arms = self._new_arms()

    @abstractmethod
    def _new_arms(self) -> Arms:
        """Arms of the arguments."""

    @abstractmethod
    def _spaces(self) -> tuple[spaces.Dict[Any], spaces.Box[Any]]:
        """Observations and actions of one arm."""

    @abstractmethod
    def is_solved(self, truth: Mapping[str, Any]) -> bool:
        """Whether the truth of an arm's info says that the task is done."""

    @abstractmethod
    def _placed(self, options: dict[str, Any] | None) -> NDArray[np.float64] | None:
        """The objects of reset's options (N, ...), or None without them."""

    @property
    def spec(self) -> EnvSpec | None:
        """How `gymnasium.make` made it, by plain arguments: `to_json` is exact."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None:
            arm = {"arm": self._arguments["arm"]} if "arm" in spec.kwargs else {}
            spec = replace(spec, kwargs=plain(spec.kwargs | arm))
        self._spec = spec

    @abstractmethod
    def _outcome(self) -> tuple[Observation, NDArray[Any], NDArray[np.bool_]]:
        """The last observation: batched observations, image distances (N, 2), and success (N,)."""

    @abstractmethod
    def _judged(self, achieved: Any, desired: Any) -> tuple[Any, Any]:
        """Image distances (..., 2) of goals (..., g), and whether the task is done (...); pure."""

    @abstractmethod
    def _truth(self) -> dict[str, Any]:
        """What is true of all rows: arrays (N, ...)."""

    def _events(self) -> Events:
        """What else infos tell of the last motion: arrays (N,)."""
        return {}

    def _cut_short(self, events: Events) -> NDArray[np.bool_]:
        """Where (N,) the trial cannot go on, by what `_events` tells."""
        return np.zeros(self.arms.rows, bool)

    def _frame(self, row: int) -> NDArray[np.uint8] | None:
        if self.render_mode is None:
            gym.logger.warn(
                "render() shows nothing without a render_mode; give one to gym.make: "
                + ", ".join(RENDER_MODES)
            )
            return None
        if self._renderer is None:
            human, in_images = self.render_mode == "human", self._kind != "points"
            self._renderer = (
                Viewer(self.arms) if human else SceneFrame(self.arms, *self._frame_size, in_images)
            )
        frame: NDArray[np.uint8] | None = self._renderer.draw(row)
        return frame

    def _show(self) -> None:
        """Shows people what has just happened, as Gymnasium asks of render_mode="human"."""
        if self.render_mode == "human":
            self._frame(0)

    def _close(self) -> None:
        """Frees what draws."""
        self.arms.close()
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


class GoalRewards(ArmShared):
    """What a goal environment has besides: reward and end as pure functions of goals."""

    def compute_reward(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """The reward (...) for goals (..., g); pure, and what `step` returns."""
        return self._reward(*self._judged(achieved_goal, desired_goal))

    def compute_terminated(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """Whether a trial ends (...) at goals (..., g); pure, and what `step` returns."""
        done = self._judged(achieved_goal, desired_goal)[1]
        return done if self._ends else np.zeros_like(done)

    def compute_truncated(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """False: what else ends a trial cannot be told from goals."""
        return np.zeros(np.shape(achieved_goal)[:-1], bool)


def plain(value: Any) -> Any:
    """A value as numbers, text, lists and dicts, which environments take in its place.

    Worlds, arms, perturbations and events become the dicts of their `to_dict`.
    """
    if hasattr(value, "to_dict"):
        return plain(value.to_dict())
    if isinstance(value, Mapping):
        return {name: plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, WorldDistribution):
        return value.name
    if isinstance(value, Enum):
        return value.value
    return fspath(value) if isinstance(value, PathLike) else value
