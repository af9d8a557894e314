"""Networks that teach themselves, from their own motions, which control words bring about which change."""

from .self_taught import CooperstockMilios, SelfSupervised

__all__ = ["CooperstockMilios", "SelfSupervised"]
