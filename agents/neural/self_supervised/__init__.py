"""Networks that teach themselves, from their own motions, which control words bring about which change."""

from ...base.agent import Agent
from .cooperstock_milios import CooperstockMilios
from .self_supervised import SelfSupervised

AGENTS: dict[str, type[Agent]] = {
    "self_supervised": SelfSupervised,
    "cooperstock_milios": CooperstockMilios,
}
"""The agents of this package by name."""

__all__ = ["AGENTS", "CooperstockMilios", "SelfSupervised"]
