"""Random control words: the floor of every comparison."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from ..base.checks import check_number
from ..base.observation import Observation, RawObservation
from ..base.procedure import Procedure, ProcedureAgent
from ..base.registration import agent
from ..grasp.inserting.observation import InsertObservation
from ..grasp.observation import GraspObservation
from ..grasp.task import task_of

OBSERVED: dict[str, Any] = {"reach": Observation, "grasp": GraspObservation, "insert": InsertObservation}
"""What is observed, by the task."""


@agent("random", "Moves at random: the floor of every comparison.", tasks=tuple(OBSERVED))
class RandomAgent(ProcedureAgent):
    """Sends words drawn uniformly within `limit`.

    Args:
        limit: Largest magnitude of a word.
    """

    def __init__(self, env: gym.Env[Any, Any], limit: float = 0.25, seed: int = 0) -> None:
        super().__init__(env, seed)
        self._observed = OBSERVED[task_of(env)]
        self.limit = check_number("limit", limit, above=0, most=1)

    @property
    def kind(self) -> str:
        """See `ProcedureAgent`."""
        return f"RandomAgent(limit={self.limit}, seed={self.seed})"

    def observed(self, raw: RawObservation) -> Any:
        """See `ProcedureAgent`."""
        return self._observed.of(raw)

    def procedure(self, first: Observation, findings: None) -> Procedure:
        """See `ProcedureAgent`. Every trial has a stream of its own, so that `predict` changes nothing."""
        rng = np.random.default_rng([self.seed, *np.frombuffer(first.object.tobytes(), np.uint32)])
        while True:
            yield rng.uniform(-self.limit, self.limit, len(first.registers))
