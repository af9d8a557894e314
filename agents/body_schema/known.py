"""A chain of joints as far as it is known: what it explains, and what it leads one to expect."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import CAMERAS, IMAGE_UNIT

from ..base.checks import checked_array
from ..base.observation import POINTS, Array, Flags
from ..base.storage import prefixed, under
from ..memory.pairs import Pairs
from .chain import JointChain, Views
from .fitting import Fit, Fitted, Gaussian, log_evidence, seen_points


@dataclass(frozen=True)
class Known:
    """A chain that was fitted to what was seen.

    Attributes:
        chain: Which numbers there are.
        before: What was known of them before that was seen.
        seen: What was seen.
        fitted: What explains it best.
    """

    chain: JointChain
    before: Gaussian
    seen: Pairs
    fitted: Fitted

    EXPLAINED, WITHIN = 0.8, 2.5
    """It explains what was seen where this share of all points is within so many times the noise. Derived: of
    normal errors 80 % are within 1.8; one point in ten may be mistaken."""
    SPARE = 2
    """Once so many coordinates a number were seen: less could be explained by anything. Choice."""
    SIGMAS = 6.0
    """A point contradicts that is so many deviations from where it should be. Choice: noise is less."""
    SHARE, LEAST = 1 / 3, 2
    """A camera, or what it sees, has changed where this share of a trial's looks contradicts, and so many.
    Choice: fewer points are mistaken."""

    @cached_property
    def numbers(self) -> Gaussian:
        """What is known of all numbers."""
        return Fit(self.chain, self.seen, self.before).known(self.fitted)

    @cached_property
    def covariance(self) -> Array:
        """Of all numbers (p, p)."""
        return self.numbers.root @ self.numbers.root.T

    @cached_property
    def evidence(self) -> float:
        """The logarithm of its odds, but for a constant of what was seen."""
        return log_evidence(self.before, self.fitted, self.numbers)

    @cached_property
    def fits(self) -> bool:
        """Whether it explains most of what was seen."""
        lengths = np.linalg.norm(self.fitted.residuals, axis=-1)
        of_each = [points[points > 0] for points in (lengths[:, :2], lengths[:, 2:])]
        return all(np.quantile(points, self.EXPLAINED) < self.WITHIN for points in of_each if len(points))

    @property
    def explains(self) -> bool:
        """Whether it does so by fewer numbers than that has."""
        seen = np.count_nonzero(self.fitted.residuals)
        return self.fits and not (self.before.anything and seen < self.SPARE * self.chain.size)

    def off_px(self, pairs: Pairs) -> float:
        """How far most of the gripper's points are from where they should be, in pixels."""
        views = self._views(pairs)
        off = views.points[:, :2].reshape(-1, 4) - pairs.sensors
        return float(np.quantile(np.linalg.norm(off.reshape(-1, 2), axis=1), self.EXPLAINED)) / IMAGE_UNIT

    def views_at(self, registers: Array, home: Array) -> Views:
        """Views at registers (m,) alone, of an object that is seen from home at `home` (4,)."""
        return Views(self.chain, self.fitted.numbers, registers[None], home[None])

    def expected(self, registers: Array, home: Array) -> tuple[Array, Array]:
        """What should be seen at registers (m,), of an object that is seen from home at `home` (4,).

        Returns:
            Points (4, 2) in image units, and standard deviations (4,) of their coordinates in pixels.
        """
        views = self.views_at(registers, home)
        return views.points[0], np.sqrt(self._variances(views)[0]) / IMAGE_UNIT

    def jacobian(self, registers: Array, home: Array) -> Array:
        """How points change with registers (8, m) there (m,), of an object that home shows at `home` (4,)."""
        return self.views_at(registers, home).by_registers()[0].reshape(2 * POINTS, -1)

    def contradicted(self, pairs: Pairs, least: int = LEAST) -> Flags:
        """Which cameras (2,) see something else than they should, in so many looks at least."""
        views = self._views(pairs)
        points, per_noise = seen_points(pairs)
        off = np.linalg.norm((views.points - points) * per_noise, axis=-1)
        deviations = np.sqrt(1 + self._variances(views) * per_noise[..., 0] ** 2)
        off_of_each = (off > self.SIGMAS * deviations).reshape(-1, 2, len(CAMERAS)).any(1)
        return np.asarray((off_of_each.sum(0) >= least) & (off_of_each.mean(0) >= self.SHARE))

    def _views(self, pairs: Pairs) -> Views:
        return Views(self.chain, self.fitted.numbers, pairs.registers, pairs.homes)

    def _variances(self, views: Views) -> Array:
        """Of a coordinate of each point (n, 4), in square image units."""
        by_numbers = views.by_numbers()
        return np.einsum("npcx,npcx->np", by_numbers @ self.covariance, by_numbers) / 2

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All of it, as named arrays."""
        return {
            "numbers": self.fitted.numbers,
            "mean": self.before.mean,
            "information": self.before.information,
            "anything": np.array([self.before.anything]),
            "mounts": np.array(self.chain.mounts),
            **prefixed("seen", self.seen.arrays()),
        }

    @classmethod
    def of(cls, arrays: Mapping[str, NDArray[Any]], motors: int) -> Self:
        """From what `arrays` returned, for m registers.

        Raises:
            ValueError: An array is missing, or of another shape.
        """
        left, right = (int(mount) for mount in checked_array(arrays, "mounts", (2,)))
        chain, seen = JointChain(motors, (left, right)), Pairs.of(under("seen", arrays))
        numbers, mean = (checked_array(arrays, name, (chain.size,)) for name in ("numbers", "mean"))
        information = checked_array(arrays, "information", (chain.size, chain.size))
        before = Gaussian(mean, information, bool(checked_array(arrays, "anything", (1,))[0]))
        (fitted,) = Fit(chain, seen, before)(numbers[None], steps=0)
        return cls(chain, before, seen, replace(fitted, numbers=numbers))
