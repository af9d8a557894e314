"""The outline of a blob, and the ball's outline that explains most of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calfree_gym.vision.opacity import Opacity

Array = NDArray[np.float64]

RAYS = 64
"""Directions in which the outline is sought. Choice: one for every 3 px of the largest ball's outline."""
STRETCHES = (1.0, 1.15, 1.3)
"""How much longer a ball may be away from the image's centre than across: a camera's wide angle does it."""
TOLERANCE = (0.25, 0.03)
"""Largest distance of an outline from its circle, in px and in radii. Choice: twice what blur, noise and
JPEG do to balls that nothing hides."""
STRETCH_COST = 2.0
"""Rays that a stretch must explain to be believed. Choice: against stretches that suit the noise only."""
_ANGLES = np.arange(RAYS) * (2 * np.pi / RAYS)
_RAYS = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], -1)
_STEP = 0.5


def _triples() -> NDArray[np.intp]:
    """Three rays each, (n, 3): on arcs of a fourth to two thirds of the outline, all around."""
    start = np.arange(0, RAYS, 2)[:, None]
    return np.concatenate([start + gap * np.arange(3) for gap in (8, 12, 16, 21)]) % RAYS


_TRIPLES = _triples()


def outline(shares: Opacity, centre: Array) -> Array:
    """Where rays from `centre` (2,) last leave a blob: points (RAYS, 2) in px, pixel centres whole."""
    radii = np.arange(0.0, np.hypot(*shares.shape), _STEP)
    where = (centre + radii[:, None, None] * _RAYS).astype(np.float32)
    along = cv2.remap(shares, where[..., 0], where[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    last = len(radii) - 1 - (along[::-1] >= 0.5).argmax(0)
    last = np.where((along >= 0.5).any(0), last, 0).clip(0, len(radii) - 2)
    rays = np.arange(RAYS)
    here, beyond = along[last, rays], along[last + 1, rays]
    part = ((here - 0.5) / np.maximum(here - beyond, 1e-6)).clip(0, 1)
    return centre + ((last + part) * _STEP)[:, None] * _RAYS


@dataclass(frozen=True)
class Circle:
    """A ball's outline: a circle that a wide-angle lens may have stretched away from the image's centre.

    Attributes:
        centre: In px (2,).
        radius: Across the stretch, in px.
        stretch: Length away from the image's centre by length across.
        on: Which outline points lie on it (RAYS,).
        roundness: Share of the outline that is the circle's, less what sticks out; at most 1.
    """

    centre: Array
    radius: float
    stretch: float
    on: NDArray[np.bool_]
    roundness: float


def fit_circle(points: Array, away: Array, largest: float) -> Circle:
    """The circle on which most of an outline lies, and beyond which nothing lies.

    Where something hides a part of a ball, the rest of the blob's outline lies within the ball's.

    Args:
        points: The outline (RAYS, 2), in px.
        away: From the image's centre to the blob's (2,), in px.
        largest: Largest radius, in px.
    """
    axis = away / max(float(np.hypot(*away)), 1e-9)
    turn = np.array([axis, [-axis[1], axis[0]]])
    turned = (points - points.mean(0)) @ turn.T
    best: tuple[float, Any] = (np.inf, None)
    for stretch in STRETCHES:
        flat = turned / [stretch, 1.0]
        centre, radius = _least_squares(flat)
        cost, distance = _cost(flat, centre[None], np.array([radius]))
        if (np.abs(distance[0]) > _tolerance(radius)).any():
            centre, radius, cost, distance = _robust(flat, largest)
        total = float(cost[0]) + STRETCH_COST * (stretch > 1)
        if total < best[0]:
            on = np.abs(distance[0]) <= _tolerance(radius)
            best = total, (centre, radius, stretch, on, 1 - float(cost[0]) / RAYS)
        if total < STRETCH_COST:
            break
    centre, radius, stretch, on, roundness = best[1]
    middle = points.mean(0) + (centre * [stretch, 1.0]) @ turn
    return Circle(middle, radius, stretch, on, roundness)


def _robust(flat: Array, largest: float) -> tuple[Array, float, Array, Array]:
    """Centre, radius, cost and distances of the best circle through three points, then through all near it."""
    centres, radii = _through(flat[_TRIPLES])
    cost, distance = _cost(flat, centres, radii)
    i = np.where(radii <= largest, cost, np.inf).argmin()
    centre, radius, cost, distance = centres[i], float(radii[i]), cost[i : i + 1], distance[i : i + 1]
    for _ in range(3):
        on = np.abs(distance[0]) <= _tolerance(radius)
        if on.sum() < 4:
            break
        new_centre, new_radius = _least_squares(flat[on])
        new_cost, new_distance = _cost(flat, new_centre[None], np.array([new_radius]))
        if new_cost[0] > cost[0] + 1 or new_radius > largest:
            break
        centre, radius, cost, distance = new_centre, new_radius, new_cost, new_distance
    return centre, radius, cost, distance


def _tolerance(radius: Any) -> Any:
    return TOLERANCE[0] + TOLERANCE[1] * radius


def _cost(flat: Array, centres: Array, radii: Array) -> tuple[Array, Array]:
    """For n circles: rays that they do not explain (n,), and distances (n, RAYS) of points beyond them.

    A point that sticks out counts up to three times: nothing in front of a ball can do that.
    """
    offsets = flat - centres[:, None]
    distance = np.sqrt((offsets * offsets).sum(-1)) - radii[:, None]
    relative = (distance / _tolerance(radii)[:, None]) ** 2
    return np.minimum(relative, np.where(distance > 0, 3.0, 1.0)).sum(-1), distance


def _through(corners: Array) -> tuple[Array, Array]:
    """Centres (n, 2) and radii (n,) of circles through three points each (n, 3, 2)."""
    first = corners[:, 0]
    b, c = corners[:, 1] - first, corners[:, 2] - first
    twice = 2 * (b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0])
    twice = np.where(np.abs(twice) < 1e-9, 1e-9, twice)
    bb, cc = (b * b).sum(-1), (c * c).sum(-1)
    offset = np.stack([c[:, 1] * bb - b[:, 1] * cc, b[:, 0] * cc - c[:, 0] * bb], -1) / twice[:, None]
    return first + offset, np.sqrt((offset * offset).sum(-1))


def _least_squares(points: Array) -> tuple[Array, float]:
    """Centre (2,) and radius of the circle nearest to points (n, 2), by Kåsa's algebraic fit."""
    mean = points.mean(0)
    x, y = (points - mean).T
    design = np.stack([x, y, np.ones_like(x)], -1)
    normal = design.T @ design + 1e-9 * np.eye(3)
    a, b, c = np.linalg.solve(normal, design.T @ (x * x + y * y))
    return mean + [a / 2, b / 2], float(np.sqrt(max(c + (a * a + b * b) / 4, 1e-9)))
