"""The ball's outline that explains most of a blob's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from calfree_gym.vision.tracking.outline import RAYS, Array

STRETCHES = (1.0, 1.15, 1.3)
"""How much longer a ball may be away from the image's centre than across: a camera's wide angle does it."""
TOLERANCE = (0.3, 0.04)
"""Largest distance of an outline from its circle, in px and in the outline's mean radius. Choice: on drawn
frames tighter ones are worse for hidden balls, wider ones alike. A share of the circle's radius would favour
large circles."""
ENOUGH = 10.0
"""Rays that may stay unexplained without a search for something better. Choice: an eighth of the outline."""
STRETCH_COST = 2.0
"""Rays that a stretch must explain to be believed. Choice: against stretches that suit the noise only."""


def _triples() -> NDArray[np.intp]:
    """Three rays each, (n, 3): on arcs of a fourth to two thirds of the outline, all around."""
    start = np.arange(0, RAYS, 3)[:, None]
    arcs = [start + RAYS * gap // 24 * np.arange(3) for gap in (3, 5, 6, 8)]
    return np.concatenate(arcs) % RAYS


_TRIPLES = _triples()


@dataclass(frozen=True)
class Circle:
    """A ball's outline: a circle that a wide-angle lens may have stretched away from the image's centre.

    Attributes:
        centre: In px (2,).
        radius: Across the stretch, in px.
        stretch: Length away from the image's centre by length across.
        beyond: By how much the outline is beyond it along each ray (RAYS,), in px, less any stretch.
        roundness: Share of the outline that is the circle's, less what sticks out; at most 1.
    """

    centre: Array
    radius: float
    stretch: float
    beyond: Array
    roundness: float


def fit_circle(points: Array, away: Array, largest: float) -> Circle:
    """The circle on which most of an outline lies, and beyond which nothing lies.

    Where something hides a part of a ball, the rest of the blob's outline lies within the ball's.

    Args:
        points: The outline (RAYS, 2), in px.
        away: From the image's centre to the blob's (2,), in px.
        largest: Largest radius, in px.
    """
    middle = points.mean(0)
    axis = away / max(float(np.hypot(*away)), 1e-9)
    turn = np.array([axis, [-axis[1], axis[0]]])
    turned = (points - middle) @ turn.T
    size = float(np.hypot(*(points - middle).T).mean())
    tolerance = TOLERANCE[0] + TOLERANCE[1] * size
    fits = []
    for stretch in STRETCHES:
        fit = _fit(turned / [stretch, 1.0], largest, tolerance)
        fits.append((fit.cost + STRETCH_COST * (stretch > 1), stretch, fit))
        if fit.cost <= ENOUGH:
            break
    _, stretch, fit = min(fits, key=lambda each: each[0])
    centre = middle + (fit.centre * [stretch, 1.0]) @ turn
    return Circle(centre, fit.radius, stretch, fit.beyond, 1 - fit.cost / RAYS)


class _Fit(NamedTuple):
    """A circle, its cost in rays, and by how much the outline (RAYS,) is beyond it."""

    centre: Array
    radius: float
    cost: float
    beyond: Array


def _fit(flat: Array, largest: float, tolerance: float) -> _Fit:
    """The cheapest circle, by least squares where that will do, else sought through three points each."""
    best = _refined(_near(flat, np.ones(RAYS, bool), tolerance), flat, tolerance)
    if best.cost <= ENOUGH:
        return best
    centres, radii = _through(flat[_TRIPLES])
    fits = radii <= largest
    if not fits.any():
        return best
    centres, radii = centres[fits], radii[fits]
    costs, beyond = _costs(flat, centres, radii, tolerance)
    i = int(costs.argmin())
    found = _refined(_Fit(centres[i], float(radii[i]), float(costs[i]), beyond[i]), flat, tolerance)
    return found if found.cost < best.cost or best.radius > largest else best


def _refined(fit: _Fit, flat: Array, tolerance: float) -> _Fit:
    """The circle nearest to all outline points that lie on a circle, found by going there and back."""
    for _ in range(3):
        on = np.abs(fit.beyond) <= tolerance
        if on.all() or on.sum() < 4:
            break
        better = _near(flat, on, tolerance)
        if better.cost > fit.cost:
            break
        fit = better
    return fit


def _near(flat: Array, on: NDArray[np.bool_], tolerance: float) -> _Fit:
    """The circle nearest to some outline points, by Kåsa's algebraic least squares."""
    points = flat[on]
    middle = points.mean(0)
    x, y = (points - middle).T
    design = np.stack([x, y, np.ones_like(x)], -1)
    normal = design.T @ design + 1e-9 * np.eye(3)
    a, b, c = np.linalg.solve(normal, design.T @ (x * x + y * y))
    centre = middle + np.array([a, b]) / 2
    radius = float(np.sqrt(max(c + (a * a + b * b) / 4, 1e-9)))
    costs, beyond = _costs(flat, centre[None], np.array([radius]), tolerance)
    return _Fit(centre, radius, float(costs[0]), beyond[0])


def _costs(flat: Array, centres: Array, radii: Array, tolerance: float) -> tuple[Array, Array]:
    """For n circles: rays that they do not explain (n,), and distances (n, RAYS) of the outline beyond them.

    A point that sticks out counts up to three times: nothing in front of a ball can do that.
    """
    x = flat[:, 0] - centres[:, :1]
    y = flat[:, 1] - centres[:, 1:]
    beyond = np.sqrt(x * x + y * y) - radii[:, None]
    relative = (beyond / tolerance) ** 2
    return np.minimum(relative, np.where(beyond > 0, 3.0, 1.0)).sum(-1), beyond


def _through(corners: Array) -> tuple[Array, Array]:
    """Centres (n, 2) and radii (n,) of circles through three points each (n, 3, 2)."""
    first = corners[:, 0]
    b, c = corners[:, 1] - first, corners[:, 2] - first
    twice = 2 * (b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0])
    twice = np.where(np.abs(twice) < 1e-9, 1e-9, twice)
    bb, cc = (b * b).sum(-1), (c * c).sum(-1)
    offset = np.stack([c[:, 1] * bb - b[:, 1] * cc, b[:, 0] * cc - c[:, 0] * bb], -1) / twice[:, None]
    return first + offset, np.sqrt((offset * offset).sum(-1))
