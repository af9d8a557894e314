"""How much of a pixel a mark covers, where its outline is, and the circle through that."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from calfree_gym.vision.tracking.blobs import Image

BAND = 2.0
"""Half the width, in px, of the band along a blob's outline whose pixels may be mixed. Choice: the reach of a
blur of 1 px, the usual one."""
NEIGHBOURHOOD = 9
"""Width, in px, of the square in which local colours are averaged. Choice: from the middle of the band it
reaches two pixels beyond."""
NOISE_VARIANCE = 4.0
"""Of a channel. Choice: a noise of 2 levels, so that flat drawings have a covariance too."""
SETTLED = 0.15
"""Pixels that a second look may change, per root of the blob's area. Choice: one in 25 along the outline.
A blob whose outline blur or bright surroundings have moved is looked at once more."""

_UNIT = np.eye(3, dtype=np.float32)

Opacity = NDArray[np.float32]
"""Share of each pixel that the blob covers, (h, w)."""


def opacity(window: Image, mask: Image) -> tuple[Opacity, float]:
    """Which share of each pixel a blob covers, and how clearly it stands out.

    A pixel p of the band between a blob and its surroundings mixes the colours F and B that these have
    nearby. Its share is that of F that explains p best, (F-B)' S (p-B) / (F-B)' S (F-B), where S is the
    inverse covariance of the colours about F and B: what varies anyway, such as brightness, counts little.

    Args:
        window: Image around the blob (h, w, 3).
        mask: 1 within the blob, roughly, and 0 elsewhere (h, w).

    Returns:
        The shares; and the distance between F and B in standard deviations, in the median.
    """
    colours = np.ones((*mask.shape, 4), np.float32)
    colours[..., :3] = window
    shares, contrast = _once(colours, mask)
    again = (shares > 0.5).astype(np.uint8)
    changed = cv2.countNonZero(again ^ mask)
    if contrast == 0 or changed < SETTLED * cv2.countNonZero(mask) ** 0.5:
        return shares, contrast
    return _once(colours, again)


def _once(colours: NDArray[np.float32], mask: Image) -> tuple[Opacity, float]:
    """As `opacity`, of colours (h, w, 4) whose last channel is 1."""
    depth = cv2.distanceTransform(mask, cv2.DIST_L2, 3)
    reach = cv2.distanceTransform(1 - mask, cv2.DIST_L2, 3)
    least = min(BAND + 0.5, 0.6 * float(depth.max()))
    inside = cv2.inRange(depth, least, np.inf)
    outside = cv2.inRange(reach, BAND + 0.5, np.inf)
    band = np.flatnonzero(cv2.bitwise_or(inside, outside) == 0)
    if least == 0 or not outside.any() or not len(band):
        return (inside > 0).astype(np.float32), 0.0
    front, behind = _local_means(colours, inside), _local_means(colours, outside)
    flat = colours.reshape(-1, 4)[:, :3]
    near_out = np.flatnonzero(cv2.inRange(reach, BAND + 0.5, NEIGHBOURHOOD / 2 + BAND))
    near_in = np.flatnonzero(cv2.inRange(depth, least, NEIGHBOURHOOD / 2 + BAND))
    spread = np.concatenate([flat[near_out] - behind[near_out], flat[near_in] - front[near_in]])
    covariance = spread.T @ spread / len(spread) + NOISE_VARIANCE * _UNIT
    behind = behind[band]
    step = front[band] - behind
    weighted = step @ cv2.invert(covariance)[1]
    power = (weighted * step).sum(1)
    part = (weighted * (flat[band] - behind)).sum(1) / np.maximum(power, 1e-6)
    shares = np.multiply(inside, np.float32(1 / 255))
    shares.reshape(-1)[band] = part.clip(0, 1)
    middle = len(band) // 2
    return shares, float(np.partition(power, middle)[middle]) ** 0.5


def _local_means(colours: NDArray[np.float32], where: Image) -> NDArray[np.float32]:
    """Mean colours (h * w, 3) `where` (h, w) around each pixel; where there are none near, of all."""
    chosen = cv2.copyTo(colours, where)
    weak = 1e-4 * np.array(cv2.mean(colours, where))
    size = (NEIGHBOURHOOD, NEIGHBOURHOOD)
    sums = cv2.blur(chosen, size, borderType=cv2.BORDER_CONSTANT) + weak.astype(np.float32)
    sums = sums.reshape(-1, 4)
    return np.asarray(sums[:, :3] / sums[:, 3:], np.float32)


Array = NDArray[np.float64]

RAYS = 48
"""Directions in which the outline is sought. Choice: one for every 4 px of the largest ball's outline."""
STEP = 0.5
"""Between samples along a ray, in px. Choice: an edge is at least 1 px wide."""
_ANGLES = np.arange(RAYS) * (2 * np.pi / RAYS)
_RAYS = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], -1)


def outline(shares: Opacity, centre: Array) -> Array:
    """Where rays from `centre` (2,) last leave a blob: points (RAYS, 2) in px, pixel centres whole."""
    radii = np.arange(0.0, np.hypot(*shares.shape), STEP)
    where = (centre + radii[:, None, None] * _RAYS).astype(np.float32)
    along = cv2.remap(shares, where[..., 0], where[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    last = len(radii) - 1 - (along[::-1] >= 0.5).argmax(0)
    last = np.where((along >= 0.5).any(0), last, 0).clip(0, len(radii) - 2)
    rays = np.arange(RAYS)
    here, beyond = along[last, rays], along[last + 1, rays]
    part = ((here - 0.5) / np.maximum(here - beyond, 1e-6)).clip(0, 1)
    return centre + ((last + part) * STEP)[:, None] * _RAYS


STRETCHES = (1.15, 1.3)
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


def fit_circles(points: Array, away: Array, largest: Array) -> list[Circle]:
    """The circle on which most of each outline lies, and beyond which nothing lies.

    Where something hides a part of a ball, the rest of the blob's outline lies within the ball's.

    Args:
        points: The outlines (n, RAYS, 2), in px.
        away: From the image's centre to each blob's (n, 2), in px.
        largest: Largest radii (n,), in px.
    """
    middle = points.mean(1)
    axis = away / np.maximum(np.hypot(away[:, 0], away[:, 1]), 1e-9)[:, None]
    x, y = np.moveaxis(points - middle[:, None], -1, 0)
    cosine, sine = axis[:, :1], axis[:, 1:]
    along, across = x * cosine + y * sine, y * cosine - x * sine
    tolerance = TOLERANCE[0] + TOLERANCE[1] * np.hypot(x, y).mean(1)
    best = _fit(along, across, largest, tolerance)
    stretches, prices = np.ones(len(points)), best.cost.copy()
    left = np.flatnonzero(best.cost > ENOUGH)
    for stretch in STRETCHES:
        fit = _fit(along[left] / stretch, across[left], largest[left], tolerance[left])
        better = fit.cost + STRETCH_COST < prices[left]
        which = left[better]
        best.put(which, fit.of(better))
        stretches[which], prices[which] = stretch, fit.cost[better] + STRETCH_COST
        left = left[fit.cost > ENOUGH]
    a, b = best.centre[:, 0] * stretches, best.centre[:, 1]
    centre = middle + a[:, None] * axis + b[:, None] * np.stack([-axis[:, 1], axis[:, 0]], -1)
    found = zip(centre, best.radius, stretches, best.beyond, 1 - best.cost / RAYS, strict=True)
    return [Circle(*each) for each in found]


class _Fit(NamedTuple):
    """Circles (n,), their costs in rays, and by how much each outline (n, RAYS) is beyond its circle."""

    centre: Array
    radius: Array
    cost: Array
    beyond: Array

    def of(self, which: NDArray[Any]) -> _Fit:
        """Some of them."""
        return _Fit(*(each[which] for each in self))

    def put(self, where: NDArray[Any], others: _Fit) -> None:
        """Puts others in the places of some."""
        for each, other in zip(self, others, strict=True):
            each[where] = other


def _fit(x: Array, y: Array, largest: Array, tolerance: Array) -> _Fit:
    """The cheapest circles, by least squares where that will do, else sought through three points each.

    Args:
        x: The outlines (n, RAYS), in px.
        y: Likewise.
        largest: Largest radii (n,), in px.
        tolerance: See `TOLERANCE` (n,), in px.
    """
    best = _refined(_near(x, y, np.ones(x.shape, bool), tolerance), x, y, tolerance)
    hard = np.flatnonzero(best.cost > ENOUGH)
    x, y, largest, tolerance = x[hard], y[hard], largest[hard], tolerance[hard]
    centres, radii = _through(x[:, _TRIPLES], y[:, _TRIPLES])
    costs, beyond = _costs(x[:, None], y[:, None], centres, radii, tolerance[:, None])
    costs[radii > largest[:, None]] = np.inf
    of, i = np.arange(len(hard)), costs.argmin(1)
    found = _Fit(centres[of, i], radii[of, i], costs[of, i], beyond[of, i])
    found = _refined(found, x, y, tolerance)
    better = (found.cost < best.cost[hard]) | ((best.radius[hard] > largest) & np.isfinite(found.cost))
    best.put(hard[better], found.of(better))
    return best


def _refined(fit: _Fit, x: Array, y: Array, tolerance: Array) -> _Fit:
    """The circles nearest to all outline points that lie on a circle, found by going there and back."""
    left = np.flatnonzero(np.isfinite(fit.cost))
    for _ in range(3):
        on = np.abs(fit.beyond[left]) <= tolerance[left, None]
        count = on.sum(1)
        some = (count < RAYS) & (count >= 4)
        left = left[some]
        nearer = _near(x[left], y[left], on[some], tolerance[left])
        better = nearer.cost <= fit.cost[left]
        left = left[better]
        fit.put(left, nearer.of(better))
    return fit


def _near(x: Array, y: Array, on: NDArray[np.bool_], tolerance: Array) -> _Fit:
    """The circles nearest to some points `on` (n, RAYS) outlines, by Kåsa's algebraic least squares."""
    count = on.sum(1)
    middle = np.stack([(x * on).sum(1), (y * on).sum(1)], -1) / count[:, None]
    u, v = (x - middle[:, :1]) * on, (y - middle[:, 1:]) * on
    squares = u * u + v * v
    uu, uv, vv = (u * u).sum(1) + 1e-9, (u * v).sum(1), (v * v).sum(1) + 1e-9
    uz, vz = (u * squares).sum(1), (v * squares).sum(1)
    offset = np.stack([uz * vv - vz * uv, vz * uu - uz * uv], -1) / (2 * (uu * vv - uv * uv))[:, None]
    radius = np.sqrt(squares.sum(1) / count + (offset * offset).sum(1))
    centre = middle + offset
    return _Fit(centre, radius, *_costs(x, y, centre, radius, tolerance))


def _costs(x: Array, y: Array, centres: Array, radii: Array, tolerance: Array) -> tuple[Array, Array]:
    """Rays that circles (...) do not explain (...), and distances (..., RAYS) of the outline beyond them.

    A point that sticks out counts up to three times: nothing in front of a ball can do that.
    """
    beyond = np.sqrt((x - centres[..., :1]) ** 2 + (y - centres[..., 1:]) ** 2) - radii[..., None]
    relative = (beyond / tolerance[..., None]) ** 2
    return np.minimum(relative, np.where(beyond > 0, 3.0, 1.0)).sum(-1), beyond


def _through(x: Array, y: Array) -> tuple[Array, Array]:
    """Centres (..., 2) and radii (...) of circles through three points (..., 3) each."""
    bx, cx, by, cy = (each[..., i] - each[..., 0] for each in (x, y) for i in (1, 2))
    twice = 2 * (bx * cy - by * cx)
    twice = np.where(np.abs(twice) < 1e-9, 1e-9, twice)
    bb, cc = bx * bx + by * by, cx * cx + cy * cy
    offset = np.stack([cy * bb - by * cc, bx * cc - cx * bb], -1) / twice[..., None]
    return np.stack([x[..., 0], y[..., 0]], -1) + offset, np.hypot(offset[..., 0], offset[..., 1])
