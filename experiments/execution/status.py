"""How far the runs in a results folder are."""

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from experiments.execution.pending import newest_folder, pending_of
from experiments.execution.progress import made_in
from experiments.running.results_folder import (
    FAILED,
    LOG,
    RUN,
    at_work,
    folder_of,
    is_done,
    read_json,
    read_suite,
)
from experiments.running.run import Run, runs_of


@dataclass(frozen=True, slots=True)
class Status:
    """The runs of a suite.

    Attributes:
        runs: One row a run: its id, its state, and details.
        counts: How many runs are in which state, and whether a runner is at work.
        command: What the user typed.
        failed: Whether any run has failed.
    """

    runs: pd.DataFrame
    counts: str
    command: str
    failed: bool


def status(out: Path) -> Status:
    """The state of all runs of the suite that was run in a folder last.

    Raises:
        ConfigError: No suite was run there.
    """
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
        failure = read_json(folder / FAILED)
        last = failure["log_tail"][-1] if failure["log_tail"] else "it printed nothing"
        return "failed", f"exit code {failure['exit_code']}: {last} ({folder / LOG})"
    begun = newest_folder(pending_of(out, run.id)) or folder
    if not (begun / RUN).exists():
        return "waiting", ""
    made = f"{made_in(begun):,} of {amount:,} {of}"
    return ("running", made) if runner else ("interrupted", f"after {made}; begins anew")
