"""How much of a pixel a mark covers, where its outline is, and the circle through that."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

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
    front, behind = _local_sums(colours, inside), _local_sums(colours, outside)
    flat = colours.reshape(-1, 4)
    near_out = np.flatnonzero(cv2.inRange(reach, BAND + 0.5, NEIGHBOURHOOD / 2 + BAND))
    near_in = np.flatnonzero(cv2.inRange(depth, least, NEIGHBOURHOOD / 2 + BAND))
    spread = np.concatenate([_differences(flat, behind, near_out), _differences(flat, front, near_in)])
    covariance = spread.T @ spread / len(spread) + NOISE_VARIANCE * np.eye(3, dtype=np.float32)
    beyond = _differences(flat, behind, band)
    step = beyond - _differences(flat, front, band)
    weighted = step @ np.linalg.inv(covariance)
    power = np.einsum("ij,ij->i", weighted, step)
    part = np.einsum("ij,ij->i", weighted, beyond) / np.maximum(power, 1e-6)
    shares = np.multiply(inside, np.float32(1 / 255))
    shares.reshape(-1)[band] = part.clip(0, 1)
    return shares, float(np.sqrt(np.median(power)))


def _local_sums(colours: NDArray[np.float32], where: Image) -> NDArray[np.float32]:
    """Sums (h * w, 4), weighted alike, of the colours `where` (h, w) around each pixel."""
    chosen = cv2.copyTo(colours, where)
    weak = 1e-4 * np.array(cv2.mean(colours, where), np.float32)
    size = (NEIGHBOURHOOD, NEIGHBOURHOOD)
    return (cv2.blur(chosen, size, borderType=cv2.BORDER_CONSTANT) + weak).reshape(-1, 4)


def _differences(
    colours: NDArray[np.float32], sums: NDArray[np.float32], pixels: NDArray[np.intp]
) -> NDArray[np.float32]:
    """Colours (n, 3) of some pixels less the local means that `_local_sums` leads to."""
    near = sums.take(pixels, 0)
    return colours.take(pixels, 0)[:, :3] - near[:, :3] / near[:, 3:]


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
