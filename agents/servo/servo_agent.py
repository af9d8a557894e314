"""A servo alone: what it keeps from one trial to the next is its last Jacobian."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ..base.checks import checked_array
from ..base.observation import Array, Observation
from ..base.prior_knowledge import PriorKnowledge
from ..base.procedure import Procedure, ProcedureAgent
from ..jacobian import Estimator
from .trial import Findings

_TEST_MOTIONS = re.compile(r"UnifiedServo\(estimator='test_motions', ([^()]*), patience=[^()]*\)")


class Servo(Protocol):
    """Seeks a rendezvous; its repr names all its settings."""

    @property
    def prior_knowledge(self) -> frozenset[PriorKnowledge]:
        """What it is built on, see `Agent`."""

    def new_estimator(self, motors: int, start: Array | None) -> Estimator:
        """Makes the estimator of its Jacobian, beginning with `start` (8, m) where one is known."""

    def __call__(self, first: Observation, findings: Findings) -> Procedure:
        """Seeks the rendezvous from `first` on, and writes into `findings` what it learns."""


class ServoAgent(ProcedureAgent):
    """Seeks every rendezvous by `servo`, beginning with the Jacobian that the last trial ended with.

    Attributes:
        servo: The servo.
        jacobian: That Jacobian (8, m); None before the first trial, and where the servo's does not last.
    """

    def __init__(self, env: gym.Env[Any, Any], servo: Servo, seed: int = 0) -> None:
        super().__init__(env, seed)
        (self.motors,) = env.action_space.shape  # type: ignore[misc]
        self.servo = servo
        self.prior_knowledge = servo.prior_knowledge
        self.jacobian: Array | None = None

    def new_findings(self) -> Findings:
        """See `ProcedureAgent`."""
        return Findings(self.servo.new_estimator(self.motors, self.jacobian))

    def procedure(self, first: Observation, findings: Findings) -> Procedure:
        """See `ProcedureAgent`."""
        return self.servo(first, findings)

    def learn_trial(self, findings: Findings, last: Observation, ended: bool) -> None:
        """See `ProcedureAgent`. Motions teach the Jacobian, however the trial ends."""
        if findings.estimator.lasting:
            self.jacobian = findings.estimator.jacobian

    @property
    def kind(self) -> str:
        """See `ProcedureAgent`."""
        return repr(self.servo)

    def present_kind(self, saved: str) -> str:
        """See `ProcedureAgent`. In version 0.1 the paper's servo was a unified one by test motions."""
        return _TEST_MOTIONS.sub(r"PaperServo(\1)", saved)

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """See `ProcedureAgent`."""
        return {} if self.jacobian is None else {"jacobian": self.jacobian}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """See `ProcedureAgent`."""
        self.jacobian = checked_array(arrays, "jacobian", (8, None)) if "jacobian" in arrays else None
