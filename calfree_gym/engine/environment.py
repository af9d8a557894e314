"""What the single and the batched environment share: an engine of N arms, frames, copies and goals."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from enum import Enum
from functools import wraps
from os import PathLike, fspath
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from calfree_gym.engine.arms import Arms
from calfree_gym.engine.config import RENDER_MODES, Config, constructor
from calfree_gym.engine.frames import SceneFrame, Viewer
from calfree_gym.engine.spaces import GOALS, dense_reward, sparse_reward
from calfree_gym.world import WorldDistribution


def of_goals(method: Callable[..., Any]) -> Any:
    """Makes a method one that environments lack which observe images: these have no goals."""

    @property  # type: ignore[misc]
    @wraps(method)
    def bound(self: Environment) -> Any:
        if self.config.observation not in GOALS:
            raise AttributeError(f"there are no goals, and so no {method.__name__}, with images")
        return method.__get__(self)

    return bound


class Environment:
    """A task of N arms, as an environment. Reward and end are pure functions of goals, where there are any.

    Pickle and deepcopy copy it, in mid-trial too: the copy goes on, bit by bit, as it would have. MuJoCo's
    simulation cannot be pickled. So a copy makes its own, and brings every row into its state.

    Attributes:
        task: What is asked, by the name that agents have for it: "reach", "grasp", "insert" or "dock".
        config: The arguments, checked.
        arms: The N arms.
    """

    task: ClassVar[str]
    arms_of: ClassVar[Any]
    """The class of the arms: it takes rows, threads and config."""
    frame_of: ClassVar[Any] = SceneFrame
    viewer_of: ClassVar[Any] = Viewer
    """What draws the arms: into an array, and into a window."""
    configs: ClassVar[tuple[type, ...]] = ()
    """Dataclasses of arguments that come before those of the task."""
    config: Config
    arms: Arms

    def __init_subclass__(cls, arms: type[Arms] | None = None, **kwargs: Any) -> None:
        """Makes a class of a task, that of these arms: writes its constructor."""
        super().__init_subclass__(**kwargs)
        if arms is not None:
            cls.arms_of, cls.task = arms, arms.task
            cls.__init__ = constructor(cls, *cls.configs, arms.config_of)  # type: ignore[method-assign]

    def _make(self, config: Config, rows: int, threads: int) -> None:
        """Keeps the arguments of the task, and makes the arms."""
        self.config = config
        self.render_mode = config.render_mode
        self._ends, self._gives_truth = config.terminate_on_success, config.truth
        self._reward = sparse_reward if config.reward == "sparse" else dense_reward
        self._renderer: Any = None
        self._spec: EnvSpec | None = None
        self._size = rows, threads
        self.arms = self._new_arms()

    @property
    def tolerance_px(self) -> float:
        """Of the rendezvous; an argument, which does not change."""
        return float(self.config.tolerance_px)

    def _new_arms(self) -> Arms:
        arms: Arms = self.arms_of(*self._size, self.config)
        return arms

    def __getstate__(self) -> dict[str, Any]:
        rows = [self.arms.get_state(row) for row in range(self.arms.rows)]
        return {**vars(self), "arms": rows, "_renderer": None}

    def __setstate__(self, copied: dict[str, Any]) -> None:
        vars(self).update(copied)
        self.arms = self._new_arms()
        for row, state in enumerate(copied["arms"]):
            self.arms.set_state(row, state)
        self.arms.simulation.refresh()

    @property
    def spec(self) -> EnvSpec | None:
        """How `gymnasium.make` made it, by plain arguments: `to_json` is exact."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None:
            arm = {"arm": getattr(self.config, "arm", None)} if "arm" in spec.kwargs else {}
            spec = replace(spec, kwargs=plain(spec.kwargs | arm))
        self._spec = spec

    def is_solved(self, truth: Mapping[str, Any]) -> bool:
        """Whether the truth of an arm's info says that the task is done."""
        return self.arms.is_solved(truth)

    @of_goals
    def compute_reward(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """The reward (...) for goals (..., g); pure, and what `step` returns."""
        return self._reward(*self.arms.judged(achieved_goal, desired_goal))

    @of_goals
    def compute_terminated(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """Whether a trial ends (...) at goals (..., g); pure, and what `step` returns."""
        done = self.arms.judged(achieved_goal, desired_goal)[1]
        return done if self._ends else np.zeros_like(done)

    @of_goals
    def compute_truncated(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """False: what else ends a trial cannot be told from goals."""
        return np.zeros(np.shape(achieved_goal)[:-1], bool)

    def _frame(self, row: int) -> NDArray[np.uint8] | None:
        if self.render_mode is None:
            gym.logger.warn(
                "render() shows nothing without a render_mode; give one to gym.make: "
                + ", ".join(RENDER_MODES)
            )
            return None
        if self._renderer is None:
            if self.render_mode == "human":
                self._renderer = self.viewer_of(self.arms)
            else:
                size, in_images = (self.config.width, self.config.height), self.config.observation != "points"
                self._renderer = self.frame_of(self.arms, *size, in_images)
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
