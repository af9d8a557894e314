"""Joints as twists (product of exponentials, Brockett 1984): how they move points, and how that changes."""

from __future__ import annotations

import numpy as np

from ..base.observation import Array
from .rotations import cross_matrix, jacobian_derivative, rotation_and_jacobian, turned

JOINT = 9
"""Numbers of a joint: how far it turns about x, y, z and slides along them for a register of one (6), at
which register it stood when the others were told (1), and what the register's square and cube add (2)."""


class Twists:
    """What joints do at registers: a point x of what they move comes to R x + s.

    Attributes:
        turns: R (..., 3, 3).
        shifts: s (..., 3).

    Args:
        joints: Their numbers (..., 9).
        registers: One of each (...).
    """

    def __init__(self, joints: Array, registers: Array) -> None:
        self._axes, self._ways, self._registers = joints[..., :3], joints[..., 3:6], registers
        self._square, self._cube = joints[..., 7], joints[..., 8]
        by = joints[..., 6] + registers + self._square * registers**2 + self._cube * registers**3
        self._by = by[..., None]
        self._turn, self._slide = self._axes * self._by, self._ways * self._by
        self.turns, self._jacobian = rotation_and_jacobian(self._turn)
        self.shifts = turned(self._jacobian, self._slide)

    def by_registers(self, places: Array) -> Array:
        """Derivatives of R x + s by registers (..., 3, 1), where R x is at `places` (..., 3)."""
        per_register = 1 + 2 * self._square * self._registers + 3 * self._cube * self._registers**2
        return (self._further(places) * per_register[..., None])[..., None]

    def by_numbers(self, places: Array) -> Array:
        """By the joints' numbers (..., 3, 9)."""
        by, registers = self._by[..., None], self._registers
        by_axis = by * (jacobian_derivative(self._turn, self._slide) - cross_matrix(places) @ self._jacobian)
        by_way, further = by * self._jacobian, self._further(places)
        powers = np.stack([np.ones_like(registers), registers**2, registers**3], -1)[..., None, :]
        return np.concatenate([by_axis, by_way, further[..., None] * powers], -1)

    def _further(self, places: Array) -> Array:
        """What they move, for each rad or unit of length further (..., 3)."""
        return turned(cross_matrix(self._axes), places) + turned(self.turns, self._ways)
