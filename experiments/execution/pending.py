"""Runs that are to be made, each a folder, in which machines make it, and from which one move makes a result.

A pending run is a folder `OUT/runs/.attempts/ID` with `run.json` and `versions.json`. Each worker that makes
it has a folder of its own in there. A finished one becomes `OUT/runs/ID` by one atomic rename, so that two
workers at one run, such as one on a machine that was thought dead, never write into the same files.
"""

import os
import shutil
import socket
import threading
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from pathlib import Path
from typing import Protocol
from uuid import uuid4

from experiments.errors import ConfigError
from experiments.running.process import end_idle_workers, lent_worker
from experiments.running.results_folder import (
    LOG,
    PENDING,
    RUN,
    RUNS,
    VERSIONS,
    folder_of,
    is_done,
    read_json,
    write_json,
    write_whole,
)
from experiments.running.run import Run
from experiments.running.versions import versions

LOST = -1
"""The exit code of a worker of which nothing more is known than that it is gone."""
_FAILED = 1
_NOT_BEGUN = 0
"""When a pending run was changed last that no worker has begun, in ns: no clock says so."""
_LOOK_EVERY = 1.0
"""Seconds in which a worker learns that it is not wanted any more."""


def pending_of(out: Path, run: str) -> Path:
    """The folder of a pending run, and of the workers that make it."""
    return out / PENDING / run


def target_of(pending: Path) -> Path:
    """Where a pending run will stand."""
    return pending.parents[1] / pending.name


def write_pending(out: Path, run: Run, made_by: dict[str, str]) -> Path:
    """Makes a run pending, to be made by these versions and no others."""
    discard(folder_of(out, run.id))  # failed, or half-written
    pending = pending_of(out, run.id)
    pending.mkdir(parents=True)
    write_json(pending / VERSIONS, made_by)
    write_whole(pending / RUN, run.model_dump_json(indent=2))
    os.utime(pending, ns=(_NOT_BEGUN, _NOT_BEGUN))
    return pending


def is_begun(pending: Path) -> bool:
    """Whether any worker has begun: the folder was changed since the run is pending."""
    try:
        return pending.stat().st_mtime_ns != _NOT_BEGUN
    except FileNotFoundError:
        return False


def withdraw(pending: Path) -> None:
    """Ends all workers at a run, wherever they are; their folders stay."""
    (pending / RUN).unlink(missing_ok=True)


def begin(pending: Path) -> Path:
    """Makes the folder of another worker.

    Raises:
        FileNotFoundError: The run was withdrawn, or is not seen on this machine.
    """
    contents = {name: (pending / name).read_text(encoding="utf-8") for name in (VERSIONS, RUN)}
    folder = pending / uuid4().hex
    folder.mkdir()
    for name, text in contents.items():
        write_whole(folder / name, text)
    return folder


def newest_folder(pending: Path) -> Path | None:
    """The folder of the worker that began last; any may be moved to its place meanwhile."""
    begun: dict[Path, int] = {}
    try:
        for folder in pending.iterdir():
            with suppress(FileNotFoundError, NotADirectoryError):
                begun[folder] = (folder / RUN).stat().st_mtime_ns
    except FileNotFoundError:
        return None
    return max(begun, key=begun.__getitem__, default=None)


def place(folder: Path) -> None:
    """Makes a worker's folder the run's result, as a whole or not at all; the second of two is thrown away.

    Raises:
        FileNotFoundError: Somebody has cleared the folder away.
    """
    target = target_of(folder.parent)
    if is_done(folder) and not is_done(target):
        discard(target)
    try:
        folder.rename(target)
    except OSError:
        if not is_done(target):
            raise
        discard(folder)


def discard(folder: Path) -> None:
    """Deletes a folder; whoever may still work in it finds it gone at once, not half there."""
    root = next(parent for parent in folder.parents if parent.name == RUNS).parent / PENDING
    root.mkdir(parents=True, exist_ok=True)
    rubbish = root / f".{uuid4().hex}"
    try:
        folder.rename(rubbish)
    except FileNotFoundError:
        return
    shutil.rmtree(rubbish, ignore_errors=True)


def clear(out: Path) -> None:
    """Deletes all that is pending, also what a killed runner left behind."""
    root = out / PENDING
    for folder in list(root.glob("*")):
        discard(folder)
    shutil.rmtree(root, ignore_errors=True)


def make(pending: str) -> int:
    """Lets a worker of this machine make a pending run; returns an exit code, see `Machines.ended`."""
    if is_done(target_of(Path(pending))):
        return 0
    if not Path(pending).is_dir():
        raise ConfigError(
            f"{socket.gethostname()} does not see {pending}: --out must be a folder on a file system that "
            "all machines share, under the same path"
        )
    exit_code = LOST
    try:
        folder = begin(Path(pending))
        here = versions()
        if other := _other_versions(folder, here):
            log = f"{socket.gethostname()} has other versions: {other}\n"
            (folder / LOG).write_text(log, encoding="utf-8")
            return _FAILED
        exit_code = _follow(folder, here)
        if exit_code == 0 and is_done(folder):
            place(folder)
    except FileNotFoundError:
        if (Path(pending) / RUN).exists():  # else it was withdrawn
            raise
    return 0 if is_done(target_of(Path(pending))) else exit_code or LOST


def _other_versions(folder: Path, here: dict[str, str]) -> str:
    wanted = read_json(folder / VERSIONS)
    other = [key for key in here if here[key] != wanted.get(key)]
    return "; ".join(f"{key} {here[key]}, ordered {wanted.get(key)}" for key in other)


def _follow(folder: Path, here: dict[str, str]) -> int:
    """Lets a worker do its work, writes down what it prints, and ends it when it is not wanted any more."""
    over = threading.Event()
    with lent_worker(here) as worker, (folder / LOG).open("w", encoding="utf-8") as log:

        def end_unwanted() -> None:
            while not over.wait(_LOOK_EVERY):
                if not _is_wanted(folder):
                    worker.kill()

        watch = threading.Thread(target=end_unwanted, daemon=True)
        watch.start()
        try:
            return worker.make(folder, log)
        finally:
            over.set()
            watch.join()


def _is_wanted(folder: Path) -> bool:
    """Whether a worker should go on: its run is still pending, and no other worker was faster."""
    return (folder.parent / RUN).exists() and folder.exists() and not is_done(target_of(folder.parent))


class Machines(Protocol):
    """Let workers make pending runs, some at a time: each one is a call of `make`.

    Only paths of pending runs go there and only exit codes come back; everything else stands in files, so
    that all machines must see the results folder under the same path.
    """

    def start(self, pending: Sequence[Path]) -> None:
        """Lets a worker begin with each run as soon as there is room for it."""

    def ended(self, seconds: float) -> list[tuple[Path, int]]:
        """Waits for a worker to end, at most so long.

        Returns:
            The pending run of each worker that has ended since, and its exit code: 0 where the run is in its
            place, above 0 where it failed, below 0 where the worker was lost: killed by that signal, or gone
            with its machine (`LOST`).
        """

    def close(self) -> None:
        """Leaves the machines, where all runs have been withdrawn or are done; may be called twice."""


class ThisMachine:
    """See `Machines`; so many runs are made at a time."""

    def __init__(self, jobs: int):
        self._pool = ThreadPoolExecutor(jobs)
        self._working: dict[Future[int], Path] = {}

    def start(self, pending: Sequence[Path]) -> None:
        """See `Machines`."""
        self._working |= {self._pool.submit(make, str(each)): each for each in pending}

    def ended(self, seconds: float) -> list[tuple[Path, int]]:
        """See `Machines`."""
        over, _ = wait(self._working, seconds, FIRST_COMPLETED)
        return [(self._working.pop(future), future.result()) for future in over]

    def close(self) -> None:
        """See `Machines`: waits until the last worker has ended."""
        self._pool.shutdown(cancel_futures=True)
        end_idle_workers()
