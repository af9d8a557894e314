"""A servo alone: an agent that forgets everything after each trial."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Self

import gymnasium as gym

from agents import storage
from agents.agent import Look, Procedure, ProcedureAgent
from agents.servo import Servo


class ServoAgent(ProcedureAgent):
    """Seeks every rendezvous by `servo` and learns nothing beyond the trial."""

    def __init__(self, env: gym.Env[Any, Any], servo: Servo, seed: int = 0) -> None:
        super().__init__(env, seed)
        self.servo = servo

    def procedure(self, look: Look) -> Procedure:
        """See `ProcedureAgent`."""
        return self.servo(look)

    def save(self, path: str | Path) -> None:
        """See `Agent`."""
        storage.save(path, repr(self.servo), {}, self.num_timesteps)

    def load(self, path: str | Path) -> Self:
        """See `Agent`."""
        _, self.num_timesteps = storage.load(path, repr(self.servo))
        return self
