"""What is tried next for one agent, by Optuna: it follows from a seed, and what earlier tries came to."""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
import optuna
from optuna.distributions import (
    BaseDistribution,
    CategoricalDistribution,
    FloatDistribution,
    IntDistribution,
)
from optuna.trial import Trial, TrialState

from experiments.tuning.config import RangeConfig, TunedAgentConfig

DIGITS = 3
"""Of numbers that are tried: so the published ones are those that were used."""


@dataclass(frozen=True, slots=True)
class Try:
    """Some settings, and what they came to.

    Attributes:
        state: "complete"; "pruned": given up after some worlds, where it was worse than the median of earlier
            tries; "out of time": the agent's CPU time ran out; "failed": the agent raised an error, which
            counts as worst; "repeated": settings of an earlier try, whose result holds.
    """

    settings: dict[str, Any]
    state: str
    objective: float | None
    worlds: tuple[float, ...]
    cpu_seconds: float
    error: str | None = None


class Study:
    """Says what to try next.

    Args:
        agent: Whose settings are varied. Try 0 is that of the default ones.
        seed: Of the sampler, a tree-structured Parzen estimator (Bergstra et al. 2011).

    Attributes:
        tries: All that have ended.
    """

    def __init__(self, agent: TunedAgentConfig, seed: int):
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        self.tries: list[Try] = []
        self._defaults, self._choices, self._seed = agent.defaults(), agent.choices, seed
        self._distributions: dict[str, BaseDistribution] = {
            **{name: _numbers(found) for name, found in agent.ranges.items()},
            **{name: CategoricalDistribution(_texts(found)) for name, found in agent.choices.items()},
        }
        self._study = optuna.create_study(pruner=optuna.pruners.MedianPruner())
        texts = {name: json.dumps(self._defaults[name]) for name in self._choices}
        self._study.enqueue_trial(self._defaults | texts)

    @property
    def best(self) -> Try | None:
        """The one with the least objective, the first of equal ones; None where none was made whole."""
        whole = [(each.objective, k) for k, each in enumerate(self.tries) if each.objective is not None]
        return self.tries[min(whole)[1]] if whole else None

    def begin(self) -> tuple[Trial, dict[str, Any]]:
        """The next try, and its settings."""
        k = len(self.tries)
        seed = np.random.SeedSequence(self._seed, spawn_key=(k,)).generate_state(1)[0]
        self._study.sampler = optuna.samplers.TPESampler(seed=int(seed))
        trial = self._study.ask(self._distributions)
        return trial, self._settings(trial.params) if k else self._defaults

    def end(self, trial: Trial, found: Try) -> None:
        """Says what came of a try."""
        self.tries.append(found)
        if found.objective is not None:
            self._study.tell(trial, found.objective)
        else:
            out_of_time = found.state == "out of time"
            self._study.tell(trial, state=TrialState.FAIL if out_of_time else TrialState.PRUNED)

    def earlier(self, settings: dict[str, Any]) -> Try | None:
        """The try of the same settings, if there was one: its result would come again."""
        return next((each for each in self.tries if each.settings == settings), None)

    def _settings(self, suggested: dict[str, Any]) -> dict[str, Any]:
        return {
            name: json.loads(value)
            if name in self._choices
            else value
            if isinstance(value, int)
            else float(f"{value:.{DIGITS}g}")
            for name, value in suggested.items()
        }


def _numbers(found: RangeConfig) -> BaseDistribution:
    if found.whole:
        return IntDistribution(int(found.low), int(found.high), log=found.log)
    return FloatDistribution(float(found.low), float(found.high), log=found.log)


def _texts(choices: list[Any]) -> list[str]:
    """Choices as JSON, as Optuna keeps texts and numbers only."""
    return [json.dumps(choice) for choice in choices]
