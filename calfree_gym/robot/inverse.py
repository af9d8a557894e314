"""Inverse kinematics: the registers at which a gripper point is somewhere, for any arm."""

from collections.abc import Callable

import numpy as np

from calfree_gym.geometry import Array

_CANDIDATES = 400
"""About so many registers, on a grid, may the search start from."""
_ITERATIONS = 30
_STILL = 1e-9
"""The search ends with a step of registers that is smaller."""
_STEP = 1e-5
_DAMPING = 1e-9


def registers_at(point: Array, gripper_at: Callable[[Array], Array], lowest: Array, highest: Array) -> Array:
    """Registers (motors,) that bring the gripper nearest to `point` (3,) in m.

    The nearest of a grid of registers, then damped Gauss-Newton steps (Levenberg 1944) within the stops.

    Args:
        point: In m (3,).
        gripper_at: From registers (k, motors) to gripper points (k, 3) in m.
        lowest: Registers at which the motors stop (motors,).
        highest: The same at the other end.
    """
    motors = len(lowest)
    along = max(3, round(_CANDIDATES ** (1 / motors)))
    axes = np.linspace(lowest, highest, along).T
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, motors)
    registers = grid[np.square(gripper_at(grid) - point).sum(-1).argmin()]
    moved = _STEP * np.vstack([np.zeros(motors), np.eye(motors)])
    damping, error = _DAMPING, np.inf
    best = registers
    for _ in range(_ITERATIONS):
        points = gripper_at(registers + moved)
        found = float(np.square(points[0] - point).sum())
        if found < error:
            best, error, damping = registers, found, max(damping / 10, _DAMPING)
            jacobian = (points[1:] - points[0]).T / _STEP
            residual = points[0] - point
        else:
            damping *= 100
        gradient = jacobian.T @ residual
        stopped = ((best <= lowest) & (gradient > 0)) | ((best >= highest) & (gradient < 0))
        free = np.where(stopped, 0.0, 1.0)
        normal = jacobian.T @ jacobian * np.outer(free, free)
        step = np.linalg.solve(normal + (damping + stopped) * np.eye(motors), gradient * free)
        registers = np.clip(best - step, lowest, highest)
        if np.abs(registers - best).max() < _STILL:
            break
    return best
