"""A servo alone: an agent that forgets everything after each trial."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

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

    @property
    def kind(self) -> str:
        """See `ProcedureAgent`."""
        return repr(self.servo)
