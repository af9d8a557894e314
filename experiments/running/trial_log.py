"""One row a trial, written line by line as JSON."""

import json
import os
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from experiments.evaluation import TrialRecord

TRIALS = "trials.jsonl"


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
