"""What a call of `predict` is given: of one environment or of several, and which of them begin a trial."""

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from .observation import STANDARD_KEYS, Array, Flags
from .registers import RegisterEstimate


def is_of_one(observation: Any, space: gym.Space[Any]) -> bool:
    """Whether an observation is of one environment, not of several.

    Args:
        observation: What `predict` was given.
        space: Of the agent's own environment.

    Raises:
        ValueError: It is no observation of such environments, or holds a number that is not finite.
    """
    if not isinstance(observation, Mapping):
        raise ValueError(f"the observation is {observation!r}; it must be a mapping of {_KEYS}")
    for key in STANDARD_KEYS:
        if key not in observation:
            raise ValueError(f"the observation has {', '.join(map(str, observation))}; it must have {_KEYS}")
        found, wanted = np.asarray(observation[key]), space[key].shape  # type: ignore[index]
        if found.ndim not in (1, 2) or found.shape[-1:] != wanted:
            raise ValueError(
                f"the observation's {key} has shape {found.shape}; it must be {wanted}, or (n, {wanted[0]}) "
                "of n environments, as in the environment that the agent was made with"
            )
        if not np.isfinite(found).all():
            raise ValueError(f"the observation's {key} is {found.tolist()}; all numbers must be finite")
    rows = {key: np.shape(observation[key])[:-1] for key in STANDARD_KEYS}
    if len(set(rows.values())) > 1:
        raise ValueError(f"the observation has rows {rows}; all keys must have as many, or none")
    return bool(np.ndim(observation[STANDARD_KEYS[0]]) == 1)


def foreign(found: str) -> ValueError:
    """The error where `predict` was given a state that its agent has not returned: one that "is 5"."""
    return ValueError(f"the state {found}; pass the state back that this agent's last call returned")


_KEYS = ", ".join(STANDARD_KEYS)


class TrialBeginnings:
    """Tells where trials begin, and where a caller has lost the state in the middle of one.

    Registers at home are measured: near zero, not zero. So it also knows what was told last: registers that
    stand where those words led, away from home, are of the middle of a trial, however small the words were.
    """

    def __init__(self) -> None:
        self._registers, self._words = np.zeros((2, 0, 0))

    def sent(self, registers: Array, words: NDArray[np.floating]) -> None:
        """Words (n, m), or (m,), were sent where registers were (n, m)."""
        self._registers, self._words = registers, np.reshape(np.asarray(words, float), registers.shape)

    def where(self, registers: Array, rows_of_state: int | None, episode_start: Flags | None) -> Flags:
        """Where (n,) a new trial begins.

        Args:
            registers: Of a batch of n environments (n, m).
            rows_of_state: How many environments the state is of; None where there is no state.
            episode_start: Where (n,) the caller says that one begins.

        Raises:
            ValueError: There is no state in the middle of a trial, or it is of another number of rows.
        """
        rows = len(registers)
        starts = np.zeros(rows, bool) if episode_start is None else np.atleast_1d(episode_start)
        if rows_of_state is not None and rows_of_state != rows:
            raise ValueError(f"the state is of {rows_of_state} environments, the observation of {rows}")
        if len(starts) != rows:
            raise ValueError(f"episode_start has {len(starts)} entries for {rows} environments")
        if rows_of_state is not None:
            return np.asarray(starts, bool)
        far = (np.abs(registers) >= RegisterEstimate.HOME).any(1)
        away = ~starts.astype(bool) & (far | self._led(registers))
        if away.any():
            raise ValueError(
                "predict got state=None in the middle of a trial (registers are "
                f"{registers[away.argmax()].tolist()}): pass the state back that the last call returned, "
                "or episode_start where a new trial begins"
            )
        return np.ones(rows, bool)

    def _led(self, registers: Array) -> Flags:
        """Where (n,) the last words led to these registers (n, m), away from home."""
        if registers.shape != self._registers.shape:
            return np.zeros(len(registers), bool)
        far = np.abs(self._words).max(1) / 2
        off = np.abs(registers - self._registers - self._words).max(1)
        return np.asarray((off < far) & (np.abs(registers).max(1) > far))
