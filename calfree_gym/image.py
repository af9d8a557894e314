"""Images and their units: image points lie in [-1, 1], x right, y down; ±1 is the image's border.

Points are in halves of the image's longer side, so that lengths are alike along both axes: of 640 × 480
pixels, y ends at ±0.75. Where images end is told by the bounds of an environment's `achieved_goal`.

Also which numbers are equal but for rounding: kernels of linear algebra differ in the last bits, and nothing
may be chosen by these.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

CAMERAS = ("left", "right")
"""Names of the two cameras, in the order in which every array holds them."""
IMAGE_SIZE = 512
"""Width and height of an image in pixels."""
PIXELS_PER_UNIT = IMAGE_SIZE / 2
"""Pixels in one image unit."""
IMAGE_UNIT = 1 / PIXELS_PER_UNIT
"""One pixel in image units."""
LOOK_SECONDS = 4.0
"""Assumed seconds in which the arm settles and the vision system delivers still image points. With this
value a reach by test motions takes most of the paper's 50 s a grasp, and one learned motion a few seconds."""
BITS = 20
"""Of numbers that are compared. Choice: a millionth, far above rounding, and below what matters."""
RANK, RANK_OF_SQUARES = 1e-9, 1e-12
"""Singular values of a matrix below this share of the largest are none, and eigenvalues of sums of squares.
Choice: far above what rounding leaves of zeros, and below what motions and images show."""
PERPENDICULAR = 1e-5
"""Vectors whose cosine is no larger are perpendicular. Measured: rounding leaves up to 4e-6, as registers
are in single precision, and no other of 1,200 was below 1e-5 (`unified_servo`, wild worlds 7000 to 7011)."""


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


def rounded(values: ArrayLike) -> Any:
    """Values of any shape to six digits: among equals the first one is then the least or the largest.

    Sort them with `kind="stable"`.
    """
    mantissas, exponents = np.frexp(values)
    return np.ldexp(np.round(mantissas * 2**BITS), exponents - BITS)


def inner(first: NDArray[Any], second: NDArray[Any]) -> float:
    """The inner product of two vectors (n,), whose sign can be trusted: 0 where they are perpendicular."""
    product = float(first @ second)
    largest = np.sqrt((first @ first) * (second @ second))
    return product if abs(product) > PERPENDICULAR * largest else 0.0
