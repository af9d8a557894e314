"""One agent's lifetime, recorded at its environment: motions counted, trials and perturbations noted."""

import copy
from collections.abc import Callable
from typing import Any

import gymnasium

from experiments.evaluation import TrialMeter, TrialRecord

MOST_MOTIONS = 1_000
"""Motions that `learn_trials` allows for in a trial: it stops by trials, unless trials are longer."""


class Onlooker:
    """Is told of moments of a lifetime in which the agent waits for its robot; does nothing by itself."""

    def before_motion(self) -> None:
        """The agent is about to move, in the world of its last motion."""

    def before_change(self) -> None:
        """The world is about to change."""

    def after_change(self) -> None:
        """The world has changed, and the agent has not moved in it yet."""


class LifetimeCounts:
    """What is counted in a lifetime, of one arm or of rows.

    Attributes:
        onlooker: See `Onlooker`.
        motions: Lifetime motions.
        records: Of the trials that have ended. A trial cut off by a reset has none.
        perturbations: Lifetime motions made before each, index of the trial that it met, and what it was.
    """

    motions: int
    records: list[TrialRecord]
    perturbations: list[tuple[int, int, dict[str, Any]]]
    onlooker = Onlooker()

    def _count_from_zero(self) -> None:
        self.motions, self.records, self.perturbations = 0, [], []

    @property
    def trials(self) -> int:
        """How many trials have ended."""
        return len(self.records)

    @property
    def since_perturbation(self) -> int | None:
        """Motions since the last perturbation; None before any."""
        return self.motions - self.perturbations[-1][0] if self.perturbations else None


def refuse_options(options: dict[str, Any] | None) -> None:
    """Raises where a reset of a run gets options.

    Raises:
        ValueError: They are given.
    """
    if options:
        raise ValueError(f"reset got options {options!r}; a run's trials are fixed, it takes none")


class LifetimeRecorder(LifetimeCounts, gymnasium.Wrapper[Any, Any, Any, Any]):
    """Counts every motion in the environment, where no agent can miscount it.

    The world belongs to the run: the first reset is seeded with `seed`, and a seed that an agent
    passes later is ignored. A reset before a trial's first motion (zero words count) repeats its first
    observation, so that trial t is the same trial for every agent, however often it resets.

    World and perturbations are those of the last motion: what a reset has changed belongs to the next
    one. So it makes no difference whether an agent resets at once after a trial or only when it goes on.

    Attributes:
        world: The world in which the last motion was made (at first: the world to begin in).
        motions, records, perturbations: See `LifetimeCounts`; all up to the last motion.

    Args:
        env: The agent's environment, with its schedule of perturbations.
        seed: Seeds world, objects and noise.
        on_trial: Called with the record of each finished trial.
    """

    def __init__(
        self,
        env: gymnasium.Env[Any, Any],
        seed: int,
        on_trial: Callable[[TrialRecord], None] = lambda record: None,
    ):
        super().__init__(env)
        self._on_trial = on_trial
        self._trial = 0
        self._count_from_zero()
        self._begin(*env.reset(seed=seed))
        self._note([])

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Places the next object, unless the present trial has not begun.

        Raises:
            ValueError: Options are given.
        """
        refuse_options(options)
        if self._meter.motions:
            self._trial += 1
            self._begin(*self.env.reset())
        return copy.deepcopy(self._first)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Makes one motion, and counts it."""
        self.onlooker.before_motion()
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._note(self._applied())
        self.motions += 1
        self._meter.add(info)
        if terminated or truncated:
            self.records.append(self._meter.record())
            self._on_trial(self.records[-1])
        return observation, reward, terminated, truncated, info

    def _begin(self, observation: Any, info: dict[str, Any]) -> None:
        self._applied_by_reset = self._applied()
        self._first = observation, info
        self._meter = TrialMeter(self.env, self._trial, info)

    def _applied(self) -> list[Any]:
        env: Any = self.env.unwrapped
        applied: list[Any] = env.applied
        return applied

    def _note(self, applied: list[Any]) -> None:
        env: Any = self.env.unwrapped
        changes = [*self._applied_by_reset, *applied]
        self._applied_by_reset = []
        if changes:
            self.onlooker.before_change()
        self.world = env.world
        for perturbation in changes:
            self.perturbations.append((self.motions, self._trial, perturbation.to_dict()))
        if changes:
            self.onlooker.after_change()


def learn_trials(
    agent: Any, recorder: LifetimeRecorder, trials: int, after_motion: Callable[[], None] = lambda: None
) -> list[TrialRecord]:
    """Lets an agent learn until this many trials have ended in its environment.

    Args:
        agent: Made for `recorder`.
        recorder: Records the agent's lifetime.
        trials: Ended trials at which it stops, those before the call included.
        after_motion: Called after every motion.

    Returns:
        The records of all trials.
    """

    def go_on(progress: Any) -> bool:
        after_motion()
        return recorder.trials < trials

    agent.learn(trials * MOST_MOTIONS, callback=go_on)
    return recorder.records
