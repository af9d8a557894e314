"""Gathering the finished runs of several parts of a suite, made in different places, into one folder."""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path

from pydantic import ValidationError

from experiments.errors import ConfigError
from experiments.execution.orders import clear, order_of, place
from experiments.running.plan import parse_run, runs_of
from experiments.running.results_folder import (
    DONE,
    RUNS,
    SPEC,
    SUITE,
    TIMINGS,
    VERSIONS,
    changed,
    folder_of,
    is_done,
    locked,
    made_folder,
    read_json,
    read_suite,
    refuse_foreign,
    write_json,
)
from experiments.running.trial_log import TRIALS
from experiments.running.versions import commit_of

_RESULT = (SPEC, VERSIONS, TRIALS, DONE)
"""Files that are the same whenever and wherever a run is made."""


def merge(parts: Sequence[Path], out: Path) -> list[str]:
    """Copies the finished runs of all parts into one folder; all is checked before anything is copied.

    Args:
        parts: Results folders of the same suite, made by the same code.
        out: Where to gather them; may hold some already.

    Returns:
        The ids of the runs that none of them has finished.

    Raises:
        ConfigError: Names the part, and the run that is half-written, foreign, made by other versions or
            different in another part.
        OSError: A folder cannot be read or written.
    """
    suite, command = read_suite(parts[0])
    runs = runs_of(suite)
    sources: dict[str, Path] = {}
    folders = [out, *parts] if (out / SUITE).exists() else parts
    for part in folders:
        if read_suite(part)[0].told() != suite.told():
            raise ConfigError(f"{part} is of another configuration than {parts[0]}{changed(part, suite)}")
        for folder in _finished(part):
            if folder.name not in sources:
                sources[folder.name] = folder
            elif differing := _differing(folder, sources[folder.name]):
                raise ConfigError(
                    f"{folder} and {sources[folder.name]} are the same run with different results "
                    f"({', '.join(differing)}); delete the one that is wrong"
                )
    if not sources:
        raise ConfigError(f"{', '.join(map(str, parts))}: no finished runs here")
    made_by = read_json(next(iter(sources.values())) / VERSIONS)
    for part in parts:
        refuse_foreign(part, suite, made_by)
    with locked(made_folder(out)):
        refuse_foreign(out, suite, made_by)
        clear(out)
        commits = sorted({commit for folder in folders for commit in commit_of(folder).split(", ")})
        about = {"suite": suite.model_dump(mode="json"), "command": command, "commit": ", ".join(commits)}
        write_json(out / SUITE, about)
        for run, folder in sources.items():
            if not is_done(folder_of(out, run)):
                place(Path(shutil.copytree(folder, order_of(out, run) / "merged")))
        clear(out)
    return [spec.id for spec in runs if spec.id not in sources]


def _finished(part: Path) -> list[Path]:
    """The finished runs of a part.

    Raises:
        ConfigError: One of them is half-written.
    """
    folders = sorted(folder for folder in (part / RUNS).glob("*") if is_done(folder))
    for folder in folders:
        if broken := _broken(folder):
            raise ConfigError(
                f"{folder} is half-written: {broken}; delete it, or copy it again from where it was made"
            )
    return folders


def _broken(folder: Path) -> str:
    """What is wrong with a folder that calls itself finished."""
    name = ""
    try:
        for name in (VERSIONS, DONE, TIMINGS):
            read_json(folder / name)
        name = SPEC
        if (found := parse_run((folder / SPEC).read_bytes()).id) != folder.name:
            return f"{SPEC} is of {found}"
        name = TRIALS
        text = (folder / TRIALS).read_text(encoding="utf-8")
        for line in text.splitlines():
            json.loads(line)
    except FileNotFoundError:
        return f"{name} is missing"
    except ValidationError as error:
        first = error.errors()[0]
        if "arm" in first["loc"]:  # it is whole, but the arm's files are not where they were
            raise ConfigError(f"{folder / name} cannot be used here: {first['msg']}") from None
        return f"{name} cannot be read"
    except ValueError:
        return f"{name} cannot be read"
    return "" if text.endswith("\n") else f"{TRIALS} ends within a line"


def _differing(one: Path, other: Path) -> list[str]:
    return [name for name in _RESULT if (one / name).read_bytes() != (other / name).read_bytes()]
