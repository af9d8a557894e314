"""Where fits begin: anywhere, or where a change may have led."""

from __future__ import annotations

import numpy as np

from ..base.observation import Array
from .chain import Chain, rotation

TURN, SLIDE = 0.5, 0.3
"""Standard deviations of how far joints of a random arm turn, in rad, and slide, for a register of one.
Choice: less than real ones do; from there, fits find them."""
ROLLS = 8
"""So many rolls of a camera are tried. Choice: fits find those between."""


def random_starts(chain: Chain, mean: Array, count: int, random: np.random.Generator) -> Array:
    """Numbers (count, p) of random arms, before a right camera that looks at the gripper from anywhere."""
    starts = np.tile(mean, (count, 1))
    for start in starts:
        for motor in range(chain.motors):
            start[chain.joint(motor)][:6] = random.normal(size=6) * np.repeat([TURN, SLIDE], 3)
        way = random.normal(size=3)
        turn = way * min(1.0, np.pi / float(np.linalg.norm(way)))
        start[chain.camera(1)][2:5] = turn
        start[chain.camera(1)][5:] = mean[chain.gripper] - rotation(turn) @ mean[chain.gripper]
    return starts


def rolled(chain: Chain, numbers: Array, camera: int) -> Array:
    """Numbers (ROLLS, p) with a camera rolled about its axis."""
    starts = np.tile(numbers, (ROLLS, 1))
    for start, angle in zip(starts, np.linspace(0, 2 * np.pi, ROLLS, endpoint=False), strict=True):
        roll = np.array([0.0, 0.0, angle])
        numbers_of_camera = start[chain.camera(camera)]
        numbers_of_camera[2:5] = composed(roll, numbers_of_camera[2:5])
        numbers_of_camera[5:] = rotation(roll) @ numbers_of_camera[5:]
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


def reversed_joint(chain: Chain, numbers: Array, motor: int) -> Array:
    """Numbers (2, p): the same, and with a motor reversed."""
    starts = np.tile(numbers, (2, 1))
    starts[1, chain.joint(motor)][:6] *= -1
    return starts
