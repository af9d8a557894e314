"""Agents by name: the one place in which this package knows that there are any."""

from importlib import import_module
from types import ModuleType


def agents_package() -> ModuleType:
    """The package of agents: `calfree_agents`, as the wheel calls it, or `agents`, as the repository does.

    Raises:
        ImportError: There is none.
    """
    for name in ("calfree_agents", "agents"):
        try:
            return import_module(name)
        except ModuleNotFoundError as error:
            if error.name != name:
                raise
    raise ImportError("there are no agents here: neither calfree_agents nor agents is installed")
