"""Agents by name."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from inspect import Parameter
from typing import Any

from calfree_gym.errors import check_choice, near_misses, to_install

from ..base.agent import Agent
from ..grasp.task import TASKS, task_of
from .makers import MAKERS, SB3, Environment, make_sb3
from .settings import defaults, known_settings

NEURAL = ("recurrent_servo", "sb3", *SB3)
"""Agents that load torch, and need what the extra `agents` of the wheel installs."""
OF_TASK = {"grasp": ("random", "grasp", "sb3", *SB3), "insert": ("random", "insert", "yoshimi_allen")}
"""Agents that act in an environment whose task is another than to reach."""
_OF_OTHER_TASKS = ("grasp", "insert", "yoshimi_allen")
"""Agents that do nothing else."""
OF_ONE_ARM = ("affine_stereo", "model_based", "self_calibrating")
"""Agents that are built on what the motors of the built-in arm do."""
ARM, ARM_MOTORS = "movemaster", 3
"""Name of that arm, and how many motors it has."""


def names(task: str = "reach") -> tuple[str, ...]:
    """The names that `make` knows of agents that do a task, "reach", "grasp" or "insert".

    Raises:
        ValueError: There is no such task.
    """
    check_choice("task", task, TASKS)
    return OF_TASK.get(task) or tuple(name for name in MAKERS if name not in _OF_OTHER_TASKS)


def make(name: str, env: Environment, **settings: Any) -> Agent:
    """Makes the agent `name` for `env`.

    Args:
        name: One of `names()`.
        env: The environment that it learns in, and whose spaces it acts in; for a learner of
            stable-baselines3 also a batched one.
        **settings: Of the agent; `seed` for all.

    Raises:
        ModuleNotFoundError: The agent is one of `NEURAL`, and what it needs is not installed; says how.
        ValueError: An unknown name, with the near misses, a setting that is not allowed, an arm that the
            agent does not know, with the agents that act on any, or no environment with image points.
    """
    _check_name(name)
    try:
        task = task_of(env)
    except ValueError as error:
        raise ValueError(f"agent {name!r}: {error}") from None
    shape = getattr(env.action_space, "shape", None)
    if shape is None or (len(shape) != 1 and MAKERS[name] is not make_sb3):
        raise ValueError(f"agent {name!r} acts in one environment at a time; this one's actions are {shape}")
    _check_arm(name, env)
    with _told_what_to_install(name):
        settings = defaults(name, settings) | settings
        known_settings(name, settings)
        if name not in names(task):
            raise ValueError(
                f"agent {name!r} cannot {task}, as this environment asks; allowed: {', '.join(names(task))}"
            )
        try:
            return MAKERS[name](env, **settings)
        except (TypeError, ValueError) as error:
            raise ValueError(f"agent {name!r}: {error}") from error


def default_settings(name: str, **given: Any) -> dict[str, Any]:
    """What `make(name, env, **given)` makes an agent with; settings without a default only if given.

    Raises:
        ModuleNotFoundError: The agent is one of `NEURAL`, and what it needs is not installed; says how.
        ValueError: An unknown name, with the near misses, or a setting that is not allowed.
    """
    _check_name(name)
    with _told_what_to_install(name):
        chosen = defaults(name, given) | given
        settings = known_settings(name, chosen) | chosen
    return {setting: value for setting, value in settings.items() if value is not Parameter.empty}


def _check_name(name: str) -> None:
    if name not in MAKERS:
        hint = near_misses(name, MAKERS)
        raise ValueError(f"unknown agent {name!r}{hint}; allowed: {', '.join(MAKERS)}")


def _check_arm(name: str, env: Environment) -> None:
    """Raises where an agent knows no other arm than the built-in one, and this is another."""
    spec, motors = getattr(env, "spec", None), env.action_space.shape[-1]  # type: ignore[index]
    arm = spec.kwargs.get("arm", ARM) if spec is not None else ARM
    if name not in OF_ONE_ARM or (isinstance(arm, str) and arm == ARM and motors == ARM_MOTORS):
        return
    of_any = ", ".join(known for known in names() if known not in (*OF_ONE_ARM, "recurrent_servo"))
    raise ValueError(
        f"agent {name!r}: {name} is built on the arm {ARM!r}, and this is another one, of {motors} "
        f"motors; allowed with any arm: {of_any}; recurrent_servo with any of its network's motors"
    )


@contextmanager
def _told_what_to_install(name: str) -> Iterator[None]:
    try:
        yield
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"agent {name!r} needs {error.name}, which is not installed: {to_install('agents')}",
            name=error.name,
        ) from error
