"""Reaching: bring the gripper point to the object point in both images, and so in the world (paper, 3.1)."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import IMAGE_SIZE, lengths

Floats = NDArray[Any]
MOST_TOLERANCE = IMAGE_SIZE // 2
"""A tolerance is less, in pixels: what is hidden is shown farther away than that, and yet in the image."""
NEAR = 1.01
"""What is hidden and this many tolerances away may show a rendezvous in single precision."""
BEYOND = 1.1
"""A hidden point that showed a rendezvous is shown this many tolerances away (a guard: in single precision,
too, it is none)."""


def rendezvous(distances: Floats, tolerance: float | np.float32) -> Floats:
    """Whether (...) both cameras see gripper and object within `tolerance`, in image units."""
    return np.maximum(distances[..., 0], distances[..., 1]) <= tolerance


def kept_apart(points: Floats, visible: Floats, tolerance: float) -> Floats:
    """Points (N, 4, 2) of which none that is hidden shows a rendezvous by where it was seen last.

    Where one would, it is moved to just beyond the tolerance, in one image: so reward and end follow from the
    points alone, and need all of them to be seen now.

    Args:
        points: Gripper left and right, object left and right, in image units.
        visible: Which of them are seen now (N, 4).
        tolerance: Of the rendezvous, in image units.
    """
    if visible.all():
        return points
    near = rendezvous(lengths(points[:, :2] - points[:, 2:]), NEAR * tolerance)
    if not (mistaken := near & ~visible.all(1)).any():
        return points
    points = points.copy()
    for row in np.flatnonzero(mistaken):
        hidden = int(np.flatnonzero(~visible[row])[0])
        other = points[row, (hidden + 2) % 4]
        away = np.where(other > 0, -1.0, 1.0) / np.sqrt(2)  # towards the middle: never out of the image
        points[row, hidden] = other + BEYOND * tolerance * away
    return points
