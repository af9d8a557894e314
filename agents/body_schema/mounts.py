"""Which motors move the cameras: told by what moves in the images."""

from __future__ import annotations

import numpy as np

from calfree_gym.image import CAMERAS, IMAGE_UNIT, rounded

from ..adaptation.pairs import Pairs
from ..base.observation import Array

Mounts = tuple[int, int]
STILL = 6.0
"""What is seen within so many times the noise of where it was from home is not moved. Choice."""
MOVED = 0.1
"""It is moved where this share of its coordinates is. Choice: some are mistaken."""
RIDGE = 1e-3
"""Of the regression, relative to the mean square of its registers (a guard)."""


def likely_mounts(pairs: Pairs, count: int) -> list[Mounts]:
    """How many motors, from the base, move the left and the right camera: so many guesses, the best first.

    Motors before a camera move the object's image and not the gripper's; motors behind it, the other way
    round. The guesses are by linear regression of both on the registers.
    """
    motors = pairs.registers.shape[1]
    seen = pairs.only(pairs.with_object)
    moved = seen.objects - seen.homes
    if not _moves(moved, seen.noise_px):
        return [(0, 0)]
    at_home = ~pairs.registers.any(1)
    if not (at_home.any() and pairs.registers.any()):
        return [(0, 0)]
    home = np.median(pairs.sensors[at_home], axis=0)
    if not _moves(pairs.sensors - home, pairs.noise_px):
        return [(motors, motors)]
    gripper = _squares(pairs.registers, pairs.sensors - home)
    object_ = _squares(seen.registers, moved)
    unlike = [gripper[:, :split].sum(1) + object_[:, split:].sum(1) for split in range(motors)]
    splits = np.array(unlike)  # (m, cameras)
    splits /= gripper.sum(1) + object_.sum(1)
    left, right = rounded(splits).argmin(0)
    alike = [(int(k), int(k)) for k in rounded(splits.sum(1)).argsort(kind="stable")]
    return list(dict.fromkeys([(int(left), int(right)), *alike]))[:count]


def _moves(moved: Array, noise_px: Array) -> bool:
    """Whether sensor vectors that are so much from home (n, 4) are moved, in noise of (n,) pixels."""
    far = np.abs(moved) > STILL * noise_px[:, None] * IMAGE_UNIT
    return bool(len(far) and far.mean() >= MOVED)


def _squares(registers: Array, moved: Array) -> Array:
    """By how much each motor moves each image, squared (2, m), from registers (n, m) and sensors (n, 4)."""
    away = registers.any(1)
    registers, moved = registers[away], moved[away]
    weights = 1 / np.square(registers).sum(1)[:, None]  # what is not linear grows with the square
    weighted, moved = registers * weights, moved * weights
    square = weighted.T @ weighted
    square += RIDGE * np.trace(square) / len(square) * np.eye(len(square))
    slopes = np.linalg.solve(square, weighted.T @ moved)  # (m, 4)
    return np.asarray(np.square(slopes).reshape(-1, len(CAMERAS), 2).sum(2).T)
