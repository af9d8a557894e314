"""Balls: a blob's place and size, and whether it is a ball at all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import compress
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from calfree_gym.vision.marks import Mark, hue_gap
from calfree_gym.vision.tracking.blobs import SATURATION_SHARE, Blob, hues_and_saturations
from calfree_gym.vision.tracking.outlines import Array, Opacity, fit_circles, opacity, outline

CLEAR_RADIUS = 4.0
"""In px: balls from here on look clear, smaller ones lose colour and contrast to their surroundings. Measured
on drawn frames with JPEG of quality 50 to 95."""
BALL_SATURATION = (0.6, 0.75)
"""Least saturation of a ball's mean colour, as a share of its mark's: of the smallest balls, of clear ones.
Measured on drawn frames: 0.79 in the worst of 573 clear balls; 0.6 is that of a mark's pixels."""
LEAST_CONTRAST = 4.0
"""Between a clear ball and its surroundings, in standard deviations; smaller balls need less in proportion.
Measured: 5.4 of a ball of 9 px in a dark and noisy rendered image; 6 is no better against false points."""
LEAST_ROUNDNESS = (0.6, 0.3)
"""Of the smallest balls and of clear ones. Choice: a prototype with strict roundness lost 8 % of the trials
to balls that the gripper hides in part; the smallest ones are too coarse to bear 0.3."""
LEAST_SEEN = 0.4
"""Share of a ball's disc. Choice: on drawn frames, centres of balls that show less are up to 6 px off."""
LEAST_RADIUS = (0.8, 0.005)
"""In px, and as a share of the image's smaller side; the larger counts. Choice: two pixels, for a speck of
noise is one; and in 512 less than two thirds of the smallest ball's 4 px."""
LARGEST_RADIUS = 0.09
"""As a share of the image's smaller side. Choice: half as large again as a ball of 30 px in 512."""
SURE_ROUNDNESS = 0.85
"""From here on a ball needs no further proof. Measured on drawn frames: three quarters of 573 clear whole
balls have more."""
SURE_SIZE = 0.75
"""As a share of `CLEAR_RADIUS`, for the same. Choice: 3 px, for any smaller spot is round."""
LEAST_BRIGHTNESS = 0.2
"""Difference between the channels of a ball's mean colour, as a share of the brightest value near it.
Choice: a ball in a quarter of the light beside white has 0.22; the fringes that JPEG makes are fainter."""
ALIKE_HUE = 25.0
"""In degrees beyond a mark's tolerance: what a blend may come from. Choice: with the default marks red and
violet, not the other marks."""
MOST_ALIKE = 0.3
"""Share of a ball's surroundings that may be nearly of its colour. Choice: beside a straight edge half is."""
WHOLE = (0.3, 0.05)
"""How far, in px and in radii, a tenth of the outline may lie within the circle where nothing hides the ball.
Choice: of fifteen such limits on drawn frames, one that serves whole balls and hidden ones alike."""


@dataclass(frozen=True)
class Ball:
    """A ball in an image.

    Attributes:
        centre: In px from the image's upper left corner (2,).
        area: Of its whole disc, in px².
        roundness: Share of its blob's outline that is a circle's, 1 where nothing hides it.
        seen: Share of its disc that is seen.
    """

    centre: Array
    area: float
    roundness: float
    seen: float

    @property
    def is_sure(self) -> bool:
        """Whether it needs no further proof: it is round, and not small."""
        return _is_sure(self.roundness, self.area)


class _Spot(NamedTuple):
    """What stands out: which blob, its share of each pixel, its area and colour, and how clear it is."""

    number: int
    shares: Opacity
    area: float
    colour: Array
    clear: float


def measure_balls(blobs: Sequence[Blob], marks: Sequence[Mark]) -> list[Ball | None]:
    """The balls that blobs (n,) are, roughly of the colours of marks (n,); None where one is none.

    Many together take less time, and are what each is alone.
    """
    balls: list[Ball | None] = [None] * len(blobs)
    spots = _coloured(list(_spots(blobs)), marks)
    if not spots:
        return balls
    sizes = np.array([blobs[spot.number].image_size for spot in spots])
    corners = np.array([blobs[spot.number].corner for spot in spots]) + 0.5
    centroids = np.array([_centroid(spot.shares) for spot in spots])
    points = np.stack([outline(spot.shares, at) for spot, at in zip(spots, centroids, strict=True)])
    largest = LARGEST_RADIUS * sizes.min(1)
    circles = fit_circles(points, centroids + corners - sizes / 2, largest)
    roundness = np.interp([spot.clear for spot in spots], (0.5, 1), LEAST_ROUNDNESS)
    within = np.quantile([-circle.beyond for circle in circles], 0.9, axis=1)
    for i, (spot, circle) in enumerate(zip(spots, circles, strict=True)):
        disc = np.pi * circle.radius**2 * circle.stretch
        seen = min(spot.area / disc, 1.0)
        if circle.roundness < roundness[i] or seen < LEAST_SEEN or circle.radius > largest[i]:
            continue
        blob, mark = blobs[spot.number], marks[spot.number]
        if not _is_sure(circle.roundness, spot.area) and not _stands_alone(
            blob, spot.shares, mark, spot.colour
        ):
            continue
        whole = within[i] <= WHOLE[0] + WHOLE[1] * circle.radius
        centre, area = (centroids[i], spot.area) if whole else (circle.centre, disc)
        centre = centre + corners[i]
        if whole or ((centre >= 0) & (centre <= sizes[i])).all():
            balls[spot.number] = Ball(centre, area, circle.roundness, seen)
    return balls


def _spots(blobs: Sequence[Blob]) -> Iterator[_Spot]:
    """Those blobs that are large enough, and stand out."""
    for number, blob in enumerate(blobs):
        shares, contrast = opacity(blob.window, blob.mask)
        area = float(shares.sum())
        least = max(LEAST_RADIUS[0], LEAST_RADIUS[1] * min(blob.image_size))
        clear = min((area / np.pi) ** 0.5 / CLEAR_RADIUS, 1.0)
        if area >= np.pi * least**2 and contrast >= LEAST_CONTRAST * clear:
            yield _Spot(number, shares, area, covered(blob, shares), clear)


def _coloured(spots: list[_Spot], marks: Sequence[Mark]) -> list[_Spot]:
    """Those spots that have their marks' colours."""
    if not spots:
        return []
    least = np.interp([spot.clear for spot in spots], (0.5, 1), BALL_SATURATION)
    colours, theirs = np.array([spot.colour for spot in spots]), [marks[spot.number] for spot in spots]
    return list(compress(spots, have_colours(colours, theirs, least)))


def _centroid(shares: Opacity) -> Array:
    moments = cv2.moments(shares)
    return np.array([moments["m10"], moments["m01"]]) / moments["m00"]


def _is_sure(roundness: float, area: float) -> bool:
    return roundness >= SURE_ROUNDNESS and area >= np.pi * (SURE_SIZE * CLEAR_RADIUS) ** 2


def covered(blob: Blob, shares: Opacity) -> NDArray[np.float64]:
    """Mean colour (3,) of the pixels that the blob covers."""
    mean: NDArray[np.float64] = blob.window[shares > min(0.9, 0.9 * float(shares.max()))].mean(0)
    return mean


def have_colours(
    colours: NDArray[np.float64], marks: Sequence[Mark], saturation_shares: Array | float
) -> NDArray[np.bool_]:
    """Which colours (n, 3) are their marks' (n,), and have these shares (n,) of their saturation."""
    hues, saturations = hues_and_saturations(colours)
    own, widths, least = np.array([(m.hue, m.hue_tolerance, m.saturation) for m in marks]).T
    fits = hue_gap(hues, own) <= widths
    return np.asarray(fits & (saturations >= saturation_shares * least))


def _stands_alone(blob: Blob, shares: Opacity, mark: Mark, colour: NDArray[np.float64]) -> bool:
    """Whether a spot is bright enough to be no JPEG fringe, and is not a part of something larger.

    Where two things of other colours meet, their blend may have the mark's hue; a spot of such a blend, or of
    a larger thing of the mark's colour, touches much that is nearly of its colour.
    """
    chroma = np.ptp(colour)
    if chroma < LEAST_BRIGHTNESS * blob.window.max():
        return False
    inner = cv2.dilate((shares > 0.5).astype(np.uint8), np.ones((5, 5), np.uint8))
    ring = blob.window[cv2.dilate(inner, np.ones((7, 7), np.uint8)) > inner]
    hues, saturations = hues_and_saturations(ring)
    alike = hue_gap(hues, mark.hue) <= mark.hue_tolerance + ALIKE_HUE
    alike &= (saturations >= SATURATION_SHARE * mark.saturation) & (np.ptp(ring, -1) >= chroma / 2)
    return bool(alike.sum() <= MOST_ALIKE * len(ring))
