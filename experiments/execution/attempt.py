"""One attempt at a run, on whatever machine: in a folder of its own, moved into its place when whole."""

import socket
import threading
from pathlib import Path

from experiments.errors import ConfigError
from experiments.execution.orders import begin, is_wanted, place, target_of
from experiments.running.body import start_body
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
        if other := _other_versions(folder):
            log = f"{socket.gethostname()} has other versions: {other}\n"
            (folder / LOG).write_text(log, encoding="utf-8")
            return _FAILED
        exit_code = _follow(folder)
        if exit_code == 0 and is_done(folder):
            place(folder)
    except FileNotFoundError:
        if (Path(order) / SPEC).exists():  # else it was withdrawn
            raise
    return 0 if is_done(target_of(Path(order))) else exit_code or LOST


def _other_versions(folder: Path) -> str:
    ordered, here = read_json(folder / VERSIONS), versions()
    return "; ".join(
        f"{key} {here[key]}, ordered {ordered.get(key)}" for key in here if here[key] != ordered.get(key)
    )


def _follow(folder: Path) -> int:
    """Lets the body do its work, writes down what it prints, and kills it when it is not wanted any more."""
    process = start_body(folder)
    over = threading.Event()

    def kill_unwanted() -> None:
        while not over.wait(_LOOK_EVERY):
            if not is_wanted(folder):
                process.kill()

    threading.Thread(target=kill_unwanted, daemon=True).start()
    assert process.stdout is not None
    try:
        with process, (folder / LOG).open("w", encoding="utf-8") as log:
            for line in process.stdout:
                log.write(line)
                log.flush()
            return process.wait()
    except BaseException:
        process.kill()
        raise
    finally:
        over.set()
