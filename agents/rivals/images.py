"""What a regression says of image points, for an agent that goes by it."""

from collections.abc import Mapping
from typing import Any, ClassVar, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import IMAGE_UNIT

from ..base.observation import Array
from .looks import RegressionLooks


class ImageRegression(Protocol):
    """Predicts image points by registers and by where the object is seen from home.

    Attributes:
        misfit_px: Standard deviation of what its basis cannot fit, in pixels.
    """

    misfit_px: ClassVar[float]

    def copy(self) -> Self:
        """One that learns on for itself."""

    def learn(self, looks: RegressionLooks) -> None:
        """Learns from looks."""

    def points(self, registers: Array, home: Array) -> Array:
        """Sensor vectors (n, 2, 4) of gripper and object at registers (n, m).

        Args:
            registers: Of n places.
            home: The object's sensor vector (4,) at home.
        """

    def variances(self, registers: Array, origin: Array, home: Array) -> Array:
        """Variances (n, 2, 4) of how sensor vectors at registers (n, m) differ from those at `origin`."""

    def distance_variances(self, registers: Array, origin: Array, home: Array) -> Array:
        """Variances (n, 4) of how the image distance differs."""

    def arrays(self) -> dict[str, NDArray[Any]]:
        """What it has learned, as named arrays."""

    def restore(self, arrays: Mapping[str, NDArray[Any]], looks: RegressionLooks) -> None:
        """Takes over what `arrays` returned after these looks; raises ValueError where it does not fit."""


def look_variances(looks: RegressionLooks, misfit_px: float) -> Array:
    """Variances (n, 2) of gripper's and object's coordinates; the object's home view is as noisy again."""
    one = (np.square(looks.noise_px) + misfit_px**2) * IMAGE_UNIT**2
    return np.stack([one, 2 * one], 1)


def coordinates(camera: int) -> slice:
    """Which coordinates of a sensor vector are a camera's."""
    return slice(2 * camera, 2 * camera + 2)
