"""One attempt at a run, on whatever machine: in a folder of its own, moved into its place when whole."""

import socket
import threading
from pathlib import Path

from experiments.errors import ConfigError
from experiments.execution.orders import begin, is_wanted, place, target_of
from experiments.running.body import template
from experiments.running.results_folder import LOG, SPEC, VERSIONS, is_done, read_json
from experiments.running.versions import versions

LOST = -1
"""The exit code of a body of which nothing more is known than that it is gone."""
_FAILED = 1
_LOOK_EVERY = 1.0
"""Seconds in which an attempt learns that it is not wanted any more."""


def attempt(order: str) -> int:
    """Makes an ordered run, in a process of its own.

    Args:
        order: Folder of the order.

    Returns:
        An exit code, see `Executor.ended`.

    Raises:
        ConfigError: This machine does not see the folder.
        OSError: The folder cannot be written.
    """
    if is_done(target_of(Path(order))):
        return 0
    if not Path(order).is_dir():
        raise ConfigError(
            f"{socket.gethostname()} does not see {order}: --out must be a folder on a file system that all "
            "machines share, under the same path"
        )
    exit_code = LOST
    try:
        folder = begin(Path(order))
        here = versions()
        if other := _other_versions(folder, here):
            log = f"{socket.gethostname()} has other versions: {other}\n"
            (folder / LOG).write_text(log, encoding="utf-8")
            return _FAILED
        exit_code = _follow(folder, here)
        if exit_code == 0 and is_done(folder):
            place(folder)
    except FileNotFoundError:
        if (Path(order) / SPEC).exists():  # else it was withdrawn
            raise
    return 0 if is_done(target_of(Path(order))) else exit_code or LOST


def _other_versions(folder: Path, here: dict[str, str]) -> str:
    ordered = read_json(folder / VERSIONS)
    return "; ".join(
        f"{key} {here[key]}, ordered {ordered.get(key)}" for key in here if here[key] != ordered.get(key)
    )


def _follow(folder: Path, here: dict[str, str]) -> int:
    """Lets a body do its work, writes down what it prints, and ends it when it is not wanted any more."""
    over = threading.Event()
    with template(here) as made_by, (folder / LOG).open("w", encoding="utf-8") as log:

        def end_unwanted() -> None:
            while not over.wait(_LOOK_EVERY):
                if not is_wanted(folder):
                    made_by.kill()

        watch = threading.Thread(target=end_unwanted, daemon=True)
        watch.start()
        try:
            return made_by.make(folder, log)
        finally:
            over.set()
            watch.join()
