"""Grasping: hold the object, and lift it to a place in both images (paper, 3.1 and 3.5)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import IMAGE_UNIT, lengths
from calfree_gym.tasks.goals import Floats, image_distances

BLOCKED = 0.06
"""Jaws that stay open by this share more than they were told have something between them. Choice: on nothing
they close to a hundredth."""
MOVED = 8 * IMAGE_UNIT
"""The gripper has moved where its image point has moved so far, in one image. Choice: ten times the noise."""
ALIKE = 0.5
"""The object has moved with it where their image points differ by less than this share of the way. Derived: a
thing that stays differs by all of it, one that goes with it by none."""


def blocked(opening: Floats, register: Floats) -> Floats:
    """Whether (...) something is between jaws, by how far they are open (share), and their register (...)."""
    return opening - (1 - register) > BLOCKED


def held(blocked: Floats, before: Floats, gripper_way: Floats, object_way: Floats, seen: Floats) -> Floats:
    """Whether (N,) the gripper holds the object, as jaws and images tell.

    Where the gripper has hardly moved, or not all is seen, as before.

    Args:
        blocked: Whether (N,) something is between its jaws.
        before: Whether (N,) it held it before.
        gripper_way: Of its image points (N, 2, 2) in the last motion.
        object_way: Of the object's (N, 2, 2).
        seen: Whether (N,) all four were seen before and after.
    """
    far = np.maximum.reduce(lengths(gripper_way), -1)
    apart = np.maximum.reduce(lengths(object_way - gripper_way), -1)
    return blocked & np.where(seen & (far > MOVED), apart < ALIKE * far, before)


def place_distances(achieved: Floats, desired: Floats) -> Floats:
    """Distances (..., 2) in image units, per camera, of the object from where it is to be lifted to.

    Args:
        achieved: The object's sensor vector, and whether it is held (..., 5).
        desired: The wanted one, and 1 (..., 5).
    """
    return image_distances(achieved[..., :4], desired[..., :4])


def lifted(
    distances: Floats, achieved: Floats, desired: Floats, tolerance: float | np.float32
) -> NDArray[Any]:
    """Whether (...) the object is held, within `tolerance` of the wanted place in both images.

    Args:
        distances: What `place_distances` tells (..., 2).
        achieved: See `place_distances`.
        desired: See `place_distances`.
        tolerance: In image units.
    """
    near = np.maximum.reduce(distances, axis=-1) <= tolerance
    return near & (np.abs(achieved[..., 4] - desired[..., 4]) < 0.5)
