"""One agent's lifetime, recorded at its environment: motions counted, trials and perturbations noted."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorWrapper
from numpy.typing import NDArray

from calfree_gym.engine.arms import Arms
from calfree_gym.engine.vector import Row, final_of_rows
from calfree_gym.perturbations.schedule import Event, PerturbationScheduler
from experiments.config.environment import EnvironmentConfig
from experiments.evaluation import TrialMeter, TrialRecord

MOST_MOTIONS = 1_000
"""Motions that `learn_trials` allows for in a trial: it stops by trials, unless trials are longer."""


class Onlooker:
    """Is told of moments of a lifetime in which the agent waits for its robot; does nothing by itself."""

    def before_motion(self) -> None:
        """The agent is about to move, in the world of its last motion."""

    def before_change(self, trial: int) -> None:
        """The world is about to change, in the trial of this index."""

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
    """Raises ValueError where a reset of a run gets options."""
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

    Args:
        places: Objects lie in turn where the first so many lay; None: each at its own place.
    """

    def __init__(
        self,
        env: gymnasium.Env[Any, Any],
        seed: int,
        on_trial: Callable[[TrialRecord], None] = lambda record: None,
        places: int | None = None,
    ):
        super().__init__(env)
        self._on_trial = on_trial
        self._places = places
        self._objects: list[Any] = []
        self._trial = 0
        self._count_from_zero()
        self._begin(*env.reset(seed=seed))
        self._note([])

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Places the next object, unless the present trial has not begun; takes no options."""
        refuse_options(options)
        if self._meter.motions:
            self._trial += 1
            again = self._places is not None and self._trial >= self._places
            options = {"object": self._objects[self._trial % len(self._objects)]} if again else None
            self._begin(*self.env.reset(options=options))
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
        if self._places is not None and len(self._objects) < self._places:
            self._objects.append(info["truth"]["object"])

    def _applied(self) -> list[Any]:
        env: Any = self.env.unwrapped
        applied: list[Any] = env.applied
        return applied

    def _note(self, applied: list[Any]) -> None:
        env: Any = self.env.unwrapped
        changes = [*self._applied_by_reset, *applied]
        self._applied_by_reset = []
        if changes:
            self.onlooker.before_change(self._trial)
        self.world = env.world
        for perturbation in changes:
            self.perturbations.append((self.motions, self._trial, perturbation.to_dict()))
        if changes:
            self.onlooker.after_change()


def learn_trials(
    agent: Any, recorder: LifetimeRecorder, trials: int, after_motion: Callable[[], None] = lambda: None
) -> list[TrialRecord]:
    """Lets an agent learn until so many trials, all before included, have ended; returns their records."""

    def go_on(progress: Any) -> bool:
        after_motion()
        return recorder.trials < trials

    agent.learn(trials * MOST_MOTIONS, callback=go_on)
    return recorder.records


_CLOCKS = ("trial", "motion")


class RowsRecorder(LifetimeCounts, VectorWrapper[Any, Any, Any, Any, Any]):
    """`LifetimeRecorder` for an agent that learns from rows: a batched environment with SAME_STEP autoreset.

    The world is the one that any agent meets under this seed, and perturbations are drawn as in its single
    environment. An event is applied to all rows before the first motion after which their summed motions, or
    their ended trials, have reached it. Row 0 meets the objects that a single environment would. Trials of
    all rows are numbered as they end.
    """

    def __init__(
        self,
        config: EnvironmentConfig,
        rows: int,
        privileged: tuple[str, ...],
        schedule: tuple[dict[str, Any], ...],
        seed: int,
        on_trial: Callable[[TrialRecord], None] = lambda record: None,
    ):
        self.world = _world(config, seed)
        super().__init__(config.make_rows(rows, self.world, privileged))
        self.metadata = {**self.env.metadata, "autoreset_mode": AutoresetMode.SAME_STEP}
        stereo: Any = self.env.unwrapped
        arms: Arms = stereo.arms
        self._arms = arms
        self._scheduler = PerturbationScheduler(
            1,
            list(schedule),
            arms.robot,
            arms.mounts,
            config.keep_in_view,
            arms.as_seen,
            arms.can_begin,
            arms.new_workspaces(1),
        )
        self._scheduler.seed(0, seed)
        self._applied = dict.fromkeys(_CLOCKS, -1)
        self._on_trial = on_trial
        self._moved = False
        self._count_from_zero()
        self._apply_due("trial")
        self._first = self.env.reset(seed=seed)
        self._meters = [self._meter(row, self._first[1]) for row in range(rows)]

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begins a trial in every row, unless none has moved yet. A trial cut off has no record."""
        refuse_options(options)
        if self._moved:
            self._moved = False
            self._first = self.env.reset()
            self._meters = [self._meter(row, self._first[1]) for row in range(self.num_envs)]
        return self._first

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Makes one motion in every row, counts them, and begins the next trials of rows that are over."""
        self.onlooker.before_motion()
        self._apply_due(*_CLOCKS)
        self._moved = True
        observation, rewards, terminated, truncated, infos = self.env.step(actions)
        self.motions += self.num_envs
        over = terminated | truncated
        for row, meter in enumerate(self._meters):
            meter.add(_of_row(infos, row))
            if over[row]:
                self.records.append(replace(meter.record(), trial=self.trials))
                self._on_trial(self.records[-1])
        if over.any():
            final = final_of_rows(observation, infos, over)
            observation, infos = self.env.reset(options={"reset_mask": over})
            for begun in np.flatnonzero(over).tolist():
                self._meters[begun] = self._meter(begun, infos)
            infos |= final
        return observation, rewards, terminated, truncated, infos

    def _meter(self, row: int, infos: dict[str, Any]) -> TrialMeter:
        envs: Any = self.env.unwrapped
        return TrialMeter(Row(envs, row), 0, _of_row(infos, row))  # type: ignore[arg-type]

    def _apply_due(self, *clocks: str) -> None:
        """Applies to all rows what has become due since the last call, by the counts at which it was due."""
        due = [each for clock in clocks for each in self._newly_due(clock)]
        if not due:
            return
        world, changes = self.world, []
        for at, place, event in due:
            world, drawn = self._scheduler.apply(place, event, 0, at, world)
            changes += [] if drawn is None else [(self.motions, self.trials, drawn.to_dict())]
        self._arms.enter(0, world)  # it was in all that was judged
        if world is not self.world:
            rows: Any = self.env.unwrapped
            rows.set_world(world)
        if changes:
            self.onlooker.before_change(self.trials)
        self.world = world
        self.perturbations += changes
        if changes:
            self.onlooker.after_change()

    def _newly_due(self, clock: str) -> list[tuple[int, int, Event]]:
        """Counts at which events have become due, with these and their places in the schedule."""
        count = {"motion": self.motions, "trial": self.trials}[clock]
        since, self._applied[clock] = self._applied[clock] + 1, count
        return [
            (at, place, event)
            for at in range(since, count + 1)
            for place, event in self._scheduler.events[clock]
            if event.is_due(np.array([at]))[0]
        ]


def _of_row(infos: dict[str, Any], row: int) -> dict[str, Any]:
    """What `TrialMeter` reads of one row's info."""
    truth: dict[str, NDArray[Any]] = infos["truth"]
    return {
        "truth": {name: float(values[row]) for name, values in truth.items() if values.ndim == 1},
        "is_success": infos["is_success"][row],
        "robot_seconds": infos["robot_seconds"][row],
    }


def _world(config: EnvironmentConfig, seed: int) -> Any:
    """The world that the single environment draws from this seed."""
    single: gymnasium.Env[Any, Any] = config.make()
    single.reset(seed=seed)
    drawn: Any = single.unwrapped
    single.close()
    return drawn.world
