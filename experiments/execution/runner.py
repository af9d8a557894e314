"""Carrying out a suite: finished runs skipped, lost ones made again, one crash fails one run."""

import time
from collections import Counter
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from experiments.config.suite import Suite
from experiments.errors import ConfigError
from experiments.execution.pending import (
    Machines,
    begin,
    clear,
    discard,
    is_begun,
    newest_folder,
    place,
    target_of,
    withdraw,
    write_pending,
)
from experiments.execution.progress import AtWork, Display, KeptTimes, Standing, TimeLeft, in_words, made_in
from experiments.running.results_folder import (
    FAILED,
    LOG,
    SUITE,
    TIMINGS,
    commit_of,
    folder_of,
    is_done,
    locked,
    made_folder,
    read_json,
    refuse_foreign,
    write_json,
)
from experiments.running.run import Run, runs_of
from experiments.running.versions import commit, is_of_no_commit, versions

_LOOK_EVERY = 1.0
"""Seconds in which is shown how far the runs are."""
SEEN_WITHIN = 60.0
"""Seconds in which one machine sees what another has moved; NFS may remember as long what a folder held."""


@dataclass
class Runner:
    """Carries out the runs of one suite into one folder.

    Args:
        retries: How many times a run is made again whose worker was lost; one that failed is not.
        fail_fast: Whether the first failed run stops the others.
        at_once: How many runs the machines make at a time, where that is known.
    """

    suite: Suite
    out: Path
    machines: Machines
    display: Display
    retries: int = 0
    fail_fast: bool = False
    at_once: int | None = None

    def __post_init__(self) -> None:
        self._pending: dict[Path, Run] = {}
        self._losses: Counter[Path] = Counter()

    def run(self, command: str) -> list[str]:
        """Makes all runs that are not finished yet; returns those that failed, or that a failed one stopped.

        The report names the command that the user typed.
        """
        runs = runs_of(self.suite)
        with locked(made_folder(self.out)), closing(self.machines):
            here = versions()
            refuse_foreign(self.out, self.suite, here)
            unfinished = [run for run in runs if not is_done(folder_of(self.out, run.id))]
            self._write_suite(command, bool(unfinished))
            clear(self.out)
            kept = KeptTimes()
            unfinished.sort(key=kept.seconds, reverse=True)
            self._left = TimeLeft({run.id: kept.seconds(run) for run in unfinished}, self.at_once)
            self._runs = len(runs)
            said = f"{len(runs)} runs, {len(runs) - len(unfinished)} of them finished already"
            self.display.say(f"{said}; about {in_words(self._left.seconds())}" if unfinished else said)
            try:
                self._pending = {write_pending(self.out, run, here): run for run in unfinished}
                self.machines.start(list(self._pending))
                while self._pending:
                    for pending, exit_code in self.machines.ended(_LOOK_EVERY):
                        self._over(pending, exit_code)
                    self._show()
                clear(self.out)
            finally:
                self._stop()
        return [run.id for run in runs if not is_done(folder_of(self.out, run.id))]

    def _write_suite(self, command: str, changes: bool) -> None:
        """Writes down what is run; what is finished keeps the commit that made it."""
        made_by = commit_of(self.out)
        by = commit() if changes or is_of_no_commit(made_by) else made_by
        about = {"suite": self.suite.model_dump(mode="json"), "command": command, "commit": by}
        write_json(self.out / SUITE, about)

    def _over(self, pending: Path, exit_code: int) -> None:
        """A worker has ended: its run is finished, is to be made again, or has failed."""
        if pending not in self._pending:  # stopped
            return
        if exit_code == 0:
            self._wait_for(target_of(pending))
            discard(pending)
            timings = target_of(pending) / TIMINGS
            self._end(pending, read_json(timings)["wall_seconds"] if timings.exists() else None)
            return
        if exit_code < 0:
            self._losses[pending] += 1
            if self._losses[pending] <= self.retries:
                again = f"made again ({self._losses[pending]} of {self.retries} times)"
                self.display.say(f"{pending.name}: its worker was lost (exit code {exit_code}); {again}")
                self.machines.start([pending])
                return
        self._fail(pending, exit_code)
        if self.fail_fast:
            self._stop()

    def _fail(self, pending: Path, exit_code: int) -> None:
        """Makes the folder of the last worker the run's result, with how it ended."""
        folder = newest_folder(pending) or begin(pending)
        lost = f"its worker was lost {self._losses[pending]} times" if exit_code < 0 else ""
        with (folder / LOG).open("a", encoding="utf-8") as log:
            log.write(f"{lost}\n" if lost else "")
        lines = (folder / LOG).read_text(encoding="utf-8", errors="replace").splitlines()[-20:]
        write_json(folder / FAILED, {"exit_code": exit_code, "log_tail": lines})
        place(folder)
        discard(pending)
        tail = "\n".join(f"    {line}" for line in lines)
        said = f"FAILED, exit code {exit_code}:\n{tail}\n    ({target_of(pending) / LOG})"
        self.display.say(f"{pending.name}: {said}")
        self._end(pending)

    def _stop(self) -> None:
        """Ends all workers, wherever they are."""
        for pending in self._pending:
            withdraw(pending)
        self._pending.clear()

    def _end(self, pending: Path, seconds: float | None = None) -> None:
        """A run is over, and has taken so long, if it has not failed."""
        self._left.ends(self._pending.pop(pending).id, seconds)

    def _show(self) -> None:
        at_work = []
        for pending, run in self._pending.items():
            if is_begun(pending) and (folder := newest_folder(pending)):
                made, (amount, unit) = made_in(folder), run.work
                self._left.has_made(run.id, made / amount)
                at_work.append(AtWork(_in_words(run), made, amount, unit))
        over = self._runs - len(self._pending)
        self.display.show(Standing(over, self._runs, self._left.seconds(), tuple(at_work)))

    def _wait_for(self, folder: Path) -> None:
        """Waits until this machine sees, too, what a worker on another one has moved there."""
        begun = time.monotonic()
        while not is_done(folder):
            if time.monotonic() - begun > SEEN_WITHIN:
                raise ConfigError(
                    f"{folder} was made, but is not seen on this machine: --out must be a folder on a file "
                    "system that all machines share, under the same path"
                )
            list(folder.parent.iterdir())  # makes NFS look anew
            time.sleep(0.1)


def _in_words(run: Run) -> str:
    where = run.where
    world = f", world {where['world']}" if "world" in where else ""
    return f"{where['agent']} in {where['scenario']}{world}"
