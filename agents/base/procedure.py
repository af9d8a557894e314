"""A controller that is written like the paper, as a coroutine, and gets the surface of every agent.

A procedure yields control words and is sent what is observed after them. What it finds out on its way it
writes into its *findings*. `learn` hands the findings of a finished trial to the agent; `predict` drops them.
"""

from __future__ import annotations

import warnings
from abc import abstractmethod
from collections.abc import Generator, Mapping
from copy import deepcopy
from dataclasses import replace
from typing import Any, ClassVar, Self

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from . import storage
from .agent import Agent, Callback, foreign, is_of_one
from .checks import check_number
from .observation import Array, Observation, RawObservation
from .registers import Encoders, RegisterEstimate
from .storage import AgentFile

Procedure = Generator[Array, Observation, None]
"""Seeks the rendezvous in one trial. After its end the agent sends zero words."""


class RunningTrial:
    """A procedure at work, and what it has found out so far.

    It stands between the procedure and the robot: words are sent so that motors execute what is wanted, and
    registers, which are measured, come in as where motors stand. As long as no point was seen, nothing moves.

    Attributes:
        of: Whose procedure it is: the agent's class, kind and motors.
        findings: Where it writes what it finds out.
        says: Why it does not go on, or nothing.

    Args:
        agent: Whose trial it is.
        measured: What registers say (m,) where it begins.
        encoders: What is known of registers; it learns on.
    """

    UNSEEN = "no point has been seen in either image, so nothing moves"
    UNMOVED = "no motor has moved by any of its last words"
    WORDS = 6
    """So many words without a motion are told. Choice: both directions of three motors."""

    def __init__(self, agent: ProcedureAgent, measured: Array, encoders: Encoders) -> None:
        self.of = agent._like
        self.findings = agent.new_findings()
        self.says = ""
        self._agent = agent
        self._registers = RegisterEstimate(measured, encoders)
        self._sent: Array | None = None
        self._unmoved = 0
        self._procedure: Procedure | None = None

    def __repr__(self) -> str:
        agent, kind, motors = self.of
        return f"a trial of {agent.__name__} ({kind}, {motors} motors)"

    def look(self, observed: Any) -> Any:
        """What is observed, with registers as where motors stand."""
        if self._sent is not None:
            before = self._registers.registers
            moved = bool((self._registers.after(self._sent, observed.registers) != before).any())
            self._unmoved = 0 if moved else self._unmoved + bool(self._sent.any())
        return replace(observed, registers=self._registers.registers)

    def words(self, now: Any) -> Array:
        """The next control words (m,) to send; zero words once the procedure has ended."""
        wanted = np.asarray(self._wanted(now), float)
        if wanted.shape != now.registers.shape:
            agent, _, motors = self.of
            raise ValueError(f"{agent.__name__}.procedure yields {wanted!r:.80}; it must be {motors} words")
        why = self._agent.why_still(self.findings) or (self.UNMOVED if self._unmoved >= self.WORDS else "")
        why = self.UNSEEN if self._procedure is None else why
        if why and not self.says:
            warnings.warn(f"{self!r}: {why}", stacklevel=3)
        self.says = why
        return self.send(self._registers.words(wanted))

    def send(self, words: Array) -> Array:
        """Notes that these words (m,) are sent."""
        self._sent = np.asarray(words, np.float32)
        return words

    def _wanted(self, now: Any) -> Array:
        try:
            if self._procedure is not None:
                return self._procedure.send(now)
            if now.visible.any() or not self._agent.needs_points:
                self._procedure = self._agent.procedure(now, self.findings)
                return next(self._procedure)
        except StopIteration:
            pass
        return np.zeros_like(now.registers)


class ProcedureAgent(Agent):
    """An agent whose behaviour in one trial is a procedure.

    Attributes:
        needs_points: Whether it cannot begin before a point is seen.
    """

    needs_points: ClassVar[bool] = True

    def __init__(self, env: gym.Env[Any, Any], seed: int = 0) -> None:
        super().__init__(env, seed)
        self._encoders = Encoders()

    @abstractmethod
    def procedure(self, first: Observation, findings: Any) -> Procedure:
        """Seeks the rendezvous from the trial's first observation on.

        Args:
            first: What is observed at home.
            findings: What `new_findings` returned; the procedure writes into it what it finds out.
        """

    def observed(self, raw: RawObservation) -> Any:
        """What is observed, as procedures get it."""
        return Observation.of(raw)

    def new_findings(self) -> Any:
        """Where a trial's findings go; None for agents that do not learn."""
        return None

    def learn_trial(self, findings: Any, last: Observation, ended: bool) -> None:
        """Takes over what a trial of its own has found out.

        Args:
            findings: Of the trial, its last observation included.
            last: The trial's last observation.
            ended: Whether the environment ended it. A trial that was cut off teaches no end.
        """

    def why_still(self, findings: Any) -> str:
        """Why the procedure that wrote these findings knows no further motion; or nothing."""
        return ""

    def explore(self, words: Array, now: Observation) -> Array:
        """Words (m,) that `learn` makes in place of the procedure's; the same, unless it explores."""
        return words

    def learn_motion(self, findings: Any, before: Observation, after: Observation) -> None:
        """Learns from a motion of its own at once; nothing by default.

        Args:
            findings: Of the trial, as `new_findings` made them; the same object for all motions of a trial.
            before: What was observed before the motion.
            after: What was observed after it.
        """

    @property
    @abstractmethod
    def kind(self) -> str:
        """What it is, with all settings: it loads only what its like has saved."""

    def present_kind(self, saved: str) -> str:
        """What is called now what a saved file of an earlier version calls `saved`."""
        return saved

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All that it knows, as named arrays; nothing, unless it learns."""
        return {}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Takes over what `arrays` returned."""

    def predict(
        self,
        observation: RawObservation,
        state: list[RunningTrial] | None = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], list[RunningTrial]]:
        """See `Agent`. The state is opaque and consumed by the call."""
        single = is_of_one(observation, self.env.observation_space)
        if state is not None:
            self._check_state(state)
        rows = [self.observed(row) for row in ([observation] if single else _rows(observation))]
        registers = np.array([row.registers for row in rows])
        begins = self._beginnings.where(registers, None if state is None else len(state), episode_start)
        words, after = [], []
        for i, observed in enumerate(rows):
            new = state is None or begins[i]
            trial = RunningTrial(self, observed.registers, deepcopy(self._encoders)) if new else state[i]  # type: ignore[index]
            words.append(trial.words(trial.look(observed)))
            after.append(trial)
        stacked = np.asarray(words, np.float32)
        self._beginnings.sent(registers, stacked)
        return (stacked[0] if single else stacked), after

    def _check_state(self, state: Any) -> None:
        like = self._like
        for trial in state if isinstance(state, list) else [state]:
            if getattr(trial, "of", None) != like:
                raise foreign(f"holds {trial!r}")

    def learn(self, total_timesteps: int, callback: Callback | None = None) -> Self:
        check_number("total_timesteps", total_timesteps, least=0, whole=True)
        target = self.num_timesteps + total_timesteps
        go_on = True
        while go_on and self.num_timesteps < target:
            go_on = self._live_trial(target, callback)
        return self

    def _live_trial(self, target: int, callback: Callback | None) -> bool:
        """One trial of its own, cut off where `target` motions were made; whether the callback goes on."""
        raw, _ = self.env.reset()
        observed = self.observed(raw)
        trial = RunningTrial(self, observed.registers, self._encoders)
        now = trial.look(observed)
        words = trial.words(now)
        while True:
            words = trial.send(self.explore(words, now))
            raw, _, terminated, truncated, _ = self.env.step(words.astype(np.float32))
            before, now = now, trial.look(self.observed(raw))
            self.num_timesteps += 1
            self.learn_motion(trial.findings, before, now)
            over = bool(terminated or truncated)
            if over:
                now = replace(now, last=True)
                trial.words(now)
                self.learn_trial(trial.findings, now, bool(terminated))
            go_on = callback is None or callback(self)
            if over or not go_on or self.num_timesteps >= target:
                return go_on
            words = trial.words(now)

    def _known(self) -> dict[str, NDArray[Any]]:
        return self.arrays() | self._encoders.arrays()

    def _take_over(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        self._encoders = Encoders.of(arrays)
        self.restore({name: each for name, each in arrays.items() if not name.startswith(Encoders.NAME)})

    @property
    def _like(self) -> tuple[type[ProcedureAgent], str, int]:
        return type(self), self.kind, self._motors

    @property
    def _motors(self) -> int:
        return int(self.env.action_space.shape[-1])  # type: ignore[index]

    def save(self, path: AgentFile) -> None:
        own, plain = type(self), ProcedureAgent
        learns = own.learn_trial is not plain.learn_trial or own.learn_motion is not plain.learn_motion
        if learns and (own.arrays is plain.arrays or own.restore is plain.restore):
            raise TypeError(
                f"{own.__name__} learns, but has no arrays and restore of its own: that would be lost"
            )
        storage.save(path, self.kind, self._known(), self.num_timesteps, self._motors)

    def load(self, path: AgentFile) -> Self:
        arrays, motions = storage.load(path, self.kind, self._motors, self.present_kind)
        before = self._known()
        try:
            self._take_over(arrays)
        except (KeyError, ValueError, IndexError, TypeError) as error:
            self._take_over(before)
            raise ValueError(f"{path} is damaged: {error}") from error
        self.num_timesteps = motions
        return self


def _rows(observation: RawObservation) -> list[RawObservation]:
    count = len(observation["achieved_goal"])
    return [{key: value[i] for key, value in observation.items()} for i in range(count)]
