"""Agents by name."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from inspect import Parameter
from pathlib import Path
from pkgutil import walk_packages
from typing import Any

import gymnasium as gym

from calfree_gym.errors import check_choice, near_misses, to_install

from .base.agent import Agent
from .base.prior_knowledge import PriorKnowledge
from .base.registration import AGENTS, NamedAgent
from .grasp.observation import task_of

READ_FIRST = (
    "reference.bounds",
    "servo.paper",
    "servo.jacobian_servo",
    "servo.unified",
    "servo.work_plane",
    "knowledge.learning_servo",
    "servo.safe.safe_start",
    "knowledge.grid_table",
    "knowledge.factored_table",
    "knowledge.support_points",
    "memory.memory",
    "rivals.polynomial",
    "rivals.simulation_prior",
    "body_schema.body_schema",
    "servo.joint_space",
    "calibrated.affine_stereo",
    "calibrated.model_based",
    "calibrated.self_calibrating",
    "grasp.grasp",
    "docking.oracle",
    "docking.servo",
    "docking.arcs",
    "neural",
    "neural.self_supervised",
)
"""In this order tables show agents; those of other files follow."""
_PACKAGE = __name__.rpartition(".")[0]
for module in READ_FIRST:
    import_module(f"{_PACKAGE}.{module}")
for found in walk_packages([str(Path(__file__).parent)], f"{_PACKAGE}."):
    loads_more = found.name.startswith(f"{_PACKAGE}.neural.")  # only when an agent is made
    if not loads_more and not found.name.endswith(".train"):  # which is a command
        import_module(found.name)

NEURAL = tuple(name for name, known in AGENTS.items() if known.extra)
"""Agents that load torch, and need what the extra `agents` of the wheel installs."""
ARM, ARM_MOTORS = "movemaster", 3
"""Name of the built-in arm, and how many motors it has."""


def tasks() -> tuple[str, ...]:
    """What there are agents for: "reach", "grasp", "insert" and "dock"."""
    return tuple(dict.fromkeys(task for known in AGENTS.values() for task in known.tasks))


def names(task: str = "reach") -> tuple[str, ...]:
    """The names that `make` knows of agents that do a task, one of `tasks()`.

    Raises:
        ValueError: There is no such task.
    """
    check_choice("task", task, tasks())
    return tuple(name for name, known in AGENTS.items() if task in known.tasks)


def named(name: str) -> NamedAgent:
    """What stands under a name; for "my_module:mine" `my_module` is imported first, as in `gym.make`.

    Raises:
        ValueError: An unknown name, with the near misses, or there is no such module.
    """
    module, _, own = name.rpartition(":")
    if module:
        _import(module, name)
    if own not in AGENTS:
        raise ValueError(f"unknown agent {name!r}{near_misses(own, AGENTS)}; allowed: {', '.join(AGENTS)}")
    return AGENTS[own]


def make(name: str, env: gym.Env[Any, Any], **settings: Any) -> Agent:
    """Makes the agent `name` for `env`.

    Args:
        name: One of `names()`; or "my_module:mine", where `my_module` names a class by `@agent("mine", ...)`.
        env: The environment that it learns in, and whose spaces it acts in; for a learner of
            stable-baselines3 also a batched one.
        **settings: Of the agent; `seed` for all.

    Raises:
        ModuleNotFoundError: The agent is one of `NEURAL`, and what it needs is not installed; says how.
        ValueError: An unknown name, with the near misses, a setting that is not allowed, an arm that the
            agent does not know, with the agents that act on any, or no environment with image points.
    """
    found = named(name)
    with _told_whose(name):
        task = task_of(env)
    known, shape = found.of(task), getattr(getattr(env, "action_space", None), "shape", None)
    if shape is None or (len(shape) != 1 and not known.batched):
        raise ValueError(f"agent {name!r} acts in one environment at a time; this one's actions are {shape}")
    if task in known.tasks:
        _check_arm(name, known, env)
    with _told_what_to_install(name):
        settings = known.defaults(settings) | settings
        _known_settings(name, known, settings)
        if task not in known.tasks:
            raise ValueError(
                f"agent {name!r} cannot {task}, as this environment asks; allowed: {', '.join(names(task))}"
            )
        with _told_whose(name):
            made: Agent = known.kind.make(env, **known.fixed, **settings)
        made.name = name
        return made


def default_settings(name: str, **given: Any) -> dict[str, Any]:
    """What `make(name, env, **given)` makes an agent with; settings without a default only if given.

    Raises:
        ModuleNotFoundError: The agent is one of `NEURAL`, and what it needs is not installed; says how.
        ValueError: An unknown name, with the near misses, or a setting that is not allowed.
    """
    known = named(name)
    with _told_what_to_install(name):
        chosen = known.defaults(given) | given
        settings = _known_settings(name, known, chosen) | chosen
    return {setting: value for setting, value in settings.items() if value is not Parameter.empty}


def learns_by_rewards(name: str) -> bool:
    """Whether an agent learns by rewards, and so from many motions.

    Raises:
        ModuleNotFoundError: The agent is one of `NEURAL`, and what it needs is not installed; says how.
        ValueError: An unknown name, with the near misses.
    """
    known = named(name)
    with _told_what_to_install(name):
        return PriorKnowledge.REWARD in known.kind.prior_knowledge


def _known_settings(name: str, known: NamedAgent, chosen: dict[str, Any]) -> dict[str, Any]:
    """All settings of an agent and their defaults; raises ValueError where one that is chosen is none."""
    with _told_whose(name):
        allowed = known.settings(chosen)
    for setting in chosen:
        if setting not in allowed:
            found = f"agent {name!r} has no setting {setting!r}{near_misses(setting, allowed)}"
            raise ValueError(f"{found}; allowed: {', '.join(allowed)}")
    return allowed


def _import(module: str, name: str) -> None:
    if not all(part.isidentifier() for part in module.split(".")):
        raise ValueError(f"agent {name!r}: {module!r} is no name of a module; allowed: my_module:my_agent")
    try:
        import_module(module)
    except ModuleNotFoundError as error:
        if f"{module}.".startswith(f"{error.name}."):
            raise ValueError(
                f"agent {name!r}: Python finds no module {error.name!r}; is PYTHONPATH set?"
            ) from error
        raise


def _check_arm(name: str, agent: NamedAgent, env: gym.Env[Any, Any]) -> None:
    """Raises where an agent knows no other arm than the built-in one, and this is another."""
    spec, motors = getattr(env, "spec", None), env.action_space.shape[-1]  # type: ignore[index]
    arm = spec.kwargs.get("arm", ARM) if spec is not None else ARM
    if agent.arms != ARM or (isinstance(arm, str) and arm == ARM and motors == ARM_MOTORS):
        return
    of_any = ", ".join(known for known in names() if not AGENTS[known].arms)
    of_some = [
        f"{known} with {AGENTS[known].arms}" for known in names() if AGENTS[known].arms not in ("", ARM)
    ]
    raise ValueError(
        f"agent {name!r}: {name} is built on the arm {ARM!r}, and this is another one, of {motors} "
        f"motors; allowed with any arm: {of_any}; {'; '.join(of_some)}"
    )


@contextmanager
def _told_whose(name: str) -> Iterator[None]:
    try:
        yield
    except (TypeError, ValueError) as error:
        raise ValueError(f"agent {name!r}: {error}") from error


@contextmanager
def _told_what_to_install(name: str) -> Iterator[None]:
    try:
        yield
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"agent {name!r} needs {error.name}, which is not installed: {to_install('agents')}",
            name=error.name,
        ) from error
