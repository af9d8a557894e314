"""Where the gripper goes before it descends: above the object, however that is told (paper, 3.4)."""

from __future__ import annotations

import numpy as np

from calfree_gym.image import IMAGE_UNIT

from ..base.observation import Array, Flags
from .observation import BASE, OBJECT, TIP, GraspObservation

INTERMEDIATE = ("along_axis", "pixel_offset")
OFFSET_PX = 64.0
"""Of the paper's offset: about the gripper's length above the object, in the built robot."""


def target(kind: str, now: GraspObservation, share: float) -> tuple[Array, Flags]:
    """Where the tip should be (2, 2), left and right, to be a share of the way before the object.

    "along_axis": one gripper length from the object along the gripper's axis, which the paper proposes, and
    which needs to know nothing of the cameras: both ends of that length are seen. "pixel_offset": as many
    pixels above it in each image, which the paper did: y is taken for "down".

    Args:
        kind: One of `INTERMEDIATE`.
        now: What is seen.
        share: 1 at the intermediate position, 0 at the object.

    Returns:
        It, and whether (2,) all of which it follows is seen now.
    """
    points, visible = now.points, now.visible
    if kind == "along_axis":
        seen = np.asarray(visible[[TIP, BASE, OBJECT]].all(0))
        return points[OBJECT] + share * (points[BASE] - points[TIP]), seen
    return points[OBJECT] - share * OFFSET_PX * IMAGE_UNIT * np.array([0.0, 1.0]), visible[OBJECT]
