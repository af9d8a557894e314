"""A knowledge base, and beside it what should be seen at given registers."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import IMAGE_UNIT

from ..base.observation import Array, camera_lengths_px
from ..base.storage import prefixed, under
from ..knowledge.gaussian_process import GaussianProcess
from ..knowledge.interface import Knowledge
from .arm_change import ArmChange
from .camera_change import CameraChange
from .home_view import HomeView
from .pairs import Pairs

Arrays = Mapping[str, NDArray[Any]]


class KnowledgeWithViews:
    """Recall goes from sensors to registers; to notice a change, the way back is needed as well.

    Attributes:
        knowledge: The knowledge base.
        views: What should be seen where: the knowledge base itself if it can tell, else a Gaussian process
            that learns the same pairs.

    Args:
        knowledge: The knowledge base.
        motors: Number of registers m.
    """

    def __init__(self, knowledge: Knowledge, motors: int) -> None:
        self.knowledge = knowledge
        self.views = knowledge if isinstance(knowledge, GaussianProcess) else GaussianProcess(motors)
        self._stores: tuple[Knowledge, ...] = (
            (knowledge,) if self.views is knowledge else (knowledge, self.views)
        )

    def learn(self, pairs: Pairs) -> None:
        """Takes in pairs, one after the other."""
        for store in self._stores:
            for registers, sensors in zip(pairs.registers, pairs.sensors, strict=True):
                store.learn(sensors, registers)

    def map(self, changes: Sequence[CameraChange] | Sequence[ArmChange]) -> None:
        """Maps all that is stored by each of the changes."""
        for change in changes:
            for store in self._stores:
                store.map(change, change.deviation_px)

    def errors(self, pairs: Pairs) -> tuple[Array, Array]:
        """How far pairs are from what should be seen there.

        Returns:
            Errors (n, 2) in each camera, in pixels, and the same in units of their standard deviation.
        """
        expected, variances = self.views.views(pairs.registers)
        errors_px = camera_lengths_px(pairs.sensors - expected)
        return errors_px, errors_px / np.sqrt(variances / IMAGE_UNIT**2 + GaussianProcess.NOISE_PX**2)

    def agrees_with(self, pairs: Pairs, other: Self) -> bool:
        """Whether most pairs are seen where they should be, and on average nearer there than by `other`.

        Most may agree with both: a motor that has reversed shows only where it has moved.
        """
        (errors_px, _), (by_other_px, _) = self.errors(pairs), other.errors(pairs)
        agrees = np.median(errors_px) < HomeView.SIGMAS * GaussianProcess.NOISE_PX
        return bool(agrees and errors_px.mean() < by_other_px.mean())

    def copy_of(self, arrays: Arrays) -> Self:
        """A second one that knows what `arrays` returned."""
        other = copy.deepcopy(self)
        other.restore(arrays)
        return other

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All that it knows, as named arrays."""
        known = self.knowledge.arrays()
        return known if len(self._stores) == 1 else known | prefixed("views", self.views.arrays())

    def restore(self, arrays: Arrays) -> None:
        """Takes over what `arrays` returned; raises ValueError where it does not fit."""
        self.knowledge.restore(arrays)
        if len(self._stores) > 1:
            self.views.restore(under("views", arrays))
