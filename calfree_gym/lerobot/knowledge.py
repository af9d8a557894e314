"""What an agent knows of an arm, kept in one file with the home that it was learned from."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from calfree_gym.files import check_size, whole
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
    with whole(path) as place, zipfile.ZipFile(place, "w") as file:
        file.writestr(AGENT, saved.getvalue())
        file.writestr(HOME, json.dumps({"unit": unit, "degrees": dict(home), "ticks": ticks}))


def load(
    path: str | Path, motors: Sequence[str], encoders: Mapping[str, Encoder], unit: float
) -> tuple[BytesIO, Array]:
    """What an agent saved; and home (m,) in degrees, of motors as they are calibrated now.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It is none that `save` has written, or of other motors, encoders or another unit.
    """
    content = Path(path).read_bytes()
    try:
        with zipfile.ZipFile(BytesIO(content)) as file:
            check_size(file)
            known, home = file.read(AGENT), json.loads(file.read(HOME))
        degrees, ticks, of_unit = dict(home["degrees"]), dict(home["ticks"]), home["unit"]
    except Exception as error:  # what is raised on a damaged file depends on where the damage is
        raise ValueError(f"{path} is no file that the environment's save has written: {error!r}") from error
    then, now = (list(degrees), of_unit, bool(ticks)), (list(motors), unit, bool(encoders))
    if then != now:
        raise ValueError(f"{path} is of (motors, unit, whether there are encoders) {then}; here it is {now}")
    kept: dict[str, Any] = {name: (ticks or degrees).get(name) for name in motors}
    if not all(isinstance(at, int | float) and abs(at) < 2**32 for at in kept.values()):
        raise ValueError(f"{path} has home at {kept}; allowed: a finite number of each motor")
    here = [encoders[name].degrees(at - encoders[name].offset) if ticks else at for name, at in kept.items()]
    return BytesIO(known), np.array(here, float)
