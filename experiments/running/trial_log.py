"""One row a trial, written line by line as JSON; a suite's rows are gathered into one Parquet file."""

import json
import os
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import pyarrow as pa

from experiments.evaluation import THRESHOLDS_PX, TrialRecord

TRIALS = "trials.jsonl"

SCHEMA = pa.schema(
    [
        ("run", pa.string()),
        ("scenario", pa.string()),
        ("agent", pa.string()),
        ("world", pa.int64()),
        ("phase", pa.string()),  # "train": the agent's own trials; "eval": held-out ones; "sweep"
        ("value", pa.float64()),  # of what a sweep varies; null elsewhere
        ("in_view", pa.bool_()),  # of a sweep's trials; null elsewhere
        ("lifetime_motions", pa.int64()),
        ("motions_since_perturbation", pa.int64()),  # null before the first one
        ("trial", pa.int64()),
        ("motions", pa.int64()),
        ("robot_seconds", pa.float64()),
        ("success", pa.bool_()),  # true error within the tolerance
        ("rendezvous", pa.bool_()),  # as observed
        ("error_px", pa.float64()),
        ("distance_mm", pa.float64()),
        *((f"motions_to_{threshold}", pa.int64()) for threshold in THRESHOLDS_PX),
        ("expected_px", pa.float64()),  # after the first motion, as told before; null where nothing is told
    ]
)


class TrialLog:
    """The append-only curve of one run."""

    def __init__(self, folder: Path):
        self._file = (folder / TRIALS).open("w", encoding="utf-8")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()

    def write(
        self,
        phase: str,
        lifetime_motions: int,
        since_perturbation: int | None,
        record: TrialRecord,
        **columns: Any,
    ) -> None:
        """Appends one trial; `columns` are those that only some runs have."""
        row = {
            "phase": phase,
            "lifetime_motions": lifetime_motions,
            "motions_since_perturbation": since_perturbation,
            "trial": record.trial,
            "motions": record.motions,
            "robot_seconds": record.robot_seconds,
            "success": record.success,
            "rendezvous": record.rendezvous,
            "error_px": record.error_px,
            "distance_mm": record.distance_mm,
            **{f"motions_to_{px}": motion for px, motion in record.motions_to.items()},
            "expected_px": record.expected_px,
            **columns,
        }
        self._file.write(json.dumps(row) + "\n")
        self._file.flush()
