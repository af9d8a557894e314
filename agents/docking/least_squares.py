"""Levenberg and Marquardt's method for many problems of one kind at once."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..base.observation import Array

SETTLED = 0.1
"""Less is not worth another round. Derived: costs are squares of deviations, or of pixels."""


class Quadratic(NamedTuple):
    """A sum of squares near a place, for each problem.

    Attributes:
        cost: The sum (s,).
        gradient: Half of it (s, n).
        hessian: Half of Gauss and Newton's (s, n, n).
    """

    cost: Array
    gradient: Array
    hessian: Array


class Least(NamedTuple):
    """Where the method ended.

    Attributes:
        places: Of each problem (s, n).
        costs: There (s,).
    """

    places: Array
    costs: Array


def least(
    near: Callable[[Array], Quadratic],
    starts: Array,
    rounds: int,
    enough: float = 0.0,
    limit: float = np.inf,
) -> Least:
    """Goes down from starts (s, n).

    It ends after so many rounds, where one problem's cost is less than `enough`, or where none becomes
    smaller by more than `SETTLED`.

    Args:
        near: The sums near places (s, n).
        starts: Where to begin.
        rounds: At most.
        enough: Cost that will do.
        limit: Of the size of each coordinate.
    """
    places, damping = starts, np.full(len(starts), 0.1)
    here, diagonal = near(places), np.eye(starts.shape[1])
    for _ in range(rounds):
        raised = here.hessian + damping[:, None, None] * diagonal * (1 + here.hessian)
        steps = np.linalg.solve(raised, here.gradient[..., None])[..., 0]
        tried = np.clip(places - steps, -limit, limit)
        there = near(tried)
        gains = here.cost - there.cost
        better = gains > 0
        places = np.where(better[:, None], tried, places)
        here = Quadratic(
            *(
                np.where(better.reshape(-1, *[1] * (a.ndim - 1)), b, a)
                for a, b in zip(here, there, strict=True)
            )
        )
        damping = np.where(better, damping / 4, damping * 6)
        if here.cost.min() < enough or 0 < gains.max() < SETTLED:
            break
    return Least(places, here.cost)
