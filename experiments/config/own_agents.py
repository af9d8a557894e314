"""Agents in modules of the user's, "my_module:mine": which code they are, and when it is imported."""

import ast
import hashlib
import re
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from sysconfig import get_path

from pydantic import ValidationInfo

import agents

TOLD = "told"
"""The context in which suites are read that results tell of: nothing is imported, for a stranger may have
written them."""
_KINDS = ("*.py", "*.xml", "*.yaml", "*.npz", "*.onnx", "*.pt", "*.pth", "*.safetensors", "*.zip")
"""Code, arms and settings, and the files in which learners may be kept."""
_OURS = ("__main__", "agents", "calfree_agents", "calfree_gym", "experiments")
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
    """A hash over the module, or the package that it is in, and over all of its folder that it imports."""
    first, *_ = roots = _roots(module.partition(".")[0])
    installed = {Path(get_path(each)) for each in ("purelib", "platlib", "stdlib")}
    new = [] if first.parent in installed else [*roots]
    while new:
        sources = (file for root in new for file in ([root] if root.is_file() else root.rglob("*.py")))
        names = {name for file in sources for name in _imported(file)} - {*_OURS}
        found = {root for name in sorted(names) for root in _roots(name) if root.parent == first.parent}
        new = sorted(found.difference(roots))
        roots += new
    return hash_of(roots, first.parent)


def _roots(name: str) -> list[Path]:
    """The file of a module of that name, or the folders of a package; nothing where there is none here."""
    spec = find_spec(name)
    if spec is None:
        return []
    return [Path(each) for each in spec.submodule_search_locations or [spec.origin or ""]]


def _imported(source: Path) -> Iterator[str]:
    """The first parts of all names that a file imports, wherever in it; none where it is no Python."""
    try:
        tree = ast.parse(source.read_bytes())
    except (SyntaxError, ValueError):
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (each.name.partition(".")[0] for each in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.partition(".")[0]


def hash_of(roots: Iterable[Path], above: Path) -> str:
    """A hash over files, and over all files of `_KINDS` in folders, by their names below `above`."""
    digest = hashlib.sha256()
    for path in roots:
        files = [path] if path.is_file() else [file for kind in _KINDS for file in path.rglob(kind)]
        for file in sorted(files):
            digest.update(str(file.relative_to(above)).encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:12]
