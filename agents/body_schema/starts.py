"""Where fits begin: anywhere, or where a change may have led."""

from __future__ import annotations

import numpy as np

from ..base.observation import Array
from .chain import Chain
from .pinholes import PLACE, TURN
from .rotations import rotation

TURNS, SLIDES = 0.5, 0.3
"""Standard deviations of how far joints of a random arm turn, in rad, and slide, for a register of one.
Choice: less than real ones do; from there, fits find them."""
ROLLS = 8
"""So many rolls of a camera are tried. Choice: fits find those between."""


def random_starts(chain: Chain, mean: Array, count: int, random: np.random.Generator) -> Array:
    """Numbers (count, p) of random arms, before a right camera that looks at the gripper from anywhere."""
    starts = np.tile(mean, (count, 1))
    for start in starts:
        for motor in range(chain.motors):
            start[chain.joint(motor)][:6] = random.normal(size=6) * np.repeat([TURNS, SLIDES], 3)
        way = random.normal(size=3)
        turn = way * min(1.0, np.pi / float(np.linalg.norm(way)))
        start[chain.camera(1)][TURN] = turn
        start[chain.camera(1)][PLACE] = mean[chain.gripper] - rotation(turn).T @ mean[chain.gripper]
    return starts


def rolled(chain: Chain, numbers: Array, camera: int) -> Array:
    """Numbers (ROLLS, p) with a camera rolled about its axis."""
    starts = np.tile(numbers, (ROLLS, 1))
    for start, angle in zip(starts, np.linspace(0, 2 * np.pi, ROLLS, endpoint=False), strict=True):
        turn = start[chain.camera(camera)][TURN]
        turn[:] = composed(np.array([0.0, 0.0, angle]), turn)
    return starts


def composed(second: Array, first: Array) -> Array:
    """The turn (3,) that does what two turns (3,) do one after the other: a product of quaternions."""
    (a, u), (b, v) = _quaternion(second), _quaternion(first)
    scalar, vector = a * b - u @ v, a * v + b * u + np.cross(u, v)
    length = float(np.linalg.norm(vector))
    if length == 0:
        return vector
    angle = 2 * np.arctan2(length, scalar)
    return np.asarray(vector / length * (angle - 2 * np.pi * (angle > np.pi)))


def _quaternion(turn: Array) -> tuple[float, Array]:
    angle = float(np.linalg.norm(turn))
    return np.cos(angle / 2), turn / 2 * np.sinc(angle / (2 * np.pi))


def reversing(chain: Chain, motor: int) -> Array:
    """Signs (p,) that make numbers those of the same robot with a motor reversed: its curve is that of -r."""
    signs = np.ones(chain.size)
    signs[chain.joint(motor)] = [-1.0] * 8 + [1.0]
    return signs
