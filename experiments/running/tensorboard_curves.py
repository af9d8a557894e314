"""Learning curves as TensorBoard events, written while a run goes on."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from tensorboard.summary import Writer

from experiments.evaluation import TrialRecord


class Curves:
    """The curves of one run, over its lifetime motions; `tensorboard --logdir OUT/runs` shows them.

    Args:
        folder: The run's.
    """

    def __init__(self, folder: Path):
        self._writer = Writer(str(folder))

    def write(self, phase: str, lifetime_motions: int, records: Sequence[TrialRecord]) -> None:
        """Adds the means over some trials, as `train/...` or `eval/...`."""
        for name in ("success", "motions", "robot_seconds", "error_px", "distance_mm"):
            mean = float(np.mean([record[name] for record in records]))
            self._writer.add_scalar(f"{phase}/{name}", mean, lifetime_motions)

    def close(self) -> None:
        """Writes what is still waiting."""
        self._writer.close()
