"""Names of modules in earlier versions: what is public there can be imported for one version more."""

import sys
import warnings
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

PACKAGE = __name__.rpartition(".")[0]
MOVED = {
    "adaptation": "memory",
    "adaptation.adaptive_memory": "memory.adaptive_memory",
    "adaptation.memory": "memory.memory",
    "adaptation.remembered": "memory.remembered",
    "body_schema.agent": "body_schema.body_schema",
    "grasp.inserting": "grasp",
    "grasp.inserting.agent": "grasp.insert",
    "grasp.inserting.yoshimi_allen": "grasp.yoshimi_allen",
    "jacobian": "servo.jacobian",
    "neural.recurrent_servo.agent": "neural.recurrent_servo.recurrent_servo",
    "neural.sb3.agent": "neural.sb3.sb3_agent",
    "perception": "servo.perception",
    "reference.oracle": "reference.bounds",
    "reference.random_agent": "reference.bounds",
    "servo.safe.agent": "servo.safe.safe_start",
}
"""From the old names to those of today."""


class Moved(MetaPathFinder, Loader):
    """Finds a module under its old name."""

    def find_spec(self, name: str, path: Any, target: Any = None) -> ModuleSpec | None:
        """Where it is, if it has moved."""
        package, _, old = name.partition(".")
        return ModuleSpec(name, self) if package == PACKAGE and old in MOVED else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """The module under its present name."""
        present = f"{PACKAGE}.{MOVED[spec.name.partition('.')[2]]}"
        warnings.warn(f"{spec.name} is now {present}", DeprecationWarning, stacklevel=2)
        module = import_module(present)
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """It has been executed under its present name, whose spec it keeps."""
        assert module.__spec__ is not None
        module.__spec__ = module.__spec__.loader_state


sys.meta_path.insert(0, Moved())
