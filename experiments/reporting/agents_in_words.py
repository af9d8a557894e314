"""What agents are called where people read, and how their lines look: the same in every figure."""

import zlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.colors import to_hex, to_rgb

from experiments.config.suite import AgentConfig


@dataclass(frozen=True, slots=True)
class _Known:
    words: str
    colour: str
    dash: Any = "-"


_DASHED, _DOTTED, _DASH_DOT = (0, (4, 1.6)), (0, (1.4, 1.2)), (0, (5, 1.2, 1.2, 1.2))
_LONG = (0, (9, 1.6))

# Okabe and Ito's hues, darkened until text in them is read on white (contrast of 4.5 and more), and others
# between them. Agents that share one are of a kind, and their dashes differ.
_GREEN, _VERMILION, _PINK, _SKY, _BLUE, _AMBER, _BLACK = (
    "#007F5F",
    "#B84300",
    "#A3156F",
    "#1A7DB6",
    "#003F8F",
    "#946E00",
    "#000000",
)
_PURPLE, _RED, _OLIVE, _TEAL = "#6F4BC0", "#8C1C13", "#5F6B00", "#00707A"
_GREY = "#757575"

ASIDE = ("oracle", "random")
"""Ceiling and floor: thin grey lines."""

_KNOWN = {
    "oracle": _Known("oracle: told where to go", _GREY),
    "random": _Known("random motions", _GREY, _DASHED),
    "paper_servo": _Known("test-motion servo (1995)", _GREEN),
    "work_plane_servo": _Known("work-plane servo (1995)", _GREEN, _DASHED),
    "joint_space_servo": _Known("Conkie & Chongstitvatana (1990)", _GREEN, _DOTTED),
    "grid_table": _Known("servo with table (1997)", _VERMILION),
    "factored_table": _Known("factored table (ours)", _VERMILION, _DASHED),
    "support_points": _Known("support points (ours)", _VERMILION, _DOTTED),
    "memory": _Known("memory (ours)", _PINK),
    "polynomial": _Known("polynomial regression", _SKY, _DASHED),
    "simulation_prior": _Known("regression with simulated prior", _SKY, _DOTTED),
    "body_schema": _Known("body schema (ours)", _RED),
    "cooperstock_milios": _Known("Cooperstock & Milios (1993)", _SKY),
    "self_supervised": _Known("self-supervised network (ours)", _BLUE),
    "recurrent_servo": _Known("pretrained network (ours)", _OLIVE),
    "in_context": _Known("pretrained network that remembers (ours)", _OLIVE, _DASHED),
    "unified_servo": _Known("unified servo (ours)", _PURPLE),
    "jacobian_servo": _Known("Jacobian servo", _PURPLE, _DASHED),
    "arcs": _Known("arcs by a projective model (ours)", _BLUE, _DASHED),
    "commuting_servo": _Known("commuting servo (ours)", _PINK, _DASHED),
    "safe_start": _Known("careful start (ours)", _PURPLE, _DOTTED),
    "affine_stereo": _Known("Hollinghurst & Cipolla (1994)", _TEAL),
    "model_based": _Known("calibrated robot", _RED, _DASHED),
    "self_calibrating": _Known("self-calibrating robot", _RED, _DOTTED),
    "ppo": _Known("PPO (stable-baselines3)", _BLACK),
    "recurrent_ppo": _Known("recurrent PPO (sb3-contrib)", _BLACK, _DASHED),
    "sac": _Known("SAC (stable-baselines3)", _AMBER, _LONG),
    "sac_her": _Known("SAC with hindsight (stable-baselines3)", _AMBER, _DASHED),
    "td3": _Known("TD3 (stable-baselines3)", _AMBER, _DOTTED),
    "crossq": _Known("CrossQ (sb3-contrib)", _AMBER, _DASH_DOT),
    "tqc": _Known("TQC (sb3-contrib)", _BLACK, _DOTTED),
    "grasp": _Known("grasping servo (ours)", _TEAL, _DASHED),
    "insert": _Known("inserting servo (ours)", _TEAL, _DOTTED),
    "yoshimi_allen": _Known("Yoshimi & Allen (1994)", _GREEN, _DASH_DOT),
}
_OTHERS = (_GREEN, _VERMILION, _PINK, _SKY, _BLUE, _AMBER, _PURPLE, _RED, _OLIVE, _TEAL)
_SHADES = (0.35, -0.22)
"""A variant is darker, or lighter: so far towards black, or (negative) towards white."""
_OF_VARIANTS = [(shade, dash) for dash in (_DASHED, _DOTTED, "-", _DASH_DOT) for shade in _SHADES]


def in_words(label: str, name: str) -> str:
    """What an agent is called in figures and tables; a label of its own stays as it is."""
    return _KNOWN[name].words if label == name and name in _KNOWN else label


def colour(label: str, name: str) -> str:
    """The colour of an agent, as "#rrggbb"; variants, which have labels of their own, have their kind's."""
    if name in _KNOWN:
        return _KNOWN[name].colour
    return _OTHERS[zlib.crc32(label.encode()) % len(_OTHERS)]


def lines_of(agents: Sequence[AgentConfig]) -> dict[str, dict[str, Any]]:
    """How the lines of a suite's agents are drawn, by their labels.

    An agent that is called by its name looks the same in every suite. Its variants are shades of it, with
    dashes of their own.
    """
    lines: dict[str, dict[str, Any]] = {}
    variants = Counter[str]()
    for agent in agents:
        line: dict[str, Any] = {"color": colour(agent.label, agent.name), "linestyle": "-"}
        if agent.label == agent.name:
            line["linestyle"] = _KNOWN[agent.name].dash if agent.name in _KNOWN else "-"
        else:
            base = line["color"]
            shade, line["linestyle"] = _OF_VARIANTS[variants[base] % len(_OF_VARIANTS)]
            line["color"] = _towards(base, shade)
            variants[base] += 1
        aside = agent.name in ASIDE
        line |= {"linewidth": 1 if aside else 2, "marker": "" if aside else "o", "markersize": 2.6}
        lines[agent.label] = line
    return lines


def _towards(base: str, shade: float) -> str:
    """So far towards black or, where it is negative, towards white."""
    end = 0.0 if shade > 0 else 1.0
    red, green, blue = (part + abs(shade) * (end - part) for part in to_rgb(base))
    return to_hex((red, green, blue))
