"""Tuning one agent: tries within its budget, then the best beside the default settings in other worlds."""

import json
import math
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import optuna
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution, IntDistribution
from optuna.trial import Trial, TrialState

from experiments.errors import ConfigError
from experiments.running.process import OVER_BUDGET, Worker, lent_worker
from experiments.running.results_folder import (
    RUN,
    TIMINGS,
    TRIALS,
    leaves,
    read_json,
    refuse_links,
    write_whole,
)
from experiments.running.run import LifetimeRun, runs_of
from experiments.statistics import mean_estimate
from experiments.tuning.config import RangeConfig, TunedAgentConfig, TuningConfig

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
    """

    def __init__(self, agent: TunedAgentConfig, seed: int):
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        self.tries: list[Try] = []
        self._defaults, self._ranges, self._choices = agent.defaults(), agent.ranges, agent.choices
        self._seed = seed
        self._distributions: dict[str, BaseDistribution] = {
            **{name: _numbers(found) for name, found in agent.ranges.items()},
            # as JSON: Optuna keeps texts and numbers only
            **{name: CategoricalDistribution([*map(json.dumps, of)]) for name, of in agent.choices.items()},
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
            else min(max(float(f"{value:.{DIGITS}g}"), self._ranges[name].low), self._ranges[name].high)
            for name, value in suggested.items()
        }


def _numbers(found: RangeConfig) -> BaseDistribution:
    if found.whole:
        return IntDistribution(int(found.low), int(found.high), log=found.log)
    return FloatDistribution(float(found.low), float(found.high), log=found.log)


class LostError(Exception):
    """A worker was stopped, or died: nothing follows about its settings."""


class Lived(NamedTuple):
    """What a lifetime came to: see `motions_per_reach`; None where it failed, or its CPU time ran out."""

    value: float | None
    error: str | None
    cpu_seconds: float


class Lifetimes:
    """Lets workers of some versions make lifetimes, several at a time from several threads."""

    def __init__(self, versions: dict[str, str]) -> None:
        self._versions = versions
        self._at_work: set[Worker] = set()

    def make(self, run: LifetimeRun, cpu_seconds: float, log: Path) -> Lived:
        """Makes a lifetime, and keeps nothing else of it; what it prints is appended to `log`."""
        refuse_links(log)
        with (
            lent_worker(self._versions) as worker,
            TemporaryDirectory(ignore_cleanup_errors=True) as name,
            log.open("a+", encoding="utf-8") as printed,
        ):
            folder, begun = Path(name), printed.seek(0, os.SEEK_END)
            write_whole(folder / RUN, run.model_dump_json())
            self._at_work.add(worker)
            code = worker.make(folder, printed, cpu_seconds)
            self._at_work.discard(worker)
            if code == OVER_BUDGET:
                return Lived(None, None, cpu_seconds)
            if code not in (0, 1) or not (folder / TIMINGS).exists():
                raise LostError(f"its process ended with exit code {code}; see {log}")
            used = read_json(folder / TIMINGS)["cpu_seconds"]
            if code == 1:  # whatever an agent raises with these settings
                printed.seek(begun)
                return Lived(None, printed.read().strip().rpartition("\n")[2] or "it printed nothing", used)
            return Lived(motions_per_reach(folder, run.scenario.env.max_episode_steps), None, used)

    def stop(self) -> None:
        """Ends all workers that are at work."""
        for worker in list(self._at_work):
            worker.kill()


def motions_per_reach(folder: Path, cap: int) -> float:
    """Motions of a held-out reach, mean over all checkpoints of the lifetime in a folder.

    A trial without a rendezvous counts as the cap. So it counts how much an agent knows in the end, how soon
    it knew it, and what a change of the world costs it.
    """
    trials = map(json.loads, (folder / TRIALS).read_text(encoding="utf-8").splitlines())
    held_out = [trial for trial in trials if trial["phase"] == "eval"]
    return float(np.mean([trial["motions"] if trial["rendezvous"] else cap for trial in held_out]))


class DefaultsFailError(Exception):
    """An agent raises an error with its default settings, which are what others are compared with."""


@dataclass
class Tuner:
    """Tunes one agent.

    Its journal holds, one a line, what defines the tries, and what each lifetime came to. All else follows
    from these, so that a tuner that was killed and started again makes the same tries. The folder keeps the
    journal and what workers print; lifetimes are made by `make`, see `Lifetimes.make`.
    """

    config: TuningConfig
    agent: TunedAgentConfig
    folder: Path
    make: Callable[[LifetimeRun, float, Path], Lived]
    versions: dict[str, str]
    commit: str
    say: Callable[[str], None]

    def __post_init__(self) -> None:
        config, agent = self.config, self.agent
        self.name = agent.name
        self._scenario = config.scenario_of(agent)
        self._worst = float(self._scenario.env.max_episode_steps)
        self._log = self.folder / f"{agent.name}.txt"
        self._journal = self.folder / f"{agent.name}.journal"
        self._study = Study(agent, config.seed)
        defined_by = {
            "agent": agent.model_dump(mode="json"),
            "scenario": self._scenario.model_dump(mode="json"),
            "seed": config.seed,
            "versions": self.versions,
        }
        self._go_on({**defined_by, "commit": self.commit})
        then, now = leaves({key: self._about[key] for key in defined_by}), leaves(defined_by)
        if other := [key for key in {**then, **now} if then.get(key) != now.get(key)]:
            said = "; ".join(f"{key} {then.get(key)!r}, not {now.get(key)!r}" for key in other)
            raise ConfigError(
                f"{self._journal} was made with {said}: its tries are not comparable. "
                "Give another --out, or delete it"
            )

    def _go_on(self, about: dict[str, Any]) -> None:
        """Reads the journal, without a last line that a kill has torn, or begins one."""
        text = self._journal.read_text(encoding="utf-8") if self._journal.exists() else ""
        lines = text.rpartition("\n")[0].splitlines() or [json.dumps(about)]
        try:
            self._about, *made = map(json.loads, lines)
            self._lived = {run: Lived(*found) for run, found in made}
            if self._about.keys() != about.keys():
                raise ValueError(f"found {lines[0]:.80}")
        except (AttributeError, TypeError, ValueError) as error:
            raise ConfigError(f"{self._journal} is damaged: {error!r}; delete it to begin anew") from None
        write_whole(self._journal, "\n".join([*lines, ""]))

    def tune(self) -> dict[str, Any]:
        """Makes what is left of the tries and of the check; returns what is published, as JSON has it."""
        if not self._lived:
            self.say(f"{self.name}: at most {self.config.tries} tries {self._size()}")
        while (stopped_by := self._stopped_by()) is None:
            self._try()
        tries = self._study.tries
        default, best = tries[0], self._study.best
        check = self._check(best) if best and best.settings != default.settings else None
        chosen = best if best and check and check["difference"]["high"] < 0 else default
        return {
            **self._about,
            "tries": [asdict(each) for each in tries],
            "stopped_by": stopped_by,
            "cpu_minutes": sum(each.cpu_seconds for each in tries) / 60,
            "default": default.settings,
            "best": best.settings if best else None,
            "check": check,
            "choice": "default" if chosen is default else "tuned",
            "settings": self.agent.settings | chosen.settings,
        }

    def _size(self) -> str:
        length, of = self._scenario.length
        return f"of {self._scenario.worlds} lifetimes of {length:,} {of}"

    def _stopped_by(self) -> str | None:
        """Why no more tries are made, if so."""
        tries, minutes = self._study.tries, self.config.cpu_minutes
        if len(tries) >= self.config.tries:
            return f"{len(tries)} tries"
        made = [each.cpu_seconds for each in tries if each.state != "repeated"]
        if not made or sum(made) + np.mean(made) <= 60 * minutes:
            return None
        if tries[-1].state == "out of time":
            return f"{minutes:g} CPU minutes: they ran out within try {len(tries) - 1}"
        return f"{minutes:g} CPU minutes: another try would exceed them"

    def _try(self) -> None:
        k, left = len(self._study.tries), 60 * self.config.cpu_minutes
        left -= sum(each.cpu_seconds for each in self._study.tries)
        known = self._lived.copy()
        trial, settings = self._study.begin()
        if earlier := self._study.earlier(settings):
            found = Try(settings, "repeated", earlier.objective, earlier.worlds, 0.0, earlier.error)
            for world in range(1, len(earlier.worlds) + 1):
                trial.report(float(np.mean(earlier.worlds[:world])), world)
        else:
            found = self._tried(settings, left, trial)
            if found.state == "failed" and k == 0:
                raise DefaultsFailError(f"with its default settings it fails: {found.error}")
        self._study.end(trial, found)
        if earlier or self._lived != known:
            self.say(f"{self.name}: {self._described(k, found)}")

    def _tried(self, settings: dict[str, Any], left: float, trial: Any) -> Try:
        """Makes lifetimes in one world after the other, unless earlier tries say that it is no use."""
        runs = self._runs(settings)[: self._scenario.worlds]
        worlds: list[float] = []
        used, state, error = 0.0, "complete", None
        for run in runs:
            value, error, seconds = self._life(run, max(left - used, 0.0))
            used += seconds
            if value is None:
                state = "failed" if error else "out of time"
                break
            worlds.append(value)
            trial.report(float(np.mean(worlds)), len(worlds))
            if len(worlds) < len(runs) and trial.should_prune():
                state = "pruned"
                break
        objective = {"complete": float(np.mean(worlds or [np.nan])), "failed": self._worst}.get(state)
        return Try(settings, state, objective, tuple(worlds), used, error)

    def _life(self, run: LifetimeRun, cpu_seconds: float) -> Lived:
        """What a lifetime came to, which is made unless it was made before, or ran out of as much time."""
        made = self._lived.get(run.id)
        if made is None or (made.value is made.error is None and cpu_seconds > made.cpu_seconds):
            self._lived[run.id] = self.make(run, cpu_seconds, self._log)
            with self._journal.open("a", encoding="utf-8") as journal:
                journal.write(json.dumps([run.id, self._lived[run.id]]) + "\n")
        return self._lived[run.id]

    def _runs(self, settings: dict[str, Any]) -> tuple[LifetimeRun, ...]:
        runs = runs_of(self.config.suite(self.agent, settings))
        return tuple(run for run in runs if isinstance(run, LifetimeRun))

    def _described(self, k: int, found: Try) -> str:
        said = f"try {k}: {found.state}"
        if found.objective is not None:
            said += f", {found.objective:.2f} motions per reach"
        if found.error is not None:
            said += f" ({found.error})"
        said += f", {found.cpu_seconds:.0f} s of CPU"
        if k == 0:
            minutes = self.config.tries * found.cpu_seconds / 60
            said += f"; {self.config.tries} such tries: {minutes:.1f} of {self.config.cpu_minutes:g} minutes"
        return said

    def _check(self, best: Try) -> dict[str, Any]:
        """The best settings and the default ones in worlds in which nothing was tried."""
        default = self._study.tries[0].settings
        before, after = self._in_other_worlds(default), self._in_other_worlds(best.settings)
        difference = mean_estimate(np.subtract(after["worlds"], before["worlds"]))
        return {
            "default": before["worlds"],
            "tuned": after["worlds"],
            "difference": asdict(difference),
            "cpu_minutes": (before["cpu_seconds"] + after["cpu_seconds"]) / 60,
        }

    def _in_other_worlds(self, settings: dict[str, Any]) -> dict[str, Any]:
        runs = self._runs(settings)[self._scenario.worlds :]
        if any(run.id not in self._lived for run in runs):
            self.say(f"{self.name}: {settings} in {len(runs)} other worlds")
        lived = [self._life(run, math.inf) for run in runs]
        values = [self._worst if each.value is None else each.value for each in lived]
        return {"worlds": values, "cpu_seconds": sum(each.cpu_seconds for each in lived)}
