"""The global generators of Python, NumPy and torch: restored, or swapped for a state of one's own."""

import random
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np


@contextmanager
def random_state_preserved() -> Iterator[None]:
    """Restores the global generators; torch's where it is loaded."""
    before = _states()
    try:
        yield
    finally:
        _restore(before)


class OwnRandomState:
    """A state of the global generators of one's own, for libraries that draw from them."""

    def __init__(self) -> None:
        self._states = _states()

    @contextmanager
    def swapped_in(self) -> Iterator[None]:
        """Draws come from this state; the caller's is restored afterwards."""
        with random_state_preserved():
            _restore(self._states)
            try:
                yield
            finally:
                self._states = _states()


def _states() -> tuple[Any, Any, Any]:
    torch = sys.modules.get("torch")
    return (
        random.getstate(),
        np.random.get_state(),  # noqa: NPY002
        torch.get_rng_state() if torch else None,
    )


def _restore(states: tuple[Any, Any, Any]) -> None:
    of_python, of_numpy, of_torch = states
    random.setstate(of_python)
    np.random.set_state(of_numpy)  # noqa: NPY002
    if of_torch is not None:
        sys.modules["torch"].set_rng_state(of_torch)
