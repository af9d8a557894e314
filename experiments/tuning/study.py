"""The tries of one agent, kept by Optuna in a journal: started again, it goes on where it was."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import optuna
from optuna.distributions import (
    BaseDistribution,
    CategoricalDistribution,
    FloatDistribution,
    IntDistribution,
)
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend, JournalFileSymlinkLock
from optuna.trial import Trial, TrialState

from experiments.errors import ConfigError
from experiments.tuning.config import RangeConfig, TunedAgentConfig

DIGITS = 3
"""Of numbers that are tried: so the published ones are those that were used."""
_ABOUT, _CHECKED, _FOUND = "about", "checked", "found"


@dataclass(frozen=True, slots=True)
class Try:
    """Some settings, and what they came to.

    Attributes:
        settings: Of the agent, those that are varied.
        state: "complete"; "pruned": given up after some worlds, where it was worse than the median of earlier
            tries; "out of time": the agent's CPU time ran out; "failed": the agent raised an error, which
            counts as worst; "repeated": settings of an earlier try, whose result holds.
        objective: Mean over the worlds; None where not all of them were made.
        worlds: The objective in each.
        cpu_seconds: That it took.
        error: What it failed with.
    """

    settings: dict[str, Any]
    state: str
    objective: float | None
    worlds: tuple[float, ...]
    cpu_seconds: float
    error: str | None = None


class Study:
    """Says what to try next, and keeps what came of it.

    The settings of try k follow from the seed, k and the results of earlier tries alone, so that a study that
    was killed and started again makes the same tries.

    Args:
        journal: The file; the lock of its folder keeps other processes from it.
        agent: Whose settings are varied. Try 0 is that of the default ones.
        about: What defines the tries, as JSON has it.
        seed: Of the sampler, a tree-structured Parzen estimator (Bergstra et al. 2011).

    Attributes:
        about: As given when the study began.

    Raises:
        ConfigError: The journal is of other code or of another configuration, or damaged.
    """

    def __init__(self, journal: Path, agent: TunedAgentConfig, about: dict[str, Any], seed: int):
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        self._defaults, self._choices, self._seed = agent.defaults(), agent.choices, seed
        self._distributions: dict[str, BaseDistribution] = {
            **{name: _numbers(found) for name, found in agent.ranges.items()},
            **{name: CategoricalDistribution(_texts(found)) for name, found in agent.choices.items()},
        }
        try:
            self._study = _opened(journal, agent.name)
        except (KeyError, ValueError) as error:
            raise ConfigError(f"{journal} is damaged: {error!r}; delete it to begin anew") from None
        if _ABOUT not in self._study.user_attrs:
            self._study.set_user_attr(_ABOUT, about)
        self.about: dict[str, Any] = self._study.user_attrs[_ABOUT]
        self._end_what_a_kill_left()

    @property
    def tries(self) -> list[Try]:
        """All that were made, in their order; one that a kill cut short is none."""
        return [
            Try(**trial.user_attrs[_FOUND])
            for trial in self._study.get_trials(deepcopy=False)
            if _FOUND in trial.user_attrs
        ]

    @property
    def best(self) -> Try | None:
        """The one with the least objective, the first of equal ones; None where none was made whole."""
        whole = [(each.objective, k) for k, each in enumerate(self.tries) if each.objective is not None]
        return self.tries[min(whole)[1]] if whole else None

    def begin(self) -> tuple[Trial, dict[str, Any]]:
        """The next try, and its settings."""
        k = len(self.tries)
        if k == 0 and not self._study.get_trials(deepcopy=False, states=(TrialState.WAITING,)):
            texts = {name: json.dumps(self._defaults[name]) for name in self._choices}
            self._study.enqueue_trial(self._defaults | texts)
        seed = np.random.SeedSequence(self._seed, spawn_key=(k,)).generate_state(1)[0]
        self._study.sampler = optuna.samplers.TPESampler(seed=int(seed))
        trial = self._study.ask(self._distributions)
        return trial, self._defaults if k == 0 else self._settings(trial.params)

    def end(self, trial: Trial, found: Try) -> None:
        """Keeps what came of a try."""
        trial.set_user_attr(_FOUND, asdict(found))
        self._tell(trial.number, found)

    def earlier(self, settings: dict[str, Any]) -> Try | None:
        """The try of the same settings, if there was one: its result would come again."""
        return next((each for each in self.tries if each.settings == settings), None)

    def checked(self, settings: dict[str, Any]) -> dict[str, Any] | None:
        """What `keep_checked` kept of these settings."""
        return self._study.user_attrs.get(f"{_CHECKED} {json.dumps(settings)}")

    def keep_checked(self, settings: dict[str, Any], found: dict[str, Any]) -> None:
        """Keeps what settings came to in other worlds."""
        self._study.set_user_attr(f"{_CHECKED} {json.dumps(settings)}", found)

    def _end_what_a_kill_left(self) -> None:
        for left in self._study.get_trials(deepcopy=False, states=(TrialState.RUNNING,)):
            if _FOUND in left.user_attrs:
                self._tell(left.number, Try(**left.user_attrs[_FOUND]))
            else:
                self._study.tell(left.number, state=TrialState.FAIL)

    def _tell(self, number: int, found: Try) -> None:
        if found.objective is not None:
            self._study.tell(number, found.objective)
        elif found.state == "out of time":
            self._study.tell(number, state=TrialState.FAIL)
        else:
            self._study.tell(number, state=TrialState.PRUNED)

    def _settings(self, suggested: dict[str, Any]) -> dict[str, Any]:
        return {
            name: json.loads(value)
            if name in self._choices
            else value
            if isinstance(value, int)
            else float(f"{value:.{DIGITS}g}")
            for name, value in suggested.items()
        }


class _LockOfFolder(JournalFileSymlinkLock):
    """Nothing to do: the folder has a lock, which, unlike Optuna's, does not outlast its process."""

    def acquire(self) -> bool:
        return True

    def release(self) -> None:
        pass


def _opened(journal: Path, name: str) -> optuna.Study:
    """The study in a file, whose last line a kill may have torn."""
    if journal.exists():
        whole, newline, _ = journal.read_bytes().rpartition(b"\n")
        with journal.open("r+b") as file:
            file.truncate(len(whole + newline))
    return optuna.create_study(
        storage=JournalStorage(JournalFileBackend(str(journal), lock_obj=_LockOfFolder(str(journal)))),
        study_name=name,
        pruner=optuna.pruners.MedianPruner(),
        load_if_exists=True,
    )


def _numbers(found: RangeConfig) -> BaseDistribution:
    if found.whole:
        return IntDistribution(int(found.low), int(found.high), log=found.log)
    return FloatDistribution(float(found.low), float(found.high), log=found.log)


def _texts(choices: list[Any]) -> list[str]:
    """Choices as JSON, as Optuna keeps texts and numbers only."""
    return [json.dumps(choice) for choice in choices]
