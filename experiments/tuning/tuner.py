"""Tuning one agent: tries within its budget, then the best beside the default settings in other worlds."""

import subprocess
import threading
from collections.abc import Callable, Generator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments.errors import ConfigError
from experiments.running.process import pipes_of, start_module
from experiments.running.run import LifetimeRun, runs_of
from experiments.statistics import mean_estimate
from experiments.tuning.config import TunedAgentConfig, TuningConfig
from experiments.tuning.study import Study, Try
from experiments.tuning.worker import OVER_BUDGET, Report, Request


class OverBudgetError(Exception):
    """CPU time ran out."""


class LostError(Exception):
    """A process was stopped, or died: nothing follows about its settings."""


class Processes:
    """Starts worker processes, several at a time from several threads, and ends them all where asked."""

    def __init__(self) -> None:
        self._running: set[subprocess.Popen[str]] = set()
        self._lock = threading.Lock()
        self._stopped = False

    def reports(
        self, runs: tuple[LifetimeRun, ...], cpu_seconds: float | None, log: Path
    ) -> Generator[Report, None, None]:
        """Makes lifetimes in a fresh process with one thread; closed early, it ends the process.

        Args:
            runs: The lifetimes.
            cpu_seconds: The CPU time that they may take; None: any.
            log: What they print is appended to this file.

        Yields:
            A report after each lifetime.

        Raises:
            OverBudgetError: They took longer.
            LostError: The process was stopped, or died.
        """
        process = self._start(log)
        told, tells = pipes_of(process)
        try:
            request = Request(runs=runs, cpu_seconds=cpu_seconds)
            told.write(request.model_dump_json() + "\n")
            told.flush()
            for line in tells:
                yield Report.model_validate_json(line)
            code = process.wait()
            if code == OVER_BUDGET:
                raise OverBudgetError
            if code:
                raise LostError(f"its process ended with exit code {code}; see {log}")
        finally:
            process.kill()
            process.wait()
            with self._lock:
                self._running.discard(process)

    def stop(self) -> None:
        """Ends all processes, and starts no more."""
        with self._lock:
            self._stopped = True
            for process in self._running:
                process.kill()

    def _start(self, log: Path) -> subprocess.Popen[str]:
        with self._lock, log.open("a", encoding="utf-8") as file:
            if self._stopped:
                raise LostError("stopped")
            process = start_module("experiments.tuning.worker", errors=file)
            self._running.add(process)
        return process


class DefaultsFailError(Exception):
    """An agent raises an error with its default settings, which are what others are compared with."""


@dataclass
class Tuner:
    """Tunes one agent.

    Attributes:
        name: The agent's.

    Args:
        config: Worlds and budgets.
        agent: The agent.
        folder: Keeps the journal and what processes print.
        processes: Make the lifetimes.
        versions: Of the code and the packages; a study of other ones is refused.
        commit: Is published.
        say: Shows a line.

    Raises:
        ConfigError: The folder has a study of this agent by other code or of another configuration.
    """

    config: TuningConfig
    agent: TunedAgentConfig
    folder: Path
    processes: Processes
    versions: dict[str, str]
    commit: str
    say: Callable[[str], None]

    def __post_init__(self) -> None:
        config, agent = self.config, self.agent
        self.name = agent.name
        self._scenario = config.scenario_of(agent)
        self._worst = float(self._scenario.env.max_episode_steps)
        self._log = self.folder / f"{agent.name}.txt"
        journal = self.folder / f"{agent.name}.journal"
        defined_by = {
            "agent": agent.model_dump(mode="json"),
            "scenario": self._scenario.model_dump(mode="json"),
            "seed": config.seed,
            "versions": self.versions,
        }
        self._study = Study(journal, agent, {**defined_by, "commit": self.commit}, config.seed)
        for key, now in defined_by.items():
            if (then := self._study.about[key]) != now:
                raise ConfigError(
                    f"{journal} was made with {_difference(key, then, now)}: its tries are not comparable. "
                    "Give another --out, or delete it"
                )

    def tune(self) -> dict[str, Any]:
        """Makes what is left of the tries and of the check.

        Returns:
            What is published, as JSON has it.

        Raises:
            DefaultsFailError: There is nothing to compare with.
            LostError: A process was stopped, or died; what has finished is kept.
        """
        if not self._study.tries:
            self.say(f"{self.name}: at most {self.config.tries} tries {self._size()}")
        while (stopped_by := self._stopped_by()) is None:
            self._try()
        tries = self._study.tries
        default, best = tries[0], self._study.best
        check = self._check(best) if best and best.settings != default.settings else None
        chosen = best if best and check and check["difference"]["high"] < 0 else default
        return {
            **self._study.about,
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
        trial, settings = self._study.begin()
        if earlier := self._study.earlier(settings):
            found = Try(settings, "repeated", earlier.objective, earlier.worlds, 0.0, earlier.error)
            for world, mean in enumerate(_means(earlier.worlds), start=1):
                trial.report(mean, world)
        else:
            found = self._lived(settings, left, trial)
            if found.state == "failed" and k == 0:
                raise DefaultsFailError(f"with its default settings it fails: {found.error}")
        self._study.end(trial, found)
        self.say(f"{self.name}: {self._described(k, found)}")

    def _lived(self, settings: dict[str, Any], cpu_seconds: float, trial: Any) -> Try:
        """Makes lifetimes in one world after the other, unless earlier tries say that it is no use."""
        runs = self._runs(settings)[: self._scenario.worlds]
        worlds: list[float] = []
        used, state, error = 0.0, "complete", None
        reports = self.processes.reports(runs, cpu_seconds, self._log)
        try:
            for report in reports:
                used = report.cpu_seconds
                if report.value is None:
                    state, error = "failed", report.error
                    break
                worlds.append(report.value)
                trial.report(float(np.mean(worlds)), len(worlds))
                if len(worlds) < len(runs) and trial.should_prune():
                    state = "pruned"
                    break
        except OverBudgetError:
            used, state = cpu_seconds, "out of time"
        finally:
            reports.close()
        objective = {"complete": float(np.mean(worlds or [np.nan])), "failed": self._worst}.get(state)
        return Try(settings, state, objective, tuple(worlds), used, error)

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
        if (found := self._study.checked(settings)) is None:
            runs = self._runs(settings)[self._scenario.worlds :]
            self.say(f"{self.name}: {settings} in {len(runs)} other worlds")
            reports = list(self.processes.reports(runs, None, self._log))
            values = [self._worst if report.value is None else report.value for report in reports]
            found = {"worlds": values, "cpu_seconds": reports[-1].cpu_seconds}
            self._study.keep_checked(settings, found)
        return found


def _means(worlds: tuple[float, ...]) -> list[float]:
    """The mean over the first worlds, for each number of them."""
    return [float(each) for each in np.cumsum(worlds) / np.arange(1, len(worlds) + 1)]


def _difference(key: str, then: Any, now: Any) -> str:
    """The innermost keys that differ."""
    if isinstance(then, dict) and isinstance(now, dict):
        keys = [name for name in {**then, **now} if then.get(name) != now.get(name)]
        return "; ".join(_difference(f"{key}.{name}", then.get(name), now.get(name)) for name in keys)
    return f"{key} {then!r}, not {now!r}"
