"""What each agent must know beyond its observations, as one cell of a table."""

from collections.abc import Sequence


def must_know(privileged: Sequence[str], prior_knowledge: Sequence[str]) -> str:
    """An agent's privileged observations in back-quotes, then what it declares to be built on.

    Args:
        privileged: By the names of `tell=`.
        prior_knowledge: Words of `agents.base.prior_knowledge.PriorKnowledge`, in its order.
    """
    return ", ".join([*(f"`{observation}`" for observation in privileged), *prior_knowledge]) or "nothing"
