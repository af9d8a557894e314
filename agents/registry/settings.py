"""Which settings each agent takes, and what they are where none is given."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from calfree_gym.errors import near_misses

from ..base.settings import named_settings, tuned_settings
from ..grasp.trial import SURE_PX
from ..servo import SERVOS
from .makers import (
    KNOWLEDGE,
    MAKERS,
    SB3,
    SELF_TAUGHT,
    knowledge_settings,
    make_grasp,
    make_memory,
    make_sb3,
    make_table,
)

DEFAULTS: dict[str, dict[str, Any]] = {
    "grid_table": {"every_look": False, "servo": "paper_servo", "jump_px": math.inf},
}
"""Settings of agents that bear a knowledge base's name. With the paper's table only success teaches, what is
recalled is always tried, and the paper's servo corrects."""
OF_CONTACT = ("grasp", "insert")
"""Agents that must not touch what they come near to."""
OVER_SERVOS = ("learning_servo", "body_schema", "safe_start", *OF_CONTACT)
"""Agents that are laid over a servo, whose settings they take."""


def known_settings(name: str, chosen: Mapping[str, Any]) -> dict[str, Any]:
    """All settings of an agent and their defaults; raises ValueError where one that is chosen is none."""
    allowed = _settings_of(name, chosen)
    for setting in chosen:
        if setting not in allowed:
            found = f"agent {name!r} has no setting {setting!r}{near_misses(setting, allowed)}"
            raise ValueError(f"{found}; allowed: {', '.join(allowed)}")
    return allowed


def defaults(name: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """An agent's own defaults, with the servo that is given."""
    if name in OF_CONTACT and given.get("servo", "unified_servo") == "unified_servo":
        return {"sure_px": SURE_PX}
    return tuned_settings(name) if name in SB3 else DEFAULTS.get(name, {})


def _settings_of(name: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """The settings that an agent takes, with their defaults (`Parameter.empty`, where there is none).

    A learning servo's depend on the knowledge and servo `given`.
    """
    if MAKERS[name] is make_sb3:
        from ..neural.sb3.agent import settings_with

        try:
            return settings_with(given)
        except ValueError as error:
            raise ValueError(f"agent {name!r}: {error}") from error
    if name in SELF_TAUGHT:
        from ..neural.self_supervised import AGENTS

        return named_settings(AGENTS[name])
    named = named_settings(MAKERS[name])
    if name in SERVOS:
        return {"seed": named["seed"], **_fields(name)}
    chosen = {"servo": "unified_servo", "knowledge": "memory", **given}
    if name not in (*KNOWLEDGE, *OVER_SERVOS):
        return named
    if name in KNOWLEDGE:
        named.pop("knowledge")
        chosen["knowledge"] = name
    knows = name not in ("insert", "safe_start", "body_schema") and (
        name != "grasp" or chosen["knowledge"] is not None
    )
    for setting, known in (("servo", SERVOS), ("knowledge", KNOWLEDGE))[: 1 + knows]:
        if chosen[setting] not in tuple(known):
            hint, allowed = near_misses(chosen[setting], known), ", ".join(known)
            raise ValueError(f"agent {name!r}: {setting} is {chosen[setting]!r}{hint}; allowed: {allowed}")
    if not knows:
        return named | _fields(chosen["servo"])
    of_table = make_grasp if chosen.get("direction") else make_table
    over = named_settings(make_memory if chosen["knowledge"] == "memory" else of_table)
    settings = named | {setting: over[setting] for setting in over if setting not in ("seed", "knowledge")}
    return settings | knowledge_settings(chosen["knowledge"]) | _fields(chosen["servo"])


def _fields(servo: str) -> dict[str, Any]:
    return {field.name: field.default for field in fields(SERVOS[servo])}
