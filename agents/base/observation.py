"""What a controller observes once the arm has settled, in the one layout that all agents share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import lengths_px

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
RawObservation = Mapping[str, NDArray[Any]]
"""As the environment returns it, of one arm or of several."""

POINTS = 4
"""Gripper left, gripper right, object left, object right: the order of points and of visibility flags."""
STANDARD_KEYS = ("achieved_goal", "desired_goal", "observation")
"""What every controller gets. All other keys are privileged: asked for by `tell=`."""


def privileged_in(raw: RawObservation) -> dict[str, Array]:
    """What was asked for by `tell=`, by name."""
    return {name: np.asarray(raw[name], float) for name in raw if name not in STANDARD_KEYS}


@dataclass(frozen=True)
class Observation:
    """Image points, flags and registers after one motion.

    Attributes:
        points: Image points (4, 2) in image units: gripper left, right, object left, right.
        visible: Which of them are seen now (4,).
        registers: Executed sums of control words since home (m,).
        privileged: What was asked for by `tell=`, by name.
        last: Whether the trial is known to be over with it.
    """

    points: Array
    visible: Flags
    registers: Array
    privileged: Mapping[str, Array] = field(default_factory=dict)
    last: bool = False

    @classmethod
    def of(cls, raw: RawObservation) -> Observation:
        """Reads one environment's observation."""
        rest = np.asarray(raw["observation"], float)
        points = np.concatenate([raw["achieved_goal"], raw["desired_goal"]], dtype=float)
        return cls(
            points=points.reshape(POINTS, 2),
            visible=rest[:POINTS] > 0.5,
            registers=rest[POINTS:],
            privileged=privileged_in(raw),
        )

    def estimated(self, points: Array, visible: Flags) -> Observation:
        """The same observation with points (4, 2) and flags (4,) as they are estimated."""
        return replace(self, points=points, visible=visible)

    @property
    def gripper(self) -> Array:
        """The gripper's sensor vector (4,), a view."""
        return self.points[:2].reshape(4)

    @property
    def object(self) -> Array:
        """The object's sensor vector (4,), a view."""
        return self.points[2:].reshape(4)

    @property
    def shows_gripper(self) -> bool:
        """Whether both cameras see it."""
        return bool(self.visible[:2].all())

    @property
    def shows_object(self) -> bool:
        """Whether both cameras see it."""
        return bool(self.visible[2:].all())

    @property
    def distance(self) -> Array:
        """The image distance d (4,): gripper point minus object point, in sensor space."""
        return (self.points[:2] - self.points[2:]).reshape(4)

    @property
    def distance_px(self) -> float:
        """The length of d in pixels, in the image where it is longer."""
        return float(lengths_px(self.points[:2] - self.points[2:]).max())


def camera_lengths_px(differences: Array) -> Array:
    """Lengths (..., 2), in each camera and in pixels, of differences of sensor vectors (..., 4)."""
    return np.asarray(lengths_px(differences.reshape(*differences.shape[:-1], 2, 2)))
