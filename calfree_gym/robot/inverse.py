"""Inverse kinematics: the registers at which a gripper point is somewhere, for any arm."""

from collections.abc import Callable, Iterator

import numpy as np

from calfree_gym.geometry import Array
from calfree_gym.image import rounded

_CANDIDATES = 400
"""About so many registers, on a grid, may the search start from."""
_ITERATIONS = 30
"""Of a search (a guard: a dozen are enough)."""
_STILL = 1e-9
"""The search ends with a step of registers that is smaller."""
_STARTS = 20
"""Where stops end the search before the point is reached, it begins anew from so many places of the grid."""
_REACHED = 1e-5
"""At this distance (m) a point is reached."""
_STEP = 1e-5
"""Registers by which the Jacobian is differenced (a guard: a third of the digits)."""
_DAMPING = 1e-9
"""Of its steps (a guard: it is divided by)."""


class InverseKinematics:
    """Where registers must be for the gripper to be somewhere: the nearest of a grid, then damped steps.

    The steps are those of Gauss-Newton, damped (Levenberg 1944), within the stops.

    Args:
        gripper_at: From registers (k, motors) to gripper points (k, 3) in m.
        lowest: Registers at which the motors stop (motors,).
        highest: The same at the other end.
    """

    def __init__(self, gripper_at: Callable[[Array], Array], lowest: Array, highest: Array) -> None:
        self._gripper_at = gripper_at
        self._lowest, self._highest = lowest, highest
        motors = len(lowest)
        along = max(3, round(_CANDIDATES ** (1 / motors)))
        axes = np.linspace(lowest, highest, along).T
        self._grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, motors)
        self._on_grid = gripper_at(self._grid)
        self._moved = _STEP * np.vstack([np.zeros(motors), np.eye(motors)])

    def registers_at(self, point: Array, near: Array | None = None) -> Array:
        """Registers (motors,) that bring the gripper nearest to `point` (3,) in m.

        Args:
            point: Where it should be.
            near: Registers (motors,) from which the search starts, before it tries others.
        """
        found, least = np.empty(0), np.inf
        for start in self._starts(point, near):
            registers, error = self._from(start, point)
            if error < least:
                found, least = registers, error
            if least <= _REACHED**2:
                break
        return found

    def _starts(self, point: Array, near: Array | None) -> Iterator[Array]:
        """Registers (motors,) from which the search may start, `near` first."""
        if near is not None:
            yield near
        far = rounded(np.square(self._on_grid - point).sum(-1))
        yield from self._grid[far.argsort(kind="stable")[:_STARTS]]

    def _from(self, registers: Array, point: Array) -> tuple[Array, float]:
        """The nearest registers (motors,) behind a start, and the squared distance there."""
        damping, error = _DAMPING, np.inf
        best = registers
        for _ in range(_ITERATIONS):
            points = self._gripper_at(registers + self._moved)
            found = float(np.square(points[0] - point).sum())
            if found < error:
                best, error, damping = registers, found, max(damping / 10, _DAMPING)
                jacobian = (points[1:] - points[0]).T / _STEP
                residual = points[0] - point
            else:
                damping *= 100
            gradient = jacobian.T @ residual
            at_lowest, at_highest = best <= self._lowest, best >= self._highest
            stopped = (at_lowest & (gradient > 0)) | (at_highest & (gradient < 0))
            free = np.where(stopped, 0.0, 1.0)
            normal = jacobian.T @ jacobian * np.outer(free, free)
            step = np.linalg.solve(normal + np.diag(damping + stopped), gradient * free)
            registers = np.clip(best - step, self._lowest, self._highest)
            if np.abs(registers - best).max() < _STILL:
                break
        return best, error
