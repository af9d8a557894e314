"""Other environments under other interpreters, timed in turns with ours."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any, Self

from experiments.errors import ConfigError

WORKER = Path(__file__).with_name("peer_worker.py")


class Peer:
    """An environment in a process of its own, which steps only while it is being timed.

    Attributes:
        env_id: Its Gymnasium id.
        substeps: Physics substeps in a step; None where they cannot be told.
        timestep: Simulated seconds in a substep; None where they cannot be told.
        versions: Of its interpreter and packages.

    Args:
        spec: "PYTHON=ENV_ID": an interpreter that has the environment, and the id, "module:Id" included.

    Raises:
        ConfigError: There is no such interpreter or environment; says what it said.
    """

    def __init__(self, spec: str) -> None:
        self._spec = spec
        python, equals, self.env_id = spec.partition("=")
        if not (python and equals and self.env_id):
            raise ConfigError(f"--peer {spec}: found no PYTHON=ENV_ID; allowed: such as python3=CartPole-v1")
        try:
            self._process = subprocess.Popen(
                [python, "-c", WORKER.read_text(encoding="utf-8"), self.env_id],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                env={**os.environ, "OMP_NUM_THREADS": "1"},
                text=True,
            )
        except OSError as error:
            raise ConfigError(f"--peer {spec}: {python} cannot be run: {error.strerror}") from None
        about = self._answer()
        self.substeps: int | None = about["substeps"]
        self.timestep: float | None = about["timestep"]
        self.versions: dict[str, str] = about["versions"]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()

    def seconds(self, steps: int) -> float:
        """Makes so many environment steps; returns the seconds that they took."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{steps}\n")
        self._process.stdin.flush()
        return float(self._answer())

    def _answer(self) -> Any:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            try:
                return json.loads(line)
            except ValueError:  # a package's greeting
                continue
        _, said = self._process.communicate()
        last = said.strip().splitlines()[-1:] or [f"it ended with {self._process.returncode}"]
        raise ConfigError(f"--peer {self._spec}: {last[0]}")
