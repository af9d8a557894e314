"""What an agent knows of an arm, kept in one file with the home that it was learned from."""

from __future__ import annotations

import json
import os
import warnings
import zipfile
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from calfree_gym.files import check_size, whole
from calfree_gym.lerobot.motors import MOST
from calfree_gym.lerobot.robot import Encoder
from calfree_gym.picture_reach import Array

AGENT, HOME = "agent", "home.json"


def save(
    path: str | Path,
    agent: Any,
    home: Mapping[str, float],
    others: Mapping[str, float],
    encoders: Mapping[str, Encoder],
    unit: float,
) -> None:
    """Writes what an agent knows, and home: as encoders tell it, whatever is calibrated meanwhile.

    Args:
        path: Of the file, which is replaced as a whole or not at all.
        agent: Has `save`.
        home: Of each motor, in degrees.
        others: Where motors stand that do not move, as LeRobot has it.
        encoders: Of motors; where there are none, home is kept in degrees.
        unit: Degrees of one register.
    """
    ticks = {name: encoders[name].ticks(at) + encoders[name].offset for name, at in home.items() if encoders}
    kept = {
        "agent": _name(agent),
        "unit": unit,
        "degrees": dict(home),
        "ticks": ticks,
        "others": dict(others),
    }
    saved = BytesIO()
    agent.save(saved)
    with whole(os.path.realpath(path)) as place, zipfile.ZipFile(place, "w") as file:
        file.writestr(AGENT, saved.getvalue())
        file.writestr(HOME, json.dumps(kept))


class SavedKnowledge(BytesIO):
    """What an agent saved, open; messages name it by the file that it stands in."""

    def __init__(self, content: bytes, path: str | Path) -> None:
        super().__init__(content)
        self._path = path

    def __str__(self) -> str:
        return str(self._path)


def read(
    path: str | Path, unit: float, agent: str, motors: Sequence[str] | None = None
) -> tuple[SavedKnowledge, dict[str, float], dict[str, float], dict[str, float]]:
    """What an agent saved; home in degrees and in ticks; where motors stood that did not move.

    Args:
        path: Of the file.
        unit: Degrees of one register, here.
        agent: Its name here, as `agents.make` takes it; empty where it has none.
        motors: Here; by default any.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It is none that `save` has written, or of another agent, other motors or another unit.
    """
    content = Path(path).read_bytes()
    try:
        with zipfile.ZipFile(BytesIO(content)) as file:
            check_size(file)
            known, home = file.read(AGENT), json.loads(file.read(HOME))
        degrees, ticks = dict(home["degrees"]), dict(home["ticks"])
        others = {name: float(at) for name, at in home.get("others", {}).items()}
        then = {"unit": home["unit"], "agent": home.get("agent"), "motors": ",".join(degrees)}
    except Exception as error:  # what is raised on a damaged file depends on where the damage is
        raise ValueError(f"{path} is no file that the environment's save has written: {error!r}") from error
    here = {
        "unit": unit,
        "agent": agent if then["agent"] and agent else then["agent"],
        "motors": then["motors"] if motors is None else ",".join(motors),
    }
    if other := [what for what in then if then[what] != here[what]]:
        found = " and ".join(f"{what} {then[what]} (here {here[what]})" for what in other)
        fits = " ".join(f"--{what}={then[what]}" for what in other)
        raise ValueError(f"{path} is of {found}; allowed: {fits}, or another file")
    return SavedKnowledge(known, path), degrees, ticks, others


def load(
    path: str | Path,
    agent: Any,
    motors: Sequence[str],
    others: Mapping[str, float],
    encoders: Mapping[str, Encoder],
    unit: float,
) -> tuple[SavedKnowledge, Array]:
    """What an agent saved; and home (m,) in degrees, of motors as they are calibrated now.

    Warns of motors that do not move and stand elsewhere than they did.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: See `read`; or it is of other encoders.
    """
    known, degrees, ticks, stood = read(path, unit, _name(agent), motors)
    if bool(ticks) != bool(encoders):
        has = "has encoders", "has none"
        raise ValueError(f"{path} is of a robot that {has[not ticks]}; this one {has[not encoders]}")
    kept: dict[str, Any] = {name: (ticks or degrees).get(name) for name in motors}
    if not all(isinstance(at, int | float) and abs(at) < 2**32 for at in kept.values()):
        raise ValueError(f"{path} has home at {kept}; allowed: a finite number of each motor")
    here = [encoders[name].degrees(encoders[name].says(at)) if ticks else at for name, at in kept.items()]
    for name, at in others.items():
        if abs(stood.get(name, at) - at) > MOST:
            warnings.warn(
                f"{path} is of an arm whose motor {name}, which does not move, stood at {stood[name]:.0f}; "
                f"here it stands at {at:.0f}: what was learned is of another arm",
                stacklevel=4,
            )
    return known, np.array(here, float)


def _name(agent: Any) -> str:
    return getattr(agent, "name", "")
