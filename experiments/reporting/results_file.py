"""`results.parquet`: the rows of a suite's finished runs and, in its metadata, all else that a report needs.

The report is made from this file alone; only times, which differ in each repetition, stand beside it in a
file of their own.

Errors and distances are rounded up to tenths of a pixel and of a millimetre: what was within a whole number
stays within it, and nothing else comes in. Seconds are rounded to tenths. That is far finer than worlds
differ, and makes the file some ten times smaller.
"""

import base64
import json
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import BaseModel, Field, ValidationError

from calfree_gym.files import whole
from experiments.config.environment import is_told
from experiments.config.suite import FIRST_OWN_TRIALS
from experiments.errors import ConfigError
from experiments.evaluation import THRESHOLDS_PX
from experiments.reporting.finished_suite import FinishedSuite
from experiments.reporting.tables import counted
from experiments.running.cpu_time import CPU
from experiments.running.results_folder import (
    DONE,
    FAILED,
    RUNS,
    TIMINGS,
    TRIALS,
    VERSIONS,
    Failure,
    commit_of,
    damaged,
    folder_of,
    is_done,
    read_as,
    read_json,
    read_suite,
    refuse_foreign,
    suite_written_down,
    what_is_wrong,
    write_whole,
)
from experiments.running.run import LifetimeRun, Run, runs_of
from experiments.running.versions import UNKNOWN

RESULTS, TIMES = "results.parquet", "timings.csv"
TIMED = ("run", "wall_seconds", "decision", "learning")
"""Columns of `timings.csv`: seconds of each finished run, one a row."""
METADATA = "calfree"
"""Under this key stands, packed, all that a report needs beside the rows."""
VERSION = 1
OTHER = "it was made by other code; make its report with that code"

Found = TypeVar("Found")


def opened(read: Callable[[Path], Found], results: Path) -> Found:
    """What `read` reads of a Parquet file."""
    try:
        return read(results)
    except FileNotFoundError:
        raise ConfigError(f"{results}: there is no such file") from None
    except (OSError, pa.ArrowException) as error:
        raise ConfigError(f"{results} is damaged, or no Parquet file: {error}") from None


def packed(about: dict[str, Any]) -> str:
    """Metadata as they are written: Parquet does not compress them."""
    return base64.b64encode(zlib.compress(json.dumps(about).encode(), 9)).decode()


Word = Annotated[str, Field(pattern=r"^[\w.+-][\w.+, -]*$")]


class _Outcome(BaseModel, extra="allow"):
    privileged: list[str]
    prior_knowledge: list[str]
    met: str = ""


class About(BaseModel):
    """What a Parquet file says besides its rows.

    Attributes:
        outcomes: Of finished runs, by their ids.
        failures: The last lines that failed runs printed.
        versions: Of the commit, and of what else made the runs.
    """

    version: int = VERSION
    suite: dict[str, Any]
    command: str
    versions: dict[Word, Word]
    outcomes: dict[str, _Outcome]
    failures: dict[str, list[str]]


def read_about(results: Path) -> About:
    """What a Parquet file says of its suite."""
    metadata: dict[bytes, bytes] = opened(pq.read_metadata, results).metadata or {}
    if METADATA.encode() not in metadata:
        raise ConfigError(f"{results} says nothing of a suite: {OTHER}")
    try:
        about: Any = json.loads(zlib.decompress(base64.b64decode(metadata[METADATA.encode()])))
    except (RecursionError, ValueError, zlib.error) as error:
        raise ConfigError(f"{results} is damaged in what it says of its suite: {error}") from None
    if not isinstance(about, dict):
        raise ConfigError(f"{results} says {type(about).__name__} of its suite: {OTHER}")
    if (version := about.get("version")) != VERSION:
        raise ConfigError(f"{results} has form {version}; known is form {VERSION}: {OTHER}")
    try:
        return About.model_validate(about)
    except ValidationError as error:
        raise ConfigError(
            f"{results} is damaged in what it says of its suite: {what_is_wrong(error)}"
        ) from None


def read_times(path: Path) -> pd.DataFrame:
    """Seconds of finished runs, if they are known."""
    if not path.exists():
        return pd.DataFrame(columns=TIMED)
    try:
        return pd.read_csv(
            path, usecols=TIMED, dtype={name: str if name == "run" else float for name in TIMED}
        )
    except ValueError as error:
        raise ConfigError(
            f"{path} is damaged ({error}): delete it, or make it anew by `report` of the results folder"
        ) from None


SCHEMA = pa.schema(
    [
        ("run", pa.string()),
        ("scenario", pa.string()),
        ("agent", pa.string()),
        ("world", pa.int32()),
        ("phase", pa.string()),  # "train": the agent's own trials; "eval": held-out ones; "sweep"
        ("value", pa.float64()),  # of what a sweep varies; null elsewhere
        ("in_view", pa.bool_()),  # of a sweep's trials; null elsewhere
        ("lifetime_motions", pa.int32()),
        ("motions_since_perturbation", pa.int32()),  # null before the first one
        ("trial", pa.int32()),
        ("motions", pa.int32()),
        ("robot_seconds", pa.float64()),
        ("success", pa.bool_()),  # true error within the tolerance
        ("rendezvous", pa.bool_()),  # as observed
        ("error_px", pa.float64()),
        ("distance_mm", pa.float64()),
        *((f"motions_to_{threshold}", pa.int32()) for threshold in THRESHOLDS_PX),
        ("expected_px", pa.float64()),  # after the first motion, as told before; null where nothing is told
    ]
)
MOST_OWN_TRIALS = 2_000
"""Of a lifetime counted in motions: the first are all kept, and of more than this every k-th. They are
drawn, in means of many trials, and stand in no table but those of claims, which look at the first ones;
held-out trials do."""
_FINENESS = {"error_px": 10, "expected_px": 10, "distance_mm": 10, "robot_seconds": 10}
"""Steps in a unit."""
_COUNTERS = ("lifetime_motions", "motions_since_perturbation", "trial")
"""Columns that grow from row to row by little."""


def gather(out: Path) -> Path:
    """Gathers the finished runs of a folder into `results.parquet`, which is returned, and their times."""
    suite, command = read_suite(out)
    runs = runs_of(suite)
    done = [run for run in runs if is_done(folder_of(out, run.id))]
    for run in done[:1]:
        refuse_foreign(out, suite, read_json(folder_of(out, run.id) / VERSIONS))
    outcomes = {run.id: _outcome(folder_of(out, run.id)) for run in done}
    _refuse_loss(out, outcomes)
    about = {
        "version": VERSION,
        "suite": suite.told(),
        "command": command,
        "versions": _versions(out, runs),
        "outcomes": outcomes,
        "failures": {
            run.id: read_as(report, Failure).log_tail
            for run in runs
            if (report := folder_of(out, run.id) / FAILED).exists()
        },
    }
    asked = bool(suite.claims or suite.required)
    rows = [_rows(folder_of(out, run.id), run, asked) for run in done]
    _write(pa.concat_tables(rows) if rows else SCHEMA.empty_table(), about, out / RESULTS)
    write_whole(out / TIMES, _times(out, done).to_csv(index=False))
    return out / RESULTS


def _refuse_loss(out: Path, outcomes: dict[str, Any]) -> None:
    """Raises ConfigError where a file made before holds runs that are not there any more."""
    try:
        lost = sorted(read_about(out / RESULTS).outcomes.keys() - outcomes.keys())
    except ConfigError:
        return  # there is none, or nothing can be read of it
    if lost:
        raise ConfigError(
            f"{out / RESULTS} holds {counted(len(lost), 'finished run')} that {RUNS} lacks, such as "
            f"{lost[0]}; allowed: `report {RESULTS}`, those folders, or to delete the file"
        )


def read_finished(results: Path, out: Path) -> FinishedSuite:
    """Reads a Parquet file that `gather` wrote, and the times beside it; the report will stand in `out`.

    Anybody may have made it: no model of an arm is read from it, and nothing but words goes into tables.
    """
    about, table = read_about(results), opened(pq.read_table, results)
    if missing := [name for name in SCHEMA.names if name not in table.column_names]:
        raise ConfigError(f"{results} lacks the columns {', '.join(missing)}: {OTHER}")
    try:
        rows = table.select(SCHEMA.names).cast(SCHEMA).to_pandas()
        _check_told(results, about.suite)
        suite = suite_written_down(about.suite)
        runs = runs_of(suite)
        known = {run.id for run in runs}
        if foreign := sorted({*about.outcomes, *about.failures, *rows["run"]} - known):
            raise ConfigError(
                f"{results} holds the run {foreign[0]}, which its own suite does not have: {OTHER}"
            )
        timings = read_times(results.with_name(TIMES))
        return FinishedSuite(
            out=out,
            suite=suite,
            command=about.command,
            runs=runs,
            outcomes={run: outcome.model_dump() for run, outcome in about.outcomes.items()},
            failures=about.failures,
            versions={"commit": UNKNOWN} | about.versions,
            results=rows,
            timings=timings[timings["run"].isin(known)],
        )
    except (AttributeError, KeyError, TypeError, ValidationError, pa.ArrowInvalid) as error:
        raise ConfigError(f"{results} cannot be read: {error}: {OTHER}") from None


def _check_told(results: Path, suite: dict[str, Any]) -> None:
    """Raises ConfigError where arms are not just told."""
    for part in (*suite.get("scenarios", ()), *suite.get("sweeps", ())):
        arm = part["env"].get("arm")
        if isinstance(arm, dict) and not is_told(arm):
            raise ConfigError(f"{results} holds the model of an arm; allowed: what `gather` tells of it")


def _versions(out: Path, runs: list[Run]) -> dict[str, str]:
    """The commit, and what else made the runs; several versions where they differ."""
    found: dict[str, set[str]] = {"commit": {commit_of(out)}}
    for run in runs:
        made_by = folder_of(out, run.id) / VERSIONS
        if made_by.exists():
            for name, version in read_json(made_by).items():
                found.setdefault(name, set()).add(str(version))
    return {name: ", ".join(sorted(versions)) for name, versions in found.items()}


def _outcome(folder: Path) -> dict[str, Any]:
    """What a finished run says about itself, but for what its rows tell: when its world changed."""
    outcome = read_json(folder / DONE, "privileged", "prior_knowledge")
    outcome.pop("perturbations", None)
    return outcome


def _rows(folder: Path, run: Run, first_motions: bool) -> pa.Table:
    """A run's trials, as its log has them; first motions of own trials only where a criterion may ask."""
    path = folder / TRIALS
    of_run = {"run": run.id, **run.where}
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
        rows = [{**json.loads(line), **of_run} for line in lines]
        if isinstance(run, LifetimeRun) and run.scenario.motions is not None:
            rows = _thinned(rows)
        return pa.Table.from_pylist(rows if first_motions else _without_first_motions(rows), schema=SCHEMA)
    except (FileNotFoundError, KeyError, OverflowError, RecursionError, TypeError, ValueError) as error:
        raise damaged(path, error) from None


def _thinned(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    own = sum(row["phase"] == "train" for row in rows)
    every = -(-own // MOST_OWN_TRIALS)
    return [
        row
        for row in rows
        if row["phase"] != "train" or row["trial"] < FIRST_OWN_TRIALS or row["trial"] % every == 0
    ]


def _without_first_motions(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Without what only claims ask of the agents' own trials, `motions_to_...`: the runs' logs have it."""
    unknown = {name: None for name in SCHEMA.names if name.startswith("motions_to_")}
    return [row | unknown if row["phase"] == "train" else row for row in rows]


def _times(out: Path, done: list[Run]) -> pd.DataFrame:
    """Seconds of each finished run, one a row."""
    rows = []
    for run in done:
        if (path := folder_of(out, run.id) / TIMINGS).exists():
            found = read_json(path, "wall_seconds", CPU)
            try:
                seconds = {"wall_seconds": found["wall_seconds"], **found[CPU]}
                rows.append({"run": run.id} | {name: float(each) for name, each in seconds.items()})
            except (TypeError, ValueError) as error:
                raise damaged(path, error) from None
    return pd.DataFrame(rows, columns=TIMED)


def _write(rows: pa.Table, about: dict[str, Any], target: Path) -> None:
    """Replaced as a whole. Metadata are not compressed by Parquet, and are by us."""
    columns = [_compact(name, rows[name]) for name in SCHEMA.names]
    table = pa.table(columns, names=SCHEMA.names)
    with (
        whole(target) as file,
        pq.ParquetWriter(
            file,
            table.schema,
            compression="brotli",
            compression_level=11,
            use_dictionary=[name for name in SCHEMA.names if name not in _COUNTERS],
            column_encoding=dict.fromkeys(_COUNTERS, "DELTA_BINARY_PACKED"),
            store_schema=False,
            write_statistics=False,
            data_page_size=2**30,
            max_rows_per_page=2**30,  # pages are packed one by one
        ) as writer,
    ):
        writer.write_table(table)
        writer.add_key_value_metadata({METADATA: packed(about)})


def _compact(name: str, column: pa.ChunkedArray) -> pa.ChunkedArray | pa.Array:
    if steps := _FINENESS.get(name):
        rounded = np.ceil if name.endswith(("_px", "_mm")) else np.round
        return pa.array(rounded(column.to_numpy() * steps) / steps, from_pandas=True)
    return column
