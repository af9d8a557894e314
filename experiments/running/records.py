"""What a run writes while it goes on: a row a trial as JSON, and TensorBoard's curves."""

import json
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tensorboard.compat.proto.event_pb2 import Event
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.summary.writer.event_file_writer import EventFileWriter

from experiments.evaluation import TrialRecord
from experiments.running.results_folder import TRIALS


class TrialLog:
    """The append-only curve of one run."""

    def __init__(self, folder: Path):
        self._file = (folder / TRIALS).open("w", encoding="utf-8")

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
            **{name: record[name] for name in record.__slots__ if name != "motions_to"},
            **{f"motions_to_{px}": motion for px, motion in record.motions_to.items()},
            **columns,
        }
        self._file.write(json.dumps(row) + "\n")
        self._file.flush()

    def close(self) -> None:
        """Waits until all is on the disk."""
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()


class Curves:
    """The curves of one run, over its lifetime motions; `tensorboard --logdir OUT/runs` shows them."""

    TOGETHER = 10
    """So many trials of the agent's own are one point: an event takes longer than an object to draw."""

    def __init__(self, folder: Path):
        self._writer = EventFileWriter(str(folder))
        self._waiting: list[TrialRecord] = []
        self._motions = 0

    def add_own(self, lifetime_motions: int, record: TrialRecord) -> None:
        """Adds a trial of the agent's own, which ended after so many motions."""
        self._waiting.append(record)
        self._motions = lifetime_motions
        if len(self._waiting) == self.TOGETHER:
            self._write_own()

    def _write_own(self) -> None:
        if self._waiting:
            self.write("train", self._motions, self._waiting)
            self._waiting = []

    def write(self, phase: str, lifetime_motions: int, records: Sequence[TrialRecord]) -> None:
        """Adds the means over some trials, as `train/...` or `eval/...`."""
        means = [
            Summary.Value(
                tag=f"{phase}/{name}", simple_value=float(np.mean([record[name] for record in records]))
            )
            for name in ("success", "motions", "robot_seconds", "error_px", "distance_mm")
        ]
        self._writer.add_event(
            Event(wall_time=time.time(), step=lifetime_motions, summary=Summary(value=means))
        )

    def close(self) -> None:
        """Writes what is still waiting."""
        self._write_own()
        self._writer.close()
