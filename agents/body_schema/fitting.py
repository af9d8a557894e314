"""Fitting a chain of joints and two cameras to what was seen, by least squares."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import CAMERAS, IMAGE_UNIT

from ..base.checks import checked_array
from ..base.observation import POINTS, Array, Flags
from ..base.storage import prefixed, under
from ..base.weights import cauchy_weights
from ..calibrated.identification import least_squares
from ..memory.pairs import Pairs
from .chain import PLACE, TURN, JointChain, Views, rotation

MIDDLE = 1.5
"""How far the gripper is before the left camera at home: that chooses the unit of lengths. Choice."""
FOCAL_LENGTH = 1.2
"""What focal lengths are about, in image units. Choice: a field of view of 80 degrees."""
JOINT_STD = (2.0, 2.0, 2.0, 2.0, 2.0, 2.0, 0.3, 0.3, 0.3)
GRIPPER_STD = (1.0, 1.0, 1.0)
CAMERA_STD = (0.35, 0.06, 2.0, 2.0, 2.0, 1.5, 1.5, 1.5)
"""How widely numbers may differ before anything is seen: of any arm, of any camera. Choice: wide. Images
alone leave shifts along axes open."""
FIXED_STD = 1e-3
"""The room's frame is that of the left camera, joints stand at home where they stand, and the gripper's
distance there tells the unit of lengths: by so much these may differ at first (a guard: it is divided by).
Without such conventions, evidence would count what no image tells."""
OBJECT_NOISE = 2.0
"""An object's point is so much less exact than the gripper's: where it should be is told from its home view,
which is noisy, too. Choice."""
OUTLYING = 8.0
"""Points so many times the noise from where they should be are outliers, as for `self_calibrating`."""


ROUNDING = 1e-10
"""Share of an information that is taken for errors of rounding (a guard)."""


@dataclass(frozen=True)
class Gaussian:
    """What is known of all numbers of a chain: they are normally distributed.

    Attributes:
        mean: (p,).
        information: The inverse of their covariance (p, p).
        anything: Whether nothing was seen that tells of them.
    """

    mean: Array
    information: Array
    anything: bool = False

    @classmethod
    def of_any(cls, chain: JointChain) -> Self:
        """Of any arm before any two cameras."""
        mean, std = np.zeros(chain.size), any_std(chain)
        mean[chain.gripper] = 0.0, 0.0, MIDDLE
        for camera in range(len(CAMERAS)):
            mean[chain.camera(camera)][0] = np.log(FOCAL_LENGTH)
        std[chain.camera(0)][2:] = FIXED_STD
        std[chain.gripper][2] = FIXED_STD
        for motor in range(chain.motors):
            std[chain.joint(motor)][6] = FIXED_STD
        return cls(mean, np.diag(1 / std**2), anything=True)

    def but_for(self, changed: NDArray[np.bool_], std: Array) -> Self:
        """The same, but for numbers that have changed (p,): these may differ from before by `std` (p,)."""
        order = np.argsort(~changed, kind="stable")
        kept, first = order[changed.sum() :], changed.sum()
        factor = cholesky(self.information[np.ix_(order, order)])[first:, first:]
        information = np.diag(1 / std**2)
        information[np.ix_(kept, kept)] = factor @ factor.T
        return type(self)(self.mean, information)

    def mirrored(self, signs: Array) -> Self:
        """The same of numbers that have other signs (p,)."""
        return type(self)(signs * self.mean, signs[:, None] * self.information * signs)

    @cached_property
    def root(self) -> Array:
        """R (p, p) with R Rᵀ the covariance: numbers are `mean` + R z of independent standard normal z."""
        return np.asarray(np.linalg.inv(cholesky(self.information)).T)

    @cached_property
    def log_density(self) -> float:
        """Logarithm of the density at the mean, but for a constant that all have."""
        return float(np.log(np.diag(cholesky(self.information))).sum())


def cholesky(information: Array) -> Array:
    """Its lower factor (p, p); so small an eigenvalue as rounding makes negative counts as positive."""
    return np.asarray(np.linalg.cholesky(information + ROUNDING * np.diag(np.diag(information))))


def any_std(chain: JointChain) -> Array:
    """How widely numbers (p,) may differ, those of the left camera as those of the right."""
    return np.concatenate([np.tile(JOINT_STD, chain.motors), GRIPPER_STD, np.tile(CAMERA_STD, len(CAMERAS))])


@dataclass(frozen=True)
class Fitted:
    """What explains looks best.

    Attributes:
        numbers: All numbers of the chain (p,).
        cost: Half the sum of squares: of residuals in units of the noise, and of what was known before.
        residuals: (n, 4, 2), in units of the noise; 0 where nothing was seen.
    """

    numbers: Array
    cost: float
    residuals: Array


class Fit:
    """Least squares on what was seen.

    Args:
        chain: Which numbers there are.
        pairs: What was seen.
        before: What was known of the numbers before.
    """

    def __init__(self, chain: JointChain, pairs: Pairs, before: Gaussian) -> None:
        self._chain, self._pairs, self._before = chain, pairs, before
        self._points, self._per_noise = seen_points(pairs)

    def __call__(
        self, starts: Array, steps: int, noises: float = 1.0, outlying: float = OUTLYING
    ) -> list[Fitted]:
        """What comes out of each of `starts` (s, p), as if noise were so many times as large."""
        before, root, size = self._before, self._before.root, self._chain.size
        per_noise = self._per_noise / noises

        def residuals(z: Array) -> tuple[Array, Callable[[], Array]]:
            views = self._views(before.mean + z @ root.T)

            def derivatives() -> Array:
                by_numbers = views.by_numbers() * per_noise[..., None]
                return by_numbers.reshape(len(z), -1, size) @ root

            return ((views.points - self._points) * per_noise).reshape(len(z), -1), derivatives

        begin = np.asarray(np.linalg.solve(root, (starts - before.mean).T).T, float)
        unit, free = np.ones(size), np.full(size, np.inf)
        z, off, costs = least_squares(residuals, begin, np.zeros(size), unit, free, steps, outlying)
        numbers, off = before.mean + z @ root.T, off.reshape(len(z), -1, POINTS, 2)
        return [Fitted(*each) for each in zip(numbers, costs, off, strict=True)]

    def known(self, fitted: Fitted) -> Gaussian:
        """What is known of all numbers after that, as if images were linear in them."""
        by_numbers = self._views(fitted.numbers).by_numbers()
        weights = cauchy_weights(np.linalg.norm(fitted.residuals, axis=-1) / OUTLYING)
        by_numbers *= (self._per_noise * np.sqrt(weights)[..., None])[..., None]
        by_numbers = by_numbers.reshape(-1, self._chain.size)
        return Gaussian(fitted.numbers, by_numbers.T @ by_numbers + self._before.information)

    def _views(self, numbers: Array) -> Views:
        return Views(self._chain, numbers, self._pairs.registers, self._pairs.homes)


def log_evidence(before: Gaussian, fitted: Fitted, after: Gaussian) -> float:
    """The logarithm of how probable it was to see that, but for a constant: Laplace's approximation.

    Source: MacKay 2003, chapter 27.

    Args:
        before: What was known of all numbers before.
        fitted: What explains best what was seen.
        after: What is known of them then.
    """
    return before.log_density - fitted.cost - after.log_density


def seen_points(pairs: Pairs) -> tuple[Array, Array]:
    """Gripper and object points (n, 4, 2) in image units, and one by their noise; 0 where not seen."""
    points = np.column_stack([pairs.sensors, pairs.objects]).reshape(-1, POINTS, 2)
    noise = pairs.noise_px[:, None] * IMAGE_UNIT * np.array([1.0, 1.0, OBJECT_NOISE, OBJECT_NOISE])
    return np.nan_to_num(points), np.isfinite(points) / noise[..., None]


TURNS, SLIDES = 0.5, 0.3
"""Standard deviations of how far joints of a random arm turn, in rad, and slide, for a register of one.
Choice: less than real ones do; from there, fits find them."""
ROLLS = 8
"""So many rolls of a camera are tried. Choice: fits find those between."""


def random_starts(chain: JointChain, mean: Array, count: int, random: np.random.Generator) -> Array:
    """Numbers (count, p) of random arms, before a right camera that looks at the gripper from anywhere."""
    starts = np.tile(mean, (count, 1))
    for start in starts:
        for motor in range(chain.motors):
            start[chain.joint(motor)][:6] = random.normal(size=6) * np.repeat([TURNS, SLIDES], 3)
        way = random.normal(size=3)
        turn = way * min(1.0, np.pi / float(np.linalg.norm(way)))
        start[chain.camera(1)][TURN] = turn
        start[chain.camera(1)][PLACE] = mean[chain.gripper] - rotation(turn).T @ mean[chain.gripper]
    return starts


def rolled(chain: JointChain, numbers: Array, camera: int) -> Array:
    """Numbers (ROLLS, p) with a camera rolled about its axis."""
    starts = np.tile(numbers, (ROLLS, 1))
    for start, angle in zip(starts, np.linspace(0, 2 * np.pi, ROLLS, endpoint=False), strict=True):
        turn = start[chain.camera(camera)][TURN]
        turn[:] = composed(np.array([0.0, 0.0, angle]), turn)
    return starts


def composed(second: Array, first: Array) -> Array:
    """The turn (3,) that does what two turns (3,) do one after the other: a product of quaternions."""
    (a, u), (b, v) = _quaternion(second), _quaternion(first)
    scalar, vector = a * b - u @ v, a * v + b * u + np.cross(u, v)
    length = float(np.linalg.norm(vector))
    if length == 0:
        return vector
    angle = 2 * np.arctan2(length, scalar)
    return np.asarray(vector / length * (angle - 2 * np.pi * (angle > np.pi)))


def _quaternion(turn: Array) -> tuple[float, Array]:
    angle = float(np.linalg.norm(turn))
    return np.cos(angle / 2), turn / 2 * np.sinc(angle / (2 * np.pi))


def reversing(chain: JointChain, motor: int) -> Array:
    """Signs (p,) that make numbers those of the same robot with a motor reversed: its curve is that of -r."""
    signs = np.ones(chain.size)
    signs[chain.joint(motor)] = [-1.0] * 8 + [1.0]
    return signs


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
        """Views at registers (n, m), of an object that is seen from home at `home` (4,)."""
        return Views(self.chain, self.fitted.numbers, registers, home[None])

    def expected(self, registers: Array, home: Array) -> tuple[Array, Array]:
        """What should be seen at registers (m,), of an object that is seen from home at `home` (4,).

        Returns:
            Points (4, 2) in image units, and standard deviations (4,) of their coordinates in pixels.
        """
        views = self.views_at(registers[None], home)
        return views.points[0], np.sqrt(self._variances(views)[0]) / IMAGE_UNIT

    def jacobian(self, registers: Array, home: Array) -> Array:
        """How points change with registers (8, m) there (m,), of an object that home shows at `home` (4,)."""
        return self.views_at(registers[None], home).by_registers()[0].reshape(2 * POINTS, -1)

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
