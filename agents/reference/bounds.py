"""The floor and the ceiling of every comparison."""

from typing import Any

import gymnasium as gym
import numpy as np

from ..base.checks import check_number
from ..base.observation import Observation, RawObservation
from ..base.procedure import Procedure, ProcedureAgent
from ..base.registration import agent
from ..docking.observation import DockObservation
from ..grasp.observation import GraspObservation, InsertObservation, task_of

OBSERVED: dict[str, Any] = {
    "reach": Observation,
    "grasp": GraspObservation,
    "insert": InsertObservation,
    "dock": DockObservation,
}
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
        return f"RandomAgent(limit={self.limit}, seed={self.seed})"

    def observed(self, raw: RawObservation) -> Any:
        return self._observed.of(raw)

    def procedure(self, first: Observation, findings: None) -> Procedure:
        """See `ProcedureAgent`. Every trial has a stream of its own, so that `predict` changes nothing."""
        rng = np.random.default_rng([self.seed, *np.frombuffer(first.object.tobytes(), np.uint32)])
        while True:
            yield rng.uniform(-self.limit, self.limit, len(first.registers))


@agent("oracle", "Is told where to go: the ceiling.")
class Oracle(ProcedureAgent):
    """Sends the words that bring the gripper to the object, which it is told.

    It knows the world: its observations have a privileged key, the registers at which the gripper is at the
    object. So it shows what is left to noise, to end stops, and to the one motion that a reach takes. After
    its first motion it goes on by the same rule, which is of use where the world changes in mid-trial.
    """

    privileged = ("object_registers",)
    needs_points = False

    @property
    def kind(self) -> str:
        return "Oracle()"

    def procedure(self, first: Observation, findings: None) -> Procedure:
        now = first
        while True:
            now = yield now.privileged["object_registers"] - now.registers
