"""Edits of core lines that tests must notice."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[2]
LIST = Path(__file__).with_name("mutants.yaml")


@dataclass(frozen=True)
class Mutant:
    """An edit of one file.

    Attributes:
        name: For reports and `--only`.
        file: Relative to the repository's root.
        find: Text that occurs there exactly once.
        replace: What to put in its place.
        tests: Files or node ids, one of which must fail then.
        why: What is wrong with the edited code.
    """

    name: str
    file: str
    find: str
    replace: str
    tests: tuple[str, ...]
    why: str

    def applied(self, text: str) -> str:
        """The edited text of the file.

        Raises:
            ValueError: The text to find does not occur exactly once.
        """
        if (count := text.count(self.find)) != 1:
            raise ValueError(f"{self.name}: its text occurs {count} times in {self.file}; it must occur once")
        return text.replace(self.find, self.replace)


def mutants() -> list[Mutant]:
    """All that are kept, as they stand in mutants.yaml."""
    entries = yaml.safe_load(LIST.read_text(encoding="utf-8"))
    return [Mutant(**{**entry, "tests": tuple(entry["tests"])}) for entry in entries]
