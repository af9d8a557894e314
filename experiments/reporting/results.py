"""A suite's folder, read back."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from experiments.config.suite import Suite
from experiments.running import trial_log
from experiments.running.plan import Run, runs_of
from experiments.running.results_folder import (
    DONE,
    VERSIONS,
    folder_of,
    is_done,
    read_json,
    read_suite,
    refuse_foreign,
)

RESULTS = "results.parquet"


@dataclass(frozen=True, slots=True)
class Finished:
    """What a suite has come to so far.

    Attributes:
        out: Its folder.
        suite: What was run.
        command: What the user typed.
        runs: All runs of the suite.
        outcomes: What the finished ones say about themselves, by their ids.
        results: All rows of the finished ones.
    """

    out: Path
    suite: Suite
    command: str
    runs: list[Run]
    outcomes: dict[str, dict[str, Any]]
    results: pd.DataFrame

    @property
    def unfinished(self) -> list[Run]:
        """Runs that failed, or were never finished."""
        return [run for run in self.runs if run.id not in self.outcomes]


def read(out: Path) -> Finished:
    """Reads a folder, and writes `results.parquet` into it.

    Raises:
        ConfigError: No suite was run in the folder, or its runs were made by different versions.
    """
    suite, command = read_suite(out)
    runs = runs_of(suite)
    done = {folder: run for run in runs if is_done(folder := folder_of(out, run.id))}
    for folder in list(done)[:1]:
        refuse_foreign(out, suite, read_json(folder / VERSIONS))
    outcomes = {run.id: read_json(folder / DONE) for folder, run in done.items()}
    trial_log.compact(done, out / RESULTS)
    return Finished(out, suite, command, runs, outcomes, pd.read_parquet(out / RESULTS))
