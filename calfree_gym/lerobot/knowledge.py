"""What an agent knows of an arm, kept in one file with the home that it was learned from."""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from calfree_gym.lerobot.robot import Encoder
from calfree_gym.picture_reach import Array

AGENT, HOME = "agent", "home.json"


def save(
    path: str | Path, agent: Any, home: Mapping[str, float], encoders: Mapping[str, Encoder], unit: float
) -> None:
    """Writes what an agent knows, and home: as encoders tell it, whatever is calibrated meanwhile.

    Args:
        path: Of the file, which is replaced as a whole or not at all.
        agent: Has `save`.
        home: Of each motor, in degrees.
        encoders: Of motors; where there are none, home is kept in degrees.
        unit: Degrees of one register.
    """
    ticks = {name: encoders[name].ticks(at) + encoders[name].offset for name, at in home.items() if encoders}
    saved = BytesIO()
    agent.save(saved)
    half = Path(f"{path}.part")
    with zipfile.ZipFile(half, "w") as file:
        file.writestr(AGENT, saved.getvalue())
        file.writestr(HOME, json.dumps({"unit": unit, "degrees": dict(home), "ticks": ticks}))
    os.replace(half, path)


def load(
    path: str | Path, motors: Sequence[str], encoders: Mapping[str, Encoder], unit: float
) -> tuple[BytesIO, Array]:
    """What an agent saved; and home (m,) in degrees, of motors as they are calibrated now.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It is none that `save` has written, or of other motors, encoders or another unit.
    """
    try:
        with zipfile.ZipFile(path) as file:
            known, home = file.read(AGENT), json.loads(file.read(HOME))
    except (zipfile.BadZipFile, KeyError, json.JSONDecodeError) as error:
        raise ValueError(f"{path} is no file that the environment's save has written: {error}") from error
    degrees, ticks = home["degrees"], home["ticks"]
    then, now = (list(degrees), home["unit"], bool(ticks)), (list(motors), unit, bool(encoders))
    if then != now:
        raise ValueError(f"{path} is of (motors, unit, whether there are encoders) {then}; here it is {now}")
    here = [
        encoders[name].degrees(ticks[name] - encoders[name].offset) if ticks else degrees[name]
        for name in motors
    ]
    return BytesIO(known), np.array(here)
