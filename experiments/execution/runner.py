"""Carrying out a suite: finished runs skipped, lost ones made again, one crash fails one run."""

import time
from contextlib import closing
from pathlib import Path

from experiments.config.suite import Suite
from experiments.errors import ConfigError
from experiments.execution.executor import Executor
from experiments.execution.orders import (
    begin,
    clear,
    discard,
    is_begun,
    newest_attempt,
    place,
    target_of,
    withdraw,
    write_order,
)
from experiments.execution.part import WHOLE, Part
from experiments.execution.progress.display import AtWork, Display, Standing, made_in
from experiments.execution.progress.expected import KeptTimes
from experiments.execution.progress.time_left import TimeLeft, in_words
from experiments.running.plan import Run, runs_of
from experiments.running.results_folder import (
    FAILED,
    LOG,
    SUITE,
    TIMINGS,
    folder_of,
    is_done,
    locked,
    made_folder,
    read_json,
    refuse_foreign,
    write_json,
)
from experiments.running.versions import commit, commit_of, is_of_no_commit, versions

_LOOK_EVERY = 1.0
"""Seconds in which is shown how far the runs are."""
SEEN_WITHIN = 60.0
"""Seconds in which one machine sees what another has moved; NFS may remember as long what a folder held."""


class Runner:
    """Carries out the runs of one suite into one folder.

    Args:
        suite: What to run.
        out: The folder.
        executor: Where the runs are made.
        display: Shows what happens.
        retries: How many times a run is made again whose worker was lost; one that failed is not.
        fail_fast: Whether the first failed run stops the others.
        part: Which of the suite's runs to make.
        at_once: How many runs the executor makes at a time, where that is known.
    """

    def __init__(
        self,
        suite: Suite,
        out: Path,
        executor: Executor,
        display: Display,
        *,
        retries: int = 0,
        fail_fast: bool = False,
        part: Part = WHOLE,
        at_once: int | None = None,
    ):
        self._suite = suite
        self._out = out
        self._executor = executor
        self._display = display
        self._retries = retries
        self._fail_fast = fail_fast
        self._part = part
        self._orders: dict[Path, Run] = {}
        self._losses: dict[Path, int] = {}
        self._at_once = at_once
        self._begun: set[Path] = set()

    def run(self, command: str) -> list[str]:
        """Makes all runs that are not finished yet.

        Args:
            command: What the user typed, for the report.

        Returns:
            The ids of the runs that failed, or that a failed one stopped.

        Raises:
            ConfigError: The folder cannot be made, another runner is at work in it, results of other code or
                of another configuration are there, or the machines went away; what has finished stays.
            OSError: The folder cannot be written; what has finished stays.
        """
        runs = self._part.of_runs(runs_of(self._suite))
        with locked(made_folder(self._out)), closing(self._executor):
            here = versions()
            refuse_foreign(self._out, self._suite, here)
            pending = [spec for spec in runs if not is_done(folder_of(self._out, spec.id))]
            about = {"suite": self._suite.model_dump(mode="json"), "command": command}
            made_by = commit_of(self._out)
            about["commit"] = commit() if pending or is_of_no_commit(made_by) else made_by
            write_json(self._out / SUITE, about | {"part": str(self._part)})
            clear(self._out)
            kept = KeptTimes()
            pending.sort(key=kept.seconds, reverse=True)
            self._left = TimeLeft({spec.id: kept.seconds(spec) for spec in pending}, self._at_once)
            self._runs = len(runs)
            said = f"{len(runs)} runs, {len(runs) - len(pending)} of them finished already"
            self._display.say(f"{said}; about {in_words(self._left.seconds())}" if pending else said)
            try:
                self._orders = {write_order(self._out, spec, here): spec for spec in pending}
                self._executor.start(list(self._orders))
                while self._orders:
                    for order, exit_code in self._executor.ended(_LOOK_EVERY):
                        self._over(order, exit_code)
                    self._show()
                clear(self._out)
            finally:
                self._stop()
        return [spec.id for spec in runs if not is_done(folder_of(self._out, spec.id))]

    def _over(self, order: Path, exit_code: int) -> None:
        """An attempt has ended: its run is finished, is to be made again, or has failed."""
        if order not in self._orders:  # stopped
            return
        if exit_code == 0:
            self._wait_for(target_of(order))
            discard(order)
            self._end(order, _seconds(target_of(order)))
            return
        if exit_code < 0:
            self._losses[order] = self._losses.get(order, 0) + 1
            if self._losses[order] <= self._retries:
                again = f"made again ({self._losses[order]} of {self._retries} times)"
                self._display.say(f"{order.name}: its worker was lost (exit code {exit_code}); {again}")
                self._executor.start([order])
                return
        self._fail(order, exit_code)
        if self._fail_fast:
            self._stop()

    def _fail(self, order: Path, exit_code: int) -> None:
        """Makes the last attempt the run's result, with how it ended."""
        attempt = newest_attempt(order) or begin(order)
        lost = f"its worker was lost {self._losses[order]} times" if exit_code < 0 else ""
        with (attempt / LOG).open("a", encoding="utf-8") as log:
            log.write(f"{lost}\n" if lost else "")
        lines = (attempt / LOG).read_text(encoding="utf-8", errors="replace").splitlines()[-20:]
        write_json(attempt / FAILED, {"exit_code": exit_code, "log_tail": lines})
        place(attempt)
        discard(order)
        tail = "\n".join(f"    {line}" for line in lines)
        said = f"FAILED, exit code {exit_code}:\n{tail}\n    ({target_of(order) / LOG})"
        self._display.say(f"{order.name}: {said}")
        self._end(order)

    def _stop(self) -> None:
        """Ends all attempts, wherever they are made."""
        for order in self._orders:
            withdraw(order)
        self._orders.clear()

    def _end(self, order: Path, seconds: float | None = None) -> None:
        """A run is over, and has taken so long, if it has not failed."""
        self._left.ends(self._orders.pop(order).id, seconds)
        self._begun.discard(order)

    def _show(self) -> None:
        at_work = []
        for order, spec in self._orders.items():
            if is_begun(order) and (attempt := newest_attempt(order)):
                if order not in self._begun:
                    self._begun.add(order)
                    self._left.begins(spec.id)
                made, (amount, unit) = made_in(attempt), spec.work
                self._left.has_made(spec.id, made / amount)
                at_work.append(AtWork(_in_words(spec), made, amount, unit))
        over = self._runs - len(self._orders)
        self._display.show(Standing(over, self._runs, self._left.seconds(), tuple(at_work)))

    def _wait_for(self, folder: Path) -> None:
        """Waits until this machine sees, too, what an attempt on another one has moved there."""
        begun = time.monotonic()
        while not is_done(folder):
            if time.monotonic() - begun > SEEN_WITHIN:
                raise ConfigError(
                    f"{folder} was made, but is not seen on this machine: --out must be a folder on a file "
                    "system that all machines share, under the same path"
                )
            list(folder.parent.iterdir())  # makes NFS look anew
            time.sleep(0.1)


def _seconds(folder: Path) -> float | None:
    """What a finished run says that it took."""
    return read_json(folder / TIMINGS)["wall_seconds"] if (folder / TIMINGS).exists() else None


def _in_words(spec: Run) -> str:
    where = spec.where
    world = f", world {where['world']}" if "world" in where else ""
    return f"{where['agent']} in {where['scenario']}{world}"
