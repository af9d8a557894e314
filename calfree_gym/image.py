"""Images and their units: image points lie in [-1, 1], x right, y down; ±1 is the image's border."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

CAMERAS = ("left", "right")
"""Names of the two cameras, in the order in which every array holds them."""
IMAGE_SIZE = 512
"""Width and height of an image in pixels."""
PIXELS_PER_UNIT = IMAGE_SIZE / 2
"""Pixels in one image unit."""
IMAGE_UNIT = 1 / PIXELS_PER_UNIT
"""One pixel in image units."""


def lengths(vectors: NDArray[Any]) -> NDArray[Any]:
    """Euclidean lengths (...) of vectors (..., 2), in the vectors' own unit and dtype."""
    squares = vectors * vectors
    return np.sqrt(squares[..., 0] + squares[..., 1])


def lengths_px(vectors: NDArray[np.float64]) -> Any:
    """Euclidean lengths (...) in pixels of vectors (..., 2) in image units."""
    return np.hypot(vectors[..., 0], vectors[..., 1]) / IMAGE_UNIT


def inside(points: NDArray[Any], margin_px: float = 0.0) -> NDArray[np.bool_]:
    """Which image points (..., 2) lie at least `margin_px` inside the image (...)."""
    far = np.abs(points)
    return np.maximum(far[..., 0], far[..., 1]) <= 1 - margin_px * IMAGE_UNIT
