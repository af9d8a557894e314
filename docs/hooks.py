"""Puts the table of all perturbations, read off the code, where a page says `<!-- perturbations -->`."""

from __future__ import annotations

import inspect
import math
from importlib import import_module
from typing import Any

import griffe

from calfree_gym.perturbations import TYPES, Perturbation
from calfree_gym.perturbations.base import Setting
from calfree_gym.robot.arms.movemaster import MOVEMASTER

UNITS = dict.fromkeys(("degrees", "direction", "azimuth", "elevation", "phase"), "degrees") | {
    "metres": "m",
    "px": "pixels",
    "motions": "motions",
    "levels": "grey levels",
    "registers": "registers",
    "period": "registers",
    "words": "words",
}


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Called by mkdocs with every page."""
    return markdown.replace("<!-- perturbations -->", "\n\n".join(map(_section, TYPES.values())))


class End:
    """Takes a random generator's place and draws the lowest, or the highest, of what may be drawn."""

    def __init__(self, highest: bool) -> None:
        self._highest = highest

    def uniform(self, low: float, high: float, size: None = None) -> float:
        """Either end."""
        return high if self._highest else low

    def integers(self, low: int, high: int | None = None) -> int:
        """Either end."""
        first, beyond = (0, low) if high is None else (low, high)
        return beyond - 1 if self._highest else first


def _section(kind: type[Perturbation]) -> str:
    """What one type does, and its settings."""
    lines = [
        f"### `{kind.type}`",
        "",
        *str(inspect.getdoc(kind)).splitlines(),
        "",
        "| setting | unit | allowed | drawn from, where not given | for a step of a drift |",
        "| --- | --- | --- | --- | --- |",
    ]
    for name, setting in kind.settings().items():
        lines.append(f"| `{name}` | {UNITS.get(name, '')} | {_allowed(setting)} | {_drawn(setting)} |")
    return "\n".join(lines)


def _allowed(setting: Setting) -> str:
    if setting.part:
        return ", ".join(f"`{name}`" for name in getattr(MOVEMASTER, setting.part))
    if math.isinf(setting.most):
        return "any number"
    kind = "whole numbers" if setting.whole else "numbers"
    return f"{kind} {_number(setting.least)} to {_number(setting.most)}"


def _drawn(setting: Setting) -> str:
    """What is drawn, by the two ends of its range, and what for a step of a drift where that is less."""
    if setting.draw is None:
        return "any of them | the same"
    ends = [setting.draw(End(highest)) for highest in (False, True)]  # type: ignore[arg-type]
    steps = [setting.slow(end) for end in ends]
    return f"{_range(*ends)} | {'the same' if steps == ends else _range(*steps)}"


def _range(low: float, high: float) -> str:
    return _number(low) if low == high else f"{_number(low)} to {_number(high)}"


def _number(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:.5g}"


class Constructors(griffe.Extension):
    """Shows the constructors that environments write from the dataclasses of their arguments."""

    def on_class(self, *, cls: griffe.Class, **_: Any) -> None:
        """Adds the constructor of an environment."""
        if not cls.path.startswith("calfree_gym.tasks.") or not cls.name.endswith("Env"):
            return
        signature = inspect.signature(getattr(import_module(cls.module.path), cls.name))
        shown = [
            griffe.Parameter(
                name,
                annotation=str(each.annotation),
                kind=griffe.ParameterKind.keyword_only,
                default=repr(each.default) if isinstance(each.default, str) else str(each.default),
            )
            for name, each in signature.parameters.items()
        ]
        cls.set_member("__init__", griffe.Function("__init__", parameters=griffe.Parameters(*shown)))
