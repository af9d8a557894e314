"""A servo alone: what it keeps from one trial to the next is its last Jacobian."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
from numpy.typing import NDArray

from agents.base.agent import Array, Look, Procedure, ProcedureAgent, relive
from agents.base.checks import fitting
from agents.jacobian import ESTIMATORS, Estimator
from agents.servo import Servo


class ServoAgent(ProcedureAgent):
    """Seeks every rendezvous by `servo`, beginning with the Jacobian that the last trial ended with.

    Attributes:
        jacobian: That Jacobian (8, m); None before the first trial, and where the servo's does not last.
    """

    def __init__(self, env: gym.Env[Any, Any], servo: Servo, seed: int = 0) -> None:
        super().__init__(env, seed)
        self.servo = servo
        self.jacobian: Array | None = None

    def procedure(self, look: Look) -> Procedure:
        """See `ProcedureAgent`."""
        return self.seek(look, self._estimator(look))

    def seek(self, look: Look, estimator: Estimator) -> Procedure:
        """The procedure, which keeps what it learns of the Jacobian in `estimator`."""
        return self.servo(look, estimator)

    def learn_trial(self, looks: Sequence[Look], ended: bool) -> None:
        """See `ProcedureAgent`. Motions teach the Jacobian, however the trial ends."""
        self.learn_jacobian(looks)

    def learn_jacobian(self, looks: Sequence[Look]) -> Estimator:
        """What a trial of its own has taught; the Jacobian is remembered where it lasts."""
        estimator = self._estimator(looks[0])
        relive(self.seek(looks[0], estimator), looks)
        if estimator.lasting:
            self.jacobian = estimator.jacobian
        return estimator

    def _estimator(self, look: Look) -> Estimator:
        return ESTIMATORS[self.servo.estimator](len(look.registers), self.jacobian)

    @property
    def kind(self) -> str:
        """See `ProcedureAgent`."""
        return repr(self.servo)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """See `ProcedureAgent`."""
        return {} if self.jacobian is None else {"jacobian": self.jacobian}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """See `ProcedureAgent`."""
        self.jacobian = fitting(arrays, "jacobian", (8, None)) if "jacobian" in arrays else None
