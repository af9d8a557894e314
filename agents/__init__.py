"""Controllers of the black box, made by name: `agents.make("grid_table", env, cells=8)`."""

from agents.base.agent import Agent
from agents.registry import KNOWLEDGE, NEURAL, SERVOS, make, names

__all__ = ["KNOWLEDGE", "NEURAL", "SERVOS", "Agent", "make", "names"]
