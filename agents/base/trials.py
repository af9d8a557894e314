"""Which environments begin a trial in a call of `predict`, with the errors that a lost state deserves."""

from __future__ import annotations

import numpy as np

from .observation import Array, Flags


def begins_trial(registers: Array, rows_of_state: int | None, episode_start: Flags | None) -> Flags:
    """Where (n,) a new trial begins.

    Args:
        registers: Of one environment (m,), or a batch of n (n, m).
        rows_of_state: How many environments the state is of; None where there is no state.
        episode_start: Where (n,) the caller says that one begins.

    Raises:
        ValueError: There is no state in the middle of a trial, or it is of another number of environments.
    """
    registers = np.atleast_2d(registers)
    rows = len(registers)
    starts = np.zeros(rows, bool) if episode_start is None else np.atleast_1d(episode_start)
    if rows_of_state is not None and rows_of_state != rows:
        raise ValueError(f"the state is of {rows_of_state} environments, the observation of {rows}")
    if len(starts) != rows:
        raise ValueError(f"episode_start has {len(starts)} entries for {rows} environments")
    if rows_of_state is not None:
        return np.asarray(starts, bool)
    away = ~starts.astype(bool) & (registers != 0).any(1)
    if away.any():
        raise ValueError(
            "predict got state=None in the middle of a trial (registers are "
            f"{registers[away.argmax()].tolist()}): pass the state back that the last call returned, "
            "or episode_start where a new trial begins"
        )
    return np.ones(rows, bool)
