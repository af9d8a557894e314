"""Procedures that seek the rendezvous, written to be read beside the paper."""

from typing import Protocol

from agents.base.agent import Look, Procedure
from agents.jacobian import Estimator


class Servo(Protocol):
    """Begins a procedure from a look.

    Attributes:
        estimator: How it estimates the Jacobian, a name of `agents.jacobian.ESTIMATORS`.
    """

    @property
    def estimator(self) -> str: ...  # noqa: D102

    def __call__(self, look: Look, estimator: Estimator) -> Procedure:
        """Seeks the rendezvous from `look` on, and keeps what it learns of the Jacobian in `estimator`."""
