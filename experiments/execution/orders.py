"""Folders of runs under way: an order, attempts at it, and the one move that makes a result of an attempt.

An order is a folder `OUT/runs/.attempts/ID` with `run.json` and `versions.json`. Each attempt works in a
folder of its own in there. A finished one becomes `OUT/runs/ID` by one atomic rename, so that two attempts at
one run, such as one on a machine that was thought dead, never write into the same files.
"""

import os
import shutil
from contextlib import suppress
from pathlib import Path
from uuid import uuid4

from experiments.running.plan import Run
from experiments.running.results_folder import (
    RUNS,
    SPEC,
    VERSIONS,
    folder_of,
    is_done,
    write_json,
    write_whole,
)

_ATTEMPTS = ".attempts"
_NOT_BEGUN = 0
"""When an order was changed last that no attempt has touched, in ns: no clock says so."""


def order_of(out: Path, run: str) -> Path:
    """The folder of a run's order, and of the attempts at it."""
    return out / RUNS / _ATTEMPTS / run


def target_of(order: Path) -> Path:
    """Where the run of an order will stand."""
    return order.parents[1] / order.name


def write_order(out: Path, spec: Run, versions: dict[str, str]) -> Path:
    """Orders a run, to be made by these versions and no others."""
    discard(folder_of(out, spec.id))  # failed, or half-written
    order = order_of(out, spec.id)
    order.mkdir(parents=True)
    write_json(order / VERSIONS, versions)
    write_whole(order / SPEC, spec.model_dump_json(indent=2))
    os.utime(order, ns=(_NOT_BEGUN, _NOT_BEGUN))
    return order


def is_begun(order: Path) -> bool:
    """Whether any attempt at an order has begun: its folder was changed since it was ordered."""
    try:
        return order.stat().st_mtime_ns != _NOT_BEGUN
    except FileNotFoundError:
        return False


def withdraw(order: Path) -> None:
    """Ends all attempts at an order, wherever they are made; their folders stay."""
    (order / SPEC).unlink(missing_ok=True)


def begin(order: Path) -> Path:
    """Makes the folder of a new attempt.

    Raises:
        FileNotFoundError: The order was withdrawn, or is not seen on this machine.
    """
    contents = {name: (order / name).read_text(encoding="utf-8") for name in (VERSIONS, SPEC)}
    folder = order / uuid4().hex
    folder.mkdir()
    for name, text in contents.items():
        write_whole(folder / name, text)
    return folder


def newest_attempt(order: Path) -> Path | None:
    """The attempt that began last; any may be moved to its place meanwhile."""
    begun: dict[Path, int] = {}
    try:
        for folder in order.iterdir():
            with suppress(FileNotFoundError, NotADirectoryError):
                begun[folder] = (folder / SPEC).stat().st_mtime_ns
    except FileNotFoundError:
        return None
    return max(begun, key=begun.__getitem__, default=None)


def is_wanted(attempt: Path) -> bool:
    """Whether an attempt should go on: it is still ordered, and no other one was faster."""
    order = attempt.parent
    return (order / SPEC).exists() and attempt.exists() and not is_done(target_of(order))


def place(attempt: Path) -> None:
    """Makes an attempt the run's result, as a whole or not at all; the second of two is thrown away.

    Raises:
        FileNotFoundError: Somebody has cleared the attempt away.
    """
    target = target_of(attempt.parent)
    if is_done(attempt) and not is_done(target):
        discard(target)
    try:
        attempt.rename(target)
    except OSError:
        if not is_done(target):
            raise
        discard(attempt)


def discard(folder: Path) -> None:
    """Deletes a folder; whoever may still work in it finds it gone at once, not half there."""
    root = next(parent for parent in folder.parents if parent.name == RUNS) / _ATTEMPTS
    root.mkdir(parents=True, exist_ok=True)
    rubbish = root / f".{uuid4().hex}"
    try:
        folder.rename(rubbish)
    except FileNotFoundError:
        return
    shutil.rmtree(rubbish, ignore_errors=True)


def clear(out: Path) -> None:
    """Deletes all orders and attempts, those that a killed runner left behind, too."""
    root = out / RUNS / _ATTEMPTS
    for folder in list(root.glob("*")):
        discard(folder)
    shutil.rmtree(root, ignore_errors=True)
