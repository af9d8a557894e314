"""How far the runs are, and how long they still take: a bar on a terminal, plain lines elsewhere; a table."""

import os
import re
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Self

import pandas as pd
from pydantic import ValidationError
from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table

from calfree_gym.errors import printable
from calfree_gym.robot.arms.arm import MOVEMASTER_NAME
from experiments.config.life import EvaluationConfig
from experiments.config.suite import AgentConfig, ScenarioConfig, SweepConfig
from experiments.errors import ConfigError
from experiments.execution.pending import newest_folder, pending_of
from experiments.reporting.results_file import RESULTS, TIMED, TIMES, read_about, read_times
from experiments.running.results_folder import (
    FAILED,
    LOG,
    RUN,
    Failure,
    at_work,
    folder_of,
    is_done,
    read_as,
    read_suite,
    suite_written_down,
)
from experiments.running.run import LifetimeRun, Run, SweepRun, runs_of
from experiments.running.versions import KEPT

_DONE = re.compile(r"^(?:motions|trials) (\d+)/", re.MULTILINE)
_TAIL = 10_000
"""Bytes at the end of a log in which a line of progress is looked for."""
_SURE = 20.0
"""Seconds of work, as kept times have it, from which on this machine's own pace counts more. Choice."""


def made_in(folder: Path) -> int:
    """How much of its work a run says it has done, in its log."""
    try:
        with (folder / LOG).open("rb") as log:
            log.seek(max(0, log.seek(0, os.SEEK_END) - _TAIL))
            found = _DONE.findall(log.read().decode(errors="replace"))
    except FileNotFoundError:
        return 0
    return int(found[-1]) if found else 0


@dataclass(frozen=True, slots=True)
class AtWork:
    """A run under way, in words, and how much of its work is done: of an amount of "motions" or "trials"."""

    what: str
    made: int
    amount: int
    unit: str


@dataclass(frozen=True, slots=True)
class Standing:
    """How far a suite is: runs that are over, of all; about how many seconds are left; runs under way."""

    over: int
    runs: int
    left: float
    at_work: tuple[AtWork, ...]

    def __str__(self) -> str:
        left = f", about {in_words(self.left)} left" if self.over < self.runs else ""
        return f"{self.over} of {self.runs}{left}"


class Lines:
    """Plain lines: one where runs have ended."""

    def __init__(self) -> None:
        self._over = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        pass

    def say(self, text: str) -> None:
        """Prints a line."""
        print(text, flush=True)

    def show(self, now: Standing) -> None:
        """Prints how far the suite is, where more runs are over than last time."""
        if now.over > self._over:
            self._over = now.over
            self.say(f"{now}")


class Bar(Live):
    """A bar for the suite, and below it a line for each run under way."""

    def __init__(self, console: Console):
        super().__init__(console=console, refresh_per_second=4, transient=True)

    def say(self, text: str) -> None:
        """Prints a line above the bar."""
        self.console.print(text, markup=False, highlight=False)

    def show(self, now: Standing) -> None:
        """Moves the bar by whole runs and what is made of those under way."""
        made = now.over + sum(each.made / each.amount for each in now.at_work)
        head = Table.grid(padding=(0, 1))
        head.add_row(ProgressBar(total=now.runs, completed=made, width=40), str(now))
        lines = Table.grid(padding=(0, 2))
        for each in now.at_work:
            lines.add_row(f"  {each.what}", f"{each.made:,} of {each.amount:,} {each.unit}")
        self.update(Group(head, lines))


Display = Lines | Bar
"""Shows what the runner does."""


def display() -> Display:
    """A bar where somebody can see it move, lines elsewhere."""
    return Bar(Console()) if sys.stdout.isatty() else Lines()


class TimeLeft:
    """Of runs that are made some at a time, the longest first, by the seconds that each is expected to take.

    How many are made at once shows by and by where it is None.
    """

    def __init__(
        self, expected: dict[str, float], at_once: int | None, now: Callable[[], float] = time.monotonic
    ):
        self._expected, self._at_once, self._now = expected, at_once, now
        self._begun: dict[str, tuple[float, float]] = {}
        self._over: list[tuple[float, float]] = []

    def has_made(self, run: str, share: float) -> None:
        """A run has made this share of its work; it begins with the first call."""
        since, _ = self._begun.get(run, (self._now(), 0.0))
        self._begun[run] = since, share

    def ends(self, run: str, took: float | None) -> None:
        """A run is over, after so many seconds; None where that tells nothing of others."""
        expected = self._expected.pop(run)
        self._begun.pop(run, None)
        if took is not None:
            self._over.append((expected, took))

    def seconds(self) -> float:
        """Until all runs are over."""
        made, left = [*self._over], []
        for run, expected in self._expected.items():
            since, share = self._begun.get(run, (0.0, 0.0))
            left.append((1 - share) * expected)
            if share:
                made.append((share * expected, self._now() - since))
        return _pace(made) * _one_after_the_other(left, self._at_once or max(len(self._begun), 1))


def _pace(made: Iterable[tuple[float, float]]) -> float:
    """How many times as long as expected work takes here, of expected seconds and those that it took."""
    sums = [sum(column) for column in zip((_SURE, _SURE), *made, strict=True)]
    return sums[1] / sums[0]


def _one_after_the_other(seconds: Iterable[float], at_once: int) -> float:
    """When the last of some runs is over, each of which begins as soon as there is a place."""
    places = [0.0] * at_once
    for each in seconds:
        places[places.index(min(places))] += each
    return max(places)


def in_words(seconds: float) -> str:
    """A rounded time, such as "4 min"."""
    if seconds < 55:
        return f"{max(10 * round(seconds / 10), 10)} s"
    return f"{round(seconds / 60)} min" if seconds < 100 * 60 else f"{seconds / 3600:.1f} h"


@dataclass(frozen=True, slots=True)
class Status:
    """The runs of a suite; how many are in which state; what the user typed; whether any has failed."""

    runs: pd.DataFrame
    counts: str
    command: str
    failed: bool


def status(out: Path) -> Status:
    """The state of all runs of the suite that was run in a folder last."""
    suite, command = read_suite(out)
    runner = at_work(out)
    rows = [(run.id, *_state(run, out, runner)) for run in runs_of(suite)]
    states = [state for _, state, _ in rows]
    counts = ", ".join(f"{states.count(state)} {state}" for state in dict.fromkeys(states))
    counts = f"{len(rows)} runs: {counts}; {'a runner is' if runner else 'no runner is'} at work"
    return Status(pd.DataFrame(rows, columns=["run", "state", "detail"]), counts, command, "failed" in states)


def _state(run: Run, out: Path, runner: bool) -> tuple[str, str]:
    amount, of = run.work
    folder = folder_of(out, run.id)
    if is_done(folder):
        return "done", f"{amount:,} {of}"
    if (folder / FAILED).exists():
        failure = read_as(folder / FAILED, Failure)
        *_, last = "it printed nothing", *failure.log_tail
        return "failed", f"exit code {failure.exit_code}: {printable(last)} ({folder / LOG})"
    begun = newest_folder(pending_of(out, run.id)) or folder
    if not (begun / RUN).exists():
        return "waiting", ""
    made = f"{made_in(begun):,} of {amount:,} {of}"
    return ("running", made) if runner else ("interrupted", f"after {made}; begins anew")


_COSTS = ("other", "decision", "learning")
_UNKNOWN = {"motions": (2e-4, 5e-4, 1e-3), "trials": (2e-2, 0.0, 0.0)}
"""Seconds where nothing alike is kept. Choice."""
_REACH = 5
"""Motions of a held-out trial. Choice."""


class Work(NamedTuple):
    """What a run does: so many of its `own` "motions" or "trials", and about so many `held_out` motions.

    The agent is told by its name, not its label; `env` is what its environment's pace depends on.
    """

    agent: str
    env: tuple[Any, ...]
    unit: str
    own: int
    held_out: int

    def seconds(self, costs: Sequence[float]) -> float:
        """What it takes at costs in the order of `_COSTS`: other time, decisions, learning."""
        other, decision, learning = costs
        return self.own * (other + learning) + self.held_out * (other + decision)


class KeptTimes:
    """Seconds by agent and kind of environment, from all kept results."""

    def __init__(self, kept: Path = KEPT):
        measured = (each for path in sorted(kept.glob(f"*/{TIMES}")) for each in _measured(path))
        rows = [[*work[:3], *costs] for work, costs in measured]
        self._known: dict[Work, float] = {}
        self._costs = pd.DataFrame(rows, columns=["agent", "env", "unit", *_COSTS])

    def seconds(self, run: Run) -> float:
        """What a run takes where kept times were made: by its agent in such an environment, or one alike."""
        if isinstance(run, SweepRun):
            work = _work(run.agent, run.sweep, None, len(run.world_seeds))
        else:
            assert isinstance(run, LifetimeRun)
            work = _work(run.agent, run.scenario, run.evaluation, 1)
        if work not in self._known:
            self._known[work] = self._seconds(work)
        return self._known[work]

    def _seconds(self, work: Work) -> float:
        same = {key: self._costs[key] == getattr(work, key) for key in ("agent", "unit")}
        env = self._costs["env"].map(lambda each: each == work.env).astype(bool)
        for alike in (same["agent"] & env, same["agent"], env, same["unit"]):
            found = self._costs[alike & same["unit"]]
            if len(found):
                return work.seconds(found[list(_COSTS)].median().to_list())
        return work.seconds(_UNKNOWN[work.unit])


def _work(
    agent: AgentConfig, part: ScenarioConfig | SweepConfig, evaluation: EvaluationConfig | None, worlds: int
) -> Work:
    """What an agent's run does: a life as the agent lives it, or a sweep over so many worlds."""
    task = part.env.id.removeprefix("CalFree/").partition("-")[0].removesuffix("Dense")
    env = task, part.env.dynamics, part.env.observation, part.env.arm == MOVEMASTER_NAME
    if isinstance(part, SweepConfig):
        return Work(agent.name, env, "trials", len(part.over) * worlds, 0)
    own, unit = part.length
    held_out = 0
    if evaluation:
        once = sum("at" in each for each in part.perturbations)
        stretches = 1 + once if evaluation.begins_anew else 1
        scheduled = len(evaluation.offsets(part.most_motions // stretches)) * stretches
        held_out = (scheduled + 2 * once + 1) * evaluation.trials * _REACH
    return Work(agent.name, env, unit, own, held_out)


def _measured(times: Path) -> Iterator[tuple[Work, tuple[float, float, float]]]:
    """What the runs of a kept suite did, and what that cost: medians over worlds.

    Nothing of a suite that cannot be read now.
    """
    try:
        suite = suite_written_down(read_about(times.with_name(RESULTS)).suite)
    except (ConfigError, KeyError, ValidationError):
        return
    rows = read_times(times).fillna({"decision": 0.0, "learning": 0.0})
    lives, sweeps = (
        rows[[*TIMED[1:]]].groupby(rows["run"].str.replace(f"{world}-[0-9a-f]+$", "", regex=True)).median()
        for world in (r"-\d+", "")
    )
    for part in suite.parts:
        costs = sweeps if isinstance(part, SweepConfig) else lives
        for agent in suite.agents_in(part):
            name = f"{part.name}-{agent.label}"
            if name not in costs.index:
                continue
            wall, decision, learning = costs.loc[name]
            if isinstance(part, SweepConfig):
                work = _work(agent, part, None, suite.worlds_of(agent, part))
            else:
                work = _work(agent, part.lived_by(agent), suite.evaluation_of(part), 1)
            if work.unit == "trials":  # whose motions are not known
                decision = learning = 0.0
            spent = work.seconds((0.0, decision, learning))
            yield work, (max(wall - spent, 0.0) / (work.own + work.held_out), decision, learning)
