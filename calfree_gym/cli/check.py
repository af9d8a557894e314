"""`calfree check`: cameras, marks and motors, before anything moves."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from calfree_gym.cli.drawing import MARKS, drawn, pixels
from calfree_gym.cli.standing import StandingRobot
from calfree_gym.errors import check_positive
from calfree_gym.image import PIXELS_PER_UNIT
from calfree_gym.lerobot.robot import check_limits
from calfree_gym.picture_reach import PictureLook

LOOKS, PAUSE_S = 5, 0.2
"""So many looks, so far apart: enough for a jitter, and for a frozen camera. Choice."""


def check(standing: StandingRobot, unit: float, out: Path) -> int:
    """Tells what stands in the way of reaching; 1 where something does, else 0.

    Args:
        standing: The robot, home.
        unit: Degrees that each motor must be able to go, either way.
        out: A folder, for a picture of each camera as it is, and one with what is seen.

    Raises:
        ArmError: The robot does not answer.
    """
    check_positive("unit", unit, 180)
    out.mkdir(parents=True, exist_ok=True)
    looks = []
    for _ in range(LOOKS):
        looks.append(standing.look())
        standing.sleep(PAUSE_S)
    wrong = _motors(standing, unit)
    for camera, name in enumerate(standing.cameras):
        wrong += _camera(looks, camera, name)
        files = out / f"{name}.png", out / f"{name}-seen.png"
        for file, picture in zip(files, (looks[-1].pictures[camera], drawn(looks[-1], camera)), strict=True):
            if not cv2.imwrite(str(file), np.ascontiguousarray(picture[..., ::-1])):
                raise OSError(f"{file} cannot be written")
        print(f"  {files[0]}, and with what is seen {files[1]}")
    print("\n".join(["", *(f"WRONG: {each}" for each in wrong)]) if wrong else "\nAll is well.")
    return int(bool(wrong))


def _motors(standing: StandingRobot, unit: float) -> list[str]:
    """Prints where motors stand; what is wrong with them."""
    print(f"motors, {unit:g} degrees either way from here:")
    wrong = []
    for name, at in zip(standing.motors, standing.positions, strict=True):
        known = standing.encoders.get(name)
        ticks = f", {known.ticks(at):.0f} of {known.low} to {known.high} ticks" if known else ""
        try:
            check_limits(standing.encoders, [name], np.array([at]), np.array([at]), unit)
            said = "may go" if known else "no encoder is known: nothing is checked"
        except ValueError as error:
            said = "WRONG"
            wrong.append(str(error))
        print(f"  {name}: at {at:.1f} degrees{ticks}: {said}")
    return wrong


def _camera(looks: Sequence[PictureLook], camera: int, name: str) -> list[str]:
    """Prints what a camera sees; what is wrong with that."""
    pictures = [look.pictures[camera] for look in looks]
    height, width = pictures[0].shape[:2]
    print(f"camera {name}: {width} × {height}")
    wrong = []
    if all(np.array_equal(pictures[0], each) for each in pictures[1:]):
        wrong.append(f"camera {name} has shown one picture {len(looks)} times: it is frozen, or sees nothing")
    for row, mark in enumerate(MARKS):
        seen = [look for look in looks if look.visible[2 * row + camera]]
        if seen:
            points = np.array([look.points[2 * row + camera] for look in seen]) * PIXELS_PER_UNIT
            x, y = pixels(seen[-1], camera)[row]
            where = f" at ({x:.0f}, {y:.0f}), jitter {points.std(0).max():.1f} px of 512"
        print(f"  {mark}: seen in {len(seen)} of {len(looks)} looks{where if seen else ''}")
        if len(seen) < len(looks):
            wrong.append(f"the {mark} is seen by camera {name} in {len(seen)} of {len(looks)} looks")
    return wrong
