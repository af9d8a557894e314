"""Images and their units: image points lie in [-1, 1], x right, y down; ±1 is the image's border."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

CAMERAS = ("left", "right")
"""The stereo pair, in the order in which every array holds them."""
IMAGE_SIZE = 512
"""Width and height of an image in pixels."""
IMAGE_UNIT = 2 / IMAGE_SIZE
"""A pixel in image units."""


def lengths_px(vectors: NDArray[np.float64]) -> Any:
    """Lengths (...) in pixels of vectors (..., 2) in image units."""
    return np.hypot(vectors[..., 0], vectors[..., 1]) / IMAGE_UNIT
