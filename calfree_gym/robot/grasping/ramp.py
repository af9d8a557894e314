"""How targets travel: smoothly, no faster than an arm can, and back where the arm presses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import Array

CHUNK = 10
"""Substeps after which the guard looks at the forces."""
LEAST_CHUNKS, SETTLING = 7, 3
"""Chunks of the ramp at least, and after it."""
RETREAT = 0.5
"""An arm that presses goes back by this share of the way that it had come when the chunk began."""


class Ramp(NamedTuple):
    """Where arms and jaws are meant to be on their ways.

    Attributes:
        arms: Shares of the arms' ways (n, k) after each substep.
        jaws: The same of the jaws, which go on.
        substeps: After which all is over (n,).
        executed: Of the arms' ways (n,), in the end.
    """

    arms: Array
    jaws: Array
    substeps: NDArray[np.int64]
    executed: Array


def onward(chunks: NDArray[np.int64]) -> Ramp:
    """Ways that take so many chunks (n,), to their ends."""
    substeps = CHUNK * (chunks + SETTLING)
    shares = _shares(chunks, substeps)
    return Ramp(shares, shares, substeps, np.ones(len(chunks)))


def turning_back(chunks: NDArray[np.int64], turns: NDArray[np.int64]) -> Ramp:
    """The same, with arms that turn back: the guard saw them press in chunk `turns` (n,), from 0."""
    back = np.maximum(LEAST_CHUNKS, turns)
    substeps = CHUNK * (np.maximum(chunks, turns + back) + SETTLING)
    shares = _shares(chunks, substeps)
    since = np.arange(1.0, shares.shape[1] + 1) - CHUNK * turns[:, None]
    there = smooth(np.minimum(turns / chunks, 1.0))
    returning = there[:, None] * (1 - RETREAT * smooth(np.clip(since / (CHUNK * back[:, None]), 0, 1)))
    arms = np.where(since <= CHUNK, shares, returning)
    return Ramp(arms, shares, substeps, there * (1 - RETREAT))


def _shares(chunks: NDArray[np.int64], substeps: NDArray[np.int64]) -> Array:
    """Of ways that take so many chunks (n,), as far as the longest lasts (n, k)."""
    count = np.arange(1.0, np.maximum.reduce(substeps) + 1)
    return smooth(np.minimum(count / (CHUNK * chunks[:, None]), 1.0))


def smooth(times: Array) -> Array:
    """The way of least jerk: shares of it (...) at shares (...) of the time."""
    return np.asarray(times * times * times * (10 + times * (6 * times - 15)))
