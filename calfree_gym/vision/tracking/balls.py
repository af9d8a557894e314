"""Balls: a blob's place and size, and whether it is a ball at all."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calfree_gym.vision.marks import Mark, hue_gap
from calfree_gym.vision.tracking.blobs import SATURATION_SHARE, Blob, hues_and_saturations
from calfree_gym.vision.tracking.outlines import Array, Opacity, fit_circle, opacity, outline

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


def measure_ball(blob: Blob, mark: Mark, size: tuple[int, int]) -> Ball | None:
    """The ball that a blob is, or None where it is none.

    Args:
        blob: Of the mark's colour, roughly.
        mark: Its colour.
        size: Width and height of the image in px.
    """
    shares, contrast = opacity(blob.window, blob.mask)
    area = float(shares.sum())
    least = max(LEAST_RADIUS[0], LEAST_RADIUS[1] * min(size))
    clear = min((area / np.pi) ** 0.5 / CLEAR_RADIUS, 1.0)
    if area < np.pi * least**2 or contrast < LEAST_CONTRAST * clear:
        return None
    colour = covered(blob, shares)
    if not has_colour(colour, mark, float(np.interp(clear, (0.5, 1), BALL_SATURATION))):
        return None
    rows, columns = np.indices(shares.shape)
    centroid = np.array([(shares * columns).sum(), (shares * rows).sum()]) / area
    corner = np.array(blob.corner) + 0.5
    largest = LARGEST_RADIUS * min(size)
    circle = fit_circle(outline(shares, centroid), centroid + corner - np.array(size) / 2, largest)
    disc = np.pi * circle.radius**2 * circle.stretch
    seen = min(area / disc, 1.0)
    least_roundness = np.interp(clear, (0.5, 1), LEAST_ROUNDNESS)
    if circle.roundness < least_roundness or seen < LEAST_SEEN or circle.radius > largest:
        return None
    if not _is_sure(circle.roundness, area) and not _stands_alone(blob, shares, mark, colour):
        return None
    if np.quantile(-circle.beyond, 0.9) <= WHOLE[0] + WHOLE[1] * circle.radius:
        return Ball(centroid + corner, area, circle.roundness, seen)
    centre = circle.centre + corner
    if (centre < 0).any() or (centre > size).any():
        return None
    return Ball(centre, disc, circle.roundness, seen)


def _is_sure(roundness: float, area: float) -> bool:
    return roundness >= SURE_ROUNDNESS and area >= np.pi * (SURE_SIZE * CLEAR_RADIUS) ** 2


def covered(blob: Blob, shares: Opacity) -> NDArray[np.float64]:
    """Mean colour (3,) of the pixels that the blob covers."""
    mean: NDArray[np.float64] = blob.window[shares > min(0.9, 0.9 * float(shares.max()))].mean(0)
    return mean


def has_colour(colour: NDArray[np.float64], mark: Mark, saturation_share: float) -> bool:
    """Whether a colour (3,) is the mark's, and has this share of its saturation."""
    hue, saturation = hues_and_saturations(colour)
    fits = hue_gap(float(hue), mark.hue) <= mark.hue_tolerance
    return bool(fits and saturation >= saturation_share * mark.saturation)


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
    alike = np.abs((hues - mark.hue + 180) % 360 - 180) <= mark.hue_tolerance + ALIKE_HUE
    alike &= (saturations >= SATURATION_SHARE * mark.saturation) & (np.ptp(ring, -1) >= chroma / 2)
    return bool(alike.sum() <= MOST_ALIKE * len(ring))
