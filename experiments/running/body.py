"""The processes that make results: started in the same way on every machine."""

import os
import subprocess
import sys
from pathlib import Path
from typing import IO

from experiments.running.versions import REPOSITORY

_ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS"), "1"
)


def start_body(folder: Path) -> subprocess.Popen[str]:
    """Starts the body of the run that `folder` describes; it ends when the process that started it ends.

    Returns:
        The process; what it prints, errors too, is to be read from its `stdout`.
    """
    return start_module("experiments.running.worker", str(folder.resolve()), errors=subprocess.STDOUT)


def start_module(module: str, *arguments: str, errors: int | IO[str]) -> subprocess.Popen[str]:
    """Starts a module in a fresh process with one thread, whose input and output are pipes.

    Args:
        module: By its dotted name; it watches its input, and ends where that ends.
        *arguments: Of the command line.
        errors: Where what it prints as errors goes, as `subprocess` takes it.
    """
    return subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        cwd=REPOSITORY,
        env={**os.environ, **_ONE_THREAD, "PYTHONHASHSEED": "0"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=errors,
        start_new_session=True,  # so that an interrupt reaches its parent alone
        text=True,
        errors="replace",
    )
