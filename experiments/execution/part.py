"""One of several parts of a suite, each of which is made on its own machine into its own folder."""

from collections.abc import Sequence
from typing import NamedTuple, Self

from experiments.errors import ConfigError
from experiments.running.plan import Run


class Part(NamedTuple):
    """The `number`-th (from 1) of `of` parts; each takes every `of`-th run, and so about as much work."""

    number: int
    of: int

    @classmethod
    def parse(cls, text: str) -> Self:
        """Reads `K/N`.

        Raises:
            ConfigError: Says what was found, and what is allowed.
        """
        number, _, of = text.partition("/")
        if not (number.isdecimal() and of.isdecimal() and 1 <= int(number) <= int(of)):
            raise ConfigError(f"found {text!r}; must be K/N with 1 ≤ K ≤ N, such as 2/3")
        return cls(int(number), int(of))

    def __str__(self) -> str:
        return f"{self.number}/{self.of}"

    def of_runs(self, runs: Sequence[Run]) -> list[Run]:
        """Its share of a suite's runs.

        Raises:
            ConfigError: There are fewer runs than parts, and none is left for this one.
        """
        mine = list(runs[self.number - 1 :: self.of])
        if not mine:
            raise ConfigError(f"--part {self}: nothing to do; the suite has {len(runs)} runs")
        return mine


WHOLE = Part(1, 1)
