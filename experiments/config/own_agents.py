"""Agents in modules of the user's, "my_module:mine": which code they are, and when it is imported."""

import hashlib
import re
from collections.abc import Iterable
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from pydantic import ValidationInfo

import agents

TOLD = "told"
"""The context in which suites are read that results tell of: nothing is imported, for a stranger may have
written them."""
_KINDS = ("*.py", "*.safetensors", "*.xml", "*.yaml")
_NAME = re.compile(r"[\w.]+:[\w.-]+")


def may_import(name: str, info: ValidationInfo) -> bool:
    """Whether the module that an agent is in, if it names one, may be imported."""
    return info.context != TOLD or ":" not in name


def known_agent(name: str, info: ValidationInfo) -> str:
    """The name of an agent that there is, or where none is imported could be."""
    if may_import(name, info):
        module = name.rpartition(":")[0]
        trusted = [module] if info.context is None else info.context
        if module and not any(f"{module}.".startswith(f"{each}.") for each in trusted):
            raise ValueError(f"its module is not imported unless you say --import {module}")
        agents.named(name)
    elif not _NAME.fullmatch(name):
        raise ValueError("allowed: my_module:my_agent")
    return name


def code_here(told: str, info: ValidationInfo) -> str:
    """Which code an agent is, whatever is ours apart; raises ValueError where it is another than was told."""
    name = info.data.get("name", "")
    if ":" not in name or not may_import(name, info):
        return told
    if told not in ("", now := code_of(name.partition(":")[0])):
        raise ValueError(f"{name!r} is other code here: {now}")
    return now


@cache
def code_of(module: str) -> str:
    """A hash over the sources of the package that a module is in, or of the module where it is in none."""
    spec = find_spec(module.partition(".")[0])
    assert spec is not None, module
    roots = [Path(root) for root in spec.submodule_search_locations or [spec.origin or ""]]
    return hash_of(roots, roots[0].parent)


def hash_of(roots: Iterable[Path], above: Path) -> str:
    """A hash over files, and over all sources in folders, by their names below `above`."""
    digest = hashlib.sha256()
    for path in roots:
        files = [path] if path.is_file() else [file for kind in _KINDS for file in path.rglob(kind)]
        for file in sorted(files):
            digest.update(str(file.relative_to(above)).encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:12]
