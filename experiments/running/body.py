"""The process of a run's body: started in the same way on every machine."""

import os
import subprocess
import sys
from pathlib import Path

from experiments.running.versions import REPOSITORY

_ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS"), "1"
)


def start_body(folder: Path) -> subprocess.Popen[str]:
    """Starts the body of the run that `folder` describes; it ends when the process that started it ends.

    Returns:
        The process; what it prints, errors too, is to be read from its `stdout`.
    """
    return subprocess.Popen(
        [sys.executable, "-m", "experiments.running.worker", str(folder.resolve())],
        cwd=REPOSITORY,
        env={**os.environ, **_ONE_THREAD, "PYTHONHASHSEED": "0"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
    )
