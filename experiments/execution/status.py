"""How far the runs in a results folder are."""

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from experiments.execution.orders import newest_attempt, order_of
from experiments.execution.part import WHOLE, Part
from experiments.execution.progress.display import made_in
from experiments.running.plan import Run, runs_of
from experiments.running.results_folder import (
    FAILED,
    LOG,
    SPEC,
    SUITE,
    at_work,
    folder_of,
    is_done,
    read_json,
    read_suite,
)


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
    """The state of all runs of the suite, or of the part of it, that was run in a folder last.

    Raises:
        ConfigError: No suite was run there.
    """
    suite, command = read_suite(out)
    part = Part.parse(read_json(out / SUITE).get("part", str(WHOLE)))
    runner = at_work(out)
    rows = [(spec.id, *_state(spec, out, runner)) for spec in part.of_runs(runs_of(suite))]
    states = [state for _, state, _ in rows]
    counts = ", ".join(f"{states.count(state)} {state}" for state in dict.fromkeys(states))
    counts = f"{len(rows)} runs: {counts}; {'a runner is' if runner else 'no runner is'} at work"
    return Status(pd.DataFrame(rows, columns=["run", "state", "detail"]), counts, command, "failed" in states)


def _state(spec: Run, out: Path, runner: bool) -> tuple[str, str]:
    whole, of = spec.work
    folder = folder_of(out, spec.id)
    if is_done(folder):
        return "done", f"{whole:,} {of}"
    if (folder / FAILED).exists():
        failure = read_json(folder / FAILED)
        last = failure["log_tail"][-1] if failure["log_tail"] else "it printed nothing"
        return "failed", f"exit code {failure['exit_code']}: {last} ({folder / LOG})"
    attempt = newest_attempt(order_of(out, spec.id)) or folder
    if not (attempt / SPEC).exists():
        return "waiting", ""
    made = f"{made_in(attempt):,} of {whole:,} {of}"
    return ("running", made) if runner else ("interrupted", f"after {made}; begins anew")
