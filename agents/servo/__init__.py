"""Procedures that seek the rendezvous, written to be read beside the paper."""

from typing import Protocol

from agents.agent import Array, Look, Procedure


class Servo(Protocol):
    """Begins a procedure from a look.

    Attributes:
        estimator: How it estimates the Jacobian, a name of `agents.jacobian.ESTIMATORS`.
    """

    @property
    def estimator(self) -> str: ...  # noqa: D102

    def __call__(self, look: Look, start: Array | None = None) -> Procedure:
        """Seeks the rendezvous from `look` on; `start` is the Jacobian (8, m) at an earlier trial's end."""
