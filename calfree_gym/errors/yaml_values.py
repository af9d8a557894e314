"""Reading YAML as people mean it: what YAML 1.1 takes otherwise is refused, with what to write."""

from __future__ import annotations

import math
import re
from collections import Counter
from typing import Any

_NUMBER = re.compile(
    r"[-+]?(0|[1-9]\d*|[1-9]\d{0,2}(_\d{3})+)?(\.\d*)?(e[-+]\d+)?|[-+]?\.(inf|nan)", re.IGNORECASE
)
"""Decimal; of underscores only those between thousands."""
_LIKE_A_NUMBER = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)e[-+]?\d+|[-+]?0(o[0-7]+|\d+)", re.IGNORECASE)
"""What YAML 1.1 takes for text: `2e1`, `0o10`, `08`."""
_ALLOWED = "allowed: decimal numbers such as 10, 1_000, 0.5 and 2.0e-3, and text in quotes"


MOST_VALUES = 10**6
"""In a text, what aliases stand for counted each time. Choice: a file has thousands."""


class UnclearNumberError(ValueError):
    """What is written as a number, and what YAML takes it for, are two things."""


def read(text: str) -> Any:
    """The plain values of a YAML text.

    Raises:
        ModuleNotFoundError: PyYAML is not installed.
        UnclearNumberError: A number is octal, to the base 60 or the like; names the path of its key, what was
            written and what is allowed.
        yaml.YAMLError: It is no YAML, has a key twice, or too many values, aliases written out.
        ValueError: A value cannot be, such as a date in a thirteenth month; or too much is nested.
    """
    import yaml

    def check(node: yaml.Node, where: str) -> float:
        """How many values a node has; infinitely many where an alias in it leads back to it."""
        if isinstance(node, yaml.ScalarNode) and node.style is None:
            is_number = node.tag.endswith((":int", ":float"))
            value = loader.construct_object(node) if is_number else None
            if unclear := _unclear(node.value, value):
                raise UnclearNumberError(f"{where}: {unclear}".removeprefix(": "))
        if node in counted or not isinstance(node, yaml.CollectionNode):
            return counted.get(node, 1)
        counted[node] = math.inf
        count: float = 1
        if isinstance(node, yaml.SequenceNode):
            count += sum(check(item, f"{where}.{i}".removeprefix(".")) for i, item in enumerate(node.value))
        else:
            keys = Counter((key.tag, key.value) for key, _ in node.value if isinstance(key, yaml.ScalarNode))
            for key, value in node.value:
                name = key.value if isinstance(key, yaml.ScalarNode) else "?"
                if keys[key.tag, name] > 1:
                    raise yaml.MarkedYAMLError(
                        problem=f"the key {name!r} stands twice", problem_mark=key.start_mark
                    )
                below = f"{where}.{name}".removeprefix(".")
                count += check(key, below) + check(value, below)
        if count > MOST_VALUES:
            raise yaml.MarkedYAMLError(
                problem=f"found {count} values, aliases written out; allowed: {MOST_VALUES}",
                problem_mark=node.start_mark,
            )
        counted[node] = count
        return count

    counted: dict[yaml.Node, float] = {}
    loader = yaml.SafeLoader(text)
    try:
        node = loader.get_single_node()
        if node is not None:
            check(node, "")
        return None if node is None else loader.construct_document(node)
    except RecursionError:
        raise ValueError("lists or mappings are nested too deeply") from None
    finally:
        loader.dispose()


def _unclear(written: str, value: float | None) -> str:
    """What is wrong with an unquoted scalar, if so, and with its value where YAML takes it for a number."""
    if value is not None and not _NUMBER.fullmatch(written):
        return f"found {written}, which YAML takes for {value}; {_ALLOWED}"
    if value is None and _LIKE_A_NUMBER.fullmatch(written):
        return f"found {written!r}, which YAML takes for text; {_decimal(written)}{_ALLOWED}"
    return ""


def _decimal(written: str) -> str:
    """How YAML 1.1 wants a number with an exponent to be written; nothing where there is none."""
    digits, _, exponent = written.lower().partition("e")
    if not exponent:
        return ""
    exponential = f"{digits if '.' in digits else digits + '.0'}e{int(exponent):+d}"
    short = 1e-4 <= abs(float(written)) < 1e15
    return f"write {f'{float(written):.15g} or ' * short}{exponential}; "
