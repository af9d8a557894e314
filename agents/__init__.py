"""Controllers of the black box, made by name: `agents.make("grid_table", env, cells=8)`."""

from agents.base.agent import Agent
from agents.registry import KNOWLEDGE, NEURAL, SERVOS, default_settings, make, names

__all__ = ["KNOWLEDGE", "NEURAL", "SERVOS", "Agent", "default_settings", "make", "names"]
