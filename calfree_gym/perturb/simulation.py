"""Where environments keep their MuJoCo model, which camera they render, and where their robots rest."""

from __future__ import annotations

from typing import Any, NamedTuple, TypeGuard

import gymnasium as gym
import mujoco
import numpy as np
from gymnasium.wrappers import RescaleAction
from numpy.typing import ArrayLike

from calfree_gym.geometry import Array

Env = gym.Env[Any, Any]
FREE = -1
"""Number of the camera of MuJoCo's viewer, which is none of the model's."""
HOW_TO = """no MuJoCo model is found behind {env}. If it has one, say where:

    from calfree_gym.perturb import Adapter, Perturb

    class Mine(Adapter):
        def simulation(self, env):  # MuJoCo's own MjModel and MjData
            return env.unwrapped.sim.model, env.unwrapped.sim.data

        def camera(self, env):  # name or number of the camera that render() shows
            return "front"

    Perturb(env, schedule, adapter=Mine())

CalFree's own environments take the schedule themselves: gym.make(..., perturbations=schedule)."""


class FoundSimulation(NamedTuple):
    """MuJoCo's own MjModel and MjData."""

    model: Any
    data: Any


class Adapter:
    """How `Perturb` finds what it must know: of Gymnasium, Gymnasium-Robotics and MetaWorld."""

    def simulation(self, env: Env) -> tuple[Any, Any]:
        """MuJoCo's own MjModel and MjData; an AttributeError says that the environment is another one."""
        made: Any = env.unwrapped
        return made.model, made.data

    def camera(self, env: Env) -> str | int:
        """Name or number of the model's camera that `render()` shows; `FREE`: none of these."""
        renderer = getattr(env.unwrapped, "mujoco_renderer", None)
        return FREE if env.render_mode == "human" else getattr(renderer, "camera_id", FREE)

    def rest(self, env: Env) -> ArrayLike | None:
        """The action (m,) that leaves a robot where it is after a reset; None: the middle of each range.

        Here it is where position servos stand, if actions are their targets, also as Gymnasium's
        `RescaleAction` scales them.
        """
        model, data = self.simulation(env)
        outer: Any = env.action_space
        ranges = model.actuator_ctrlrange.T
        while not _is_box_of(env.action_space, ranges):
            if not _only_rescales(env):
                return None
            env = env.env
        stiffness = -model.actuator_biasprm[:, 1]
        servos = (stiffness > 0) & (stiffness == model.actuator_gainprm[:, 0])
        rest = np.where(servos, data.actuator_length, ranges.mean(0))
        box: Any = env.action_space
        if outer == box:
            return rest
        share = (rest - box.low) / np.where(box.high > box.low, box.high - box.low, 1)
        return outer.low + share * (outer.high - outer.low)


def _is_box_of(space: gym.Space[Any], ranges: Array) -> bool:
    """Whether actions are in these ranges (2, m), as exactly as they are told."""
    return (
        isinstance(space, gym.spaces.Box)
        and space.shape == ranges.shape[1:]
        and np.array_equal([space.low, space.high], ranges.astype(space.dtype))
    )


def _only_rescales(env: Env) -> TypeGuard[gym.Wrapper[Any, Any, Any, Any]]:
    """Whether it is a wrapper that gives actions on as they are, or as they are in another box."""
    if isinstance(env, gym.ActionWrapper):
        return isinstance(env, RescaleAction)
    return isinstance(env, gym.Wrapper) and env.action_space == env.env.action_space


class DmControl(Adapter):
    """The same, in environments of dm_control, as Shimmy makes them."""

    def simulation(self, env: Env) -> tuple[Any, Any]:
        """See `Adapter`."""
        made: Any = env.unwrapped
        return made._env.physics.model.ptr, made._env.physics.data.ptr

    def camera(self, env: Env) -> str | int:
        """See `Adapter`."""
        made: Any = env.unwrapped
        return FREE if env.render_mode == "human" else made.render_kwargs.get("camera_id", FREE)


class Aloha(DmControl):
    """The same, in gym-aloha, whose actions are positions."""

    def camera(self, env: Env) -> str | int:
        """See `Adapter`."""
        return "top"

    def rest(self, env: Env) -> ArrayLike | None:
        """See `Adapter`."""
        control: Any = env.unwrapped._env  # type: ignore[attr-defined]
        return np.asarray(control.task.get_qpos(control.physics))


class SO101(Adapter):
    """The same, in lerobot-env-so101."""

    def camera(self, env: Env) -> str | int:
        """See `Adapter`."""
        made: Any = env.unwrapped
        return made._render_specs.camera_id


FAMILIES: dict[str, Adapter] = {
    "gym_aloha": Aloha(),
    "shimmy": DmControl(),
    "lerobot_env_so101": SO101(),
}
"""Adapters by the package that an environment's class is of."""


def adapter_of(env: Env) -> Adapter | None:
    """The adapter of an environment; None where it has no MuJoCo model that we know how to find."""
    packages = (cls.__module__.partition(".")[0] for cls in type(env.unwrapped).__mro__)
    adapter = next((FAMILIES[name] for name in packages if name in FAMILIES), Adapter())
    try:
        model, data = adapter.simulation(env)
    except AttributeError:
        return None
    return adapter if isinstance(model, mujoco.MjModel) and isinstance(data, mujoco.MjData) else None


def find_simulation(env: Env) -> FoundSimulation:
    """The model behind an environment, and its data.

    Raises:
        ValueError: None is found; says how to write an adapter.
    """
    wrapper: Any = env
    while not (found := getattr(wrapper, "adapter", None)) and isinstance(wrapper, gym.Wrapper):
        wrapper = wrapper.env
    adapter = found or adapter_of(env)
    if adapter is None:
        raise ValueError(HOW_TO.format(env=type(env.unwrapped).__name__))
    return FoundSimulation(*adapter.simulation(env))
