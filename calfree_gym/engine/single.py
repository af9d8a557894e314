"""The single environment: row 0 of the engine, as a Gymnasium environment."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from calfree_gym.engine.arms import Events, RowState
from calfree_gym.engine.config import RENDER_MODES, Config
from calfree_gym.engine.environment import Environment
from calfree_gym.engine.spaces import Observation, control_words
from calfree_gym.perturbations.base import Perturbation
from calfree_gym.perturbations.schedule import Applied, Undo
from calfree_gym.world import World


class ArmEnv(Environment, gym.Env[Any, Any]):
    """One arm: what a single environment of any task has."""

    metadata = {"render_modes": list(RENDER_MODES), "render_fps": 2}  # noqa: RUF012
    applied: list[Perturbation | Undo]
    """The perturbations that were applied before the last motion, with all that they drew."""

    def _build(self, config: Config) -> None:
        self._make(config, rows=1, threads=1)
        self.observation_space, self.action_space = self.arms.make_spaces()
        self._action_shape = tuple(self.action_space.shape or ())
        self.applied = []

    @property
    def world(self) -> World:
        """The hidden world. For experiments, not for controllers."""
        return self.arms.world(0)

    @world.setter
    def world(self, world: World) -> None:
        self.set_world(world)

    @property
    def home_seconds(self) -> float:
        """Robot time of the way home from here, as `info["robot_seconds"]` is of a motion."""
        return float(self.arms.home_seconds()[0])

    def set_world(self, world: World) -> None:
        """Puts the robot into `world`; later seeds draw objects and noise only.

        Raises:
            TypeError: It is no `World`.
            ValueError: It is that of another arm, or not in view.
        """
        self.arms.set_world(0, world)

    def get_state(self) -> RowState:
        """All that the next steps and resets follow from, apart from the arguments: for planners.

        It can be pickled, and shares nothing with the environment. Wrappers, such as `TimeLimit`, keep counts
        of their own.

        Raises:
            gymnasium.error.ResetNeeded: No trial has begun.
        """
        self.arms.check_begun()
        return self.arms.get_state(0)

    def set_state(self, state: RowState) -> None:
        """Goes back to a state that `get_state` gave here, or in an environment of the same arguments.

        Raises:
            ValueError: It is no state, or that of another arm.
        """
        self.arms.set_state(0, state)
        self.arms.simulation.refresh()
        self.applied = []

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins a trial, see the class.

        Raises:
            ValueError: An option is not allowed, or no world or object can be drawn; says which.
        """
        objects = self.arms.objects_of(options)
        super().reset(seed=seed)
        if seed is None and self.arms.needs_seed(0):
            seed = int(self.np_random.integers(2**31))
        if seed is not None:
            self.arms.seed(0, seed)
        applied = self.arms.begin_trial(slice(None), objects)
        self.arms.observe()
        observation, _, success = self.arms.outcome()
        info = self._info(success, np.float64(0.0), applied, self.arms.events())
        self._show()
        return {key: value[0] for key, value in observation.items()}, info

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Executes one motion, see the class.

        Raises:
            gymnasium.error.ResetNeeded: No trial has begun.
            ValueError: Words are not finite, or have another shape.
        """
        seconds, applied = self.arms.move(slice(None), control_words(action, self._action_shape))
        self.arms.observe()
        observation, distances, success = self.arms.outcome()
        events = self.arms.events()
        self._show()
        return (
            {key: value[0] for key, value in observation.items()},
            float(self._reward(distances, success)[0]),
            self._ends and bool(success[0]),
            bool(self.arms.cut_short(events)[0]),
            self._info(success, seconds[0], applied, events),
        )

    def render(self) -> NDArray[np.uint8] | None:
        """The scene, and at its side the camera images with the image points (height, width, 3).

        Coloured rings are the points as observed; a thin one was seen there last, and is not seen now. The
        white ring around the object's point is the tolerance. With render_mode="human" MuJoCo's viewer shows
        the arm, and nothing is returned.

        Raises:
            gymnasium.error.DependencyNotInstalled: OpenGL or a screen is missing; names what to install.
        """
        return self._frame(0)

    def _info(
        self, success: Any, seconds: np.float64, applied: list[Applied], events: Events
    ) -> dict[str, Any]:
        self.applied = [perturbation for _, perturbation in applied]
        info: dict[str, Any] = {
            "is_success": np.array(success[0]),  # a numpy.bool would become an object in vector infos
            "robot_seconds": seconds,
            "perturbed": np.int64(len(applied)),
        } | {key: value[0] for key, value in events.items()}
        if self._gives_truth:
            info["truth"] = {key: value[0] for key, value in self.arms.truth().items()}
        return info

    def close(self) -> None:
        """Frees the renderer."""
        self._close()
