"""A results folder: what stands where, written so that a kill at any moment loses nothing."""

import json
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from filelock import FileLock, Timeout
from pydantic import BaseModel, ValidationError

from calfree_gym.files import whole
from experiments.config.own_agents import TOLD
from experiments.config.suite import Suite
from experiments.errors import ConfigError
from experiments.running.run import runs_of
from experiments.running.versions import UNKNOWN

SUITE = "suite.json"
RUNS = "runs"
PENDING = f"{RUNS}/.attempts"
FIGURES = "figures"
LOCK = ".lock"
RUN = "run.json"
VERSIONS = "versions.json"
LOG = "log.txt"
TRIALS = "trials.jsonl"
DONE = "DONE.json"
TIMINGS = "timings.json"
FAILED = "FAILED.json"
PATIENCE = 10.0
"""Seconds in which a runner that was killed has let go of the folder."""
Form = TypeVar("Form", bound=BaseModel)


def made_folder(out: Path) -> Path:
    """A folder to write into, which is made where it is missing: asked for before anything is begun.

    What is written into it, or cleared, may not lie elsewhere: it may be somebody else's folder.
    """
    refuse_links(*(out / folder for folder in (RUNS, PENDING, FIGURES)))
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=out):
            return out
    except OSError as error:
        raise ConfigError(
            f"{out}: this folder cannot be made or written into ({error.strerror}); nothing was run; "
            "allowed: a folder that can"
        ) from None


def refuse_links(*paths: Path) -> None:
    """Raises ConfigError where one of these leads elsewhere."""
    for path in paths:
        if path.is_symlink():
            raise ConfigError(f"{path} is a link to something else; allowed: its own file or folder")


def folder_of(out: Path, run: str) -> Path:
    """Where a run keeps what it makes."""
    return out / RUNS / run


def is_done(folder: Path) -> bool:
    """Whether a run has finished."""
    return (folder / DONE).exists()


def write_whole(path: Path, text: str) -> None:
    """Writes a file that is there as a whole or not at all."""
    with whole(path) as file:
        file.write(text.encode())


def write_json(path: Path, value: Any) -> None:
    """Writes a value as JSON, as `write_whole` does."""
    write_whole(path, json.dumps(value, indent=2))


def read_json(path: Path, *keys: str) -> dict[str, Any]:
    """Reads a mapping that `write_json` wrote."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (RecursionError, ValueError) as error:
        raise damaged(path, error) from None
    if not isinstance(found, dict):
        raise damaged(path, f"found {type(found).__name__}; allowed: a mapping")
    if lacking := ", ".join(key for key in keys if key not in found):
        raise damaged(path, f"{lacking} is missing")
    return found


class Failure(BaseModel):
    """What a run left that failed."""

    exit_code: int
    log_tail: list[str]


class _Ran(BaseModel):
    suite: dict[str, Any]
    command: str


def read_as(path: Path, form: type[Form]) -> Form:
    """Reads a mapping of this form that `write_json` wrote."""
    try:
        return form.model_validate(read_json(path))
    except ValidationError as error:
        raise damaged(path, what_is_wrong(error)) from None


def what_is_wrong(error: ValidationError) -> str:
    """The first fault, and where it is."""
    first = error.errors()[0]
    return f"{'.'.join(map(str, first['loc']))}: {first['msg']}"


def damaged(path: Path, what: object) -> ConfigError:
    """What to raise where a file of a results folder cannot be used: what is wrong, and what to do."""
    do = "use the code that made it, or run the suite again with another --out"
    if path.name != SUITE:
        do = f"delete {path.parent if path.parent.parent.name == RUNS else path}, and run it again"
    return ConfigError(f"{path} is damaged, or of an earlier form ({what}); {do}")


def suite_written_down(found: dict[str, Any]) -> Suite:
    """A suite from its JSON, which imports nothing; without claims of 0.1, which have no null agents."""
    if isinstance(claims := found.get("claims"), list):
        found = found | {"claims": [each for each in claims if not _is_of_0_1(each)]}
    return Suite.model_validate(found, context=TOLD)


def _is_of_0_1(claim: Any) -> bool:
    found = claim.get("criteria") if isinstance(claim, dict) else None
    criteria = found if isinstance(found, list) else []
    return any(isinstance(each, dict) and "null_agent" not in each for each in criteria)


def read_suite(out: Path) -> tuple[Suite, str]:
    """The suite that was run in a folder last, and the command that did it."""
    try:
        about = read_as(out / SUITE, _Ran)
        return suite_written_down(about.suite), about.command
    except (FileNotFoundError, NotADirectoryError) as error:
        raise ConfigError(f"{out}: no results here ({error.filename} is missing)") from None
    except ValidationError as error:
        raise damaged(out / SUITE, what_is_wrong(error)) from None


def commit_of(out: Path) -> str:
    """The commit that made what is finished in a folder."""
    return str(read_json(out / SUITE).get("commit", UNKNOWN)) if (out / SUITE).exists() else UNKNOWN


@contextmanager
def locked(out: Path) -> Iterator[None]:
    """Holds the folder for one runner, until that has ended, however it ends; there is no other meanwhile."""
    try:
        with _lock(out, PATIENCE):
            yield
    except Timeout:
        raise ConfigError(
            f"{out}: another runner is at work here; wait for it, or give another --out"
        ) from None


def at_work(out: Path) -> bool:
    """Whether a runner is at work in the folder."""
    if not (out / LOCK).exists():
        return False
    try:
        with _lock(out, 0):
            return False
    except Timeout:
        return True


def _lock(out: Path, seconds: float) -> FileLock:
    refuse_links(out / LOCK)
    return FileLock(out / LOCK, timeout=seconds)


def refuse_foreign(out: Path, suite: Suite, versions: dict[str, str]) -> None:
    """Checks that all that has finished in a folder was made by this code from this configuration.

    More agents, scenarios and worlds of scenarios than before are no other configuration.
    """
    known = {run.id for run in runs_of(suite)}
    finished = sorted(folder for folder in (out / RUNS).glob("*") if is_done(folder))
    if foreign := [folder.name for folder in finished if folder.name not in known]:
        raise ConfigError(
            f"{out} holds {len(foreign)} finished runs that this configuration does not have: "
            f"{_some(foreign)}{changed(out, suite)}. Give another --out, or delete {out}"
        )
    for folder in finished:
        made_by = read_json(folder / VERSIONS) if (folder / VERSIONS).exists() else {}
        other = [
            f"{key} {made_by.get(key, 'unknown')} there, {versions[key]} here"
            for key in versions
            if made_by.get(key) != versions[key]
        ]
        if other:
            raise ConfigError(
                f"{folder.name} in {out} was made by other versions ({'; '.join(other)}): its results are "
                f"not comparable. Give another --out, or delete {out}"
            )


def changed(out: Path, suite: Suite) -> str:
    """In brackets, which keys differ from the configuration that was run there last, if it is known."""
    if not (out / SUITE).exists():
        return ""
    then, now = leaves(read_json(out / SUITE)["suite"]), leaves(suite.model_dump(mode="json"))
    changed = [_change(key, then[key], now[key]) for key in then if key in now and then[key] != now[key]]
    gone = [f"{key} is gone" for key in then if key not in now]
    return f" ({_some([*changed, *gone])})" if changed or gone else ""


def _change(key: str, then: Any, now: Any) -> str:
    """In words; of long values, such as an arm's model, only that they differ."""
    told = f"{key} was {then!r}, is {now!r}"
    return told if len(told) <= 400 else f"{key} has changed"


def leaves(value: Any, path: str = "") -> dict[str, Any]:
    """All that stands in mappings and lists, whatever they are in, by its path."""
    if isinstance(value, dict):
        pairs = value.items()
    elif isinstance(value, list):
        pairs = enumerate(value)  # type: ignore[assignment]
    else:
        return {path: value}
    return {k: v for key, item in pairs for k, v in leaves(item, f"{path}.{key}".lstrip(".")).items()}


def _some(names: list[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
