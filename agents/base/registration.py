"""Agents under their names: what one is, and which settings it takes, is said where its class is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import Any, TypeVar

Settings = dict[str, Any]
C = TypeVar("C")
AGENTS: dict[str, NamedAgent] = {}
"""All of them, by their names."""
SERVOS: dict[str, type[Any]] = {}
"""The servos that knowledge can be laid over, by name."""
KNOWLEDGE: dict[str, type[Any]] = {}
"""Knowledge bases by name; `memory` is the best of them."""


@dataclass(frozen=True)
class NamedAgent:
    """An agent under its name.

    Attributes:
        does: What it does, in one line of a page of docs/.
        where: Its class, or the path of one that is loaded only when it is needed: "neural.sb3.Sb3Agent".
        own_tasks: What it does: "reach", "grasp", "insert" or "dock".
        extra: Which optional packages it needs, by the name of an extra of the wheel.
        arms: Where it does not act with any arm, with which; the name of one where it is built on what that
            arm's motors do.
        batched: Whether it also learns in a batched environment.
        fixed: Settings of the class that the name says, so that nobody gives them.
        defaults: From the settings that are given to those that it has otherwise than its class.
        elsewhere: What stands under the same name for other tasks, by the task.
    """

    does: str
    where: Any
    own_tasks: tuple[str, ...]
    extra: str
    arms: str
    batched: bool
    fixed: Settings
    defaults: Callable[[Settings], Settings]
    elsewhere: Mapping[str, NamedAgent] = field(default_factory=dict)

    @property
    def tasks(self) -> tuple[str, ...]:
        """All that is done under its name."""
        return (*self.own_tasks, *self.elsewhere)

    def of(self, task: str) -> NamedAgent:
        """What does a task under its name; itself, where nothing does."""
        return self.elsewhere.get(task, self)

    @property
    def kind(self) -> Any:
        """The class."""
        if isinstance(self.where, str):
            module, name = self.where.rsplit(".", 1)
            return getattr(import_module(f"..{module}", __package__), name)
        return self.where

    def settings(self, given: Settings) -> Settings:
        """All settings that it takes beside those that are given, with their defaults."""
        known: Settings = self.kind.settings(given | self.fixed)
        return {name: default for name, default in known.items() if name not in self.fixed}


def agent(
    name: str,
    does: str,
    *,
    tasks: tuple[str, ...] = ("reach",),
    extra: str = "",
    arms: str = "",
    batched: bool = False,
    fixed: Mapping[str, Any] | None = None,
    defaults: Callable[[Settings], Settings] = lambda given: {},
) -> Callable[[C], C]:
    """Puts the class that follows under a name, see `NamedAgent`; what does other tasks may stand there too.

    Raises:
        TypeError: The class has no `settings`, as `agents.Agent` and what derives from it have.
        ValueError: Another class stands there already that does one of these tasks.
    """

    def named(where: C) -> C:
        if not isinstance(where, str) and not hasattr(where, "settings"):
            raise TypeError(f"{where} must be derived from agents.Agent to be called {name!r}")
        new = NamedAgent(does, where, tasks, extra, arms, batched, dict(fixed or {}), defaults)
        first = AGENTS.setdefault(name, new)
        for task in tasks:
            there = first.of(task).where
            runs_again = str(there) == str(where)  # its module, as in a notebook
            if task in first.tasks and not runs_again:
                raise ValueError(f"{name!r} is {there} already; give {where} another name")
        if tasks == first.own_tasks:
            AGENTS[name] = replace(new, elsewhere=first.elsewhere)
        else:
            AGENTS[name] = replace(first, elsewhere={**first.elsewhere, **dict.fromkeys(tasks, new)})
        return where

    return named


def named_settings(maker: Callable[..., Any]) -> Settings:
    """Parameters of what makes an agent, with their defaults (`Parameter.empty`, where there is none)."""
    parameters = signature(maker).parameters.values()
    return {p.name: p.default for p in parameters if p.kind is not p.VAR_KEYWORD and p.name != "env"}


def tuned_settings(name: str, given: Settings | None = None) -> Settings:
    """The settings in configs/agents/NAME.yaml, whatever is given; a wheel holds these files in the package.

    They are the defaults of learners of stable-baselines3. Other agents take theirs where they are given, as
    suites do by `settings: agents/NAME.yaml`.
    """
    from calfree_gym.errors.yaml_values import read

    package = Path(__file__).parents[1]
    folders = (package / "configs", package.parent / "configs" / "agents")
    folder = next(folder for folder in folders if folder.is_dir())
    settings: Settings = read((folder / f"{name}.yaml").read_text(encoding="utf-8"))
    return settings
