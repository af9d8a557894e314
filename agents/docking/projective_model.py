"""How marks move in the images of a robot on wheels: by projectivities, whatever its cameras are.

A camera is fixed to a robot on a flat floor. As long as wheels turn in constant ratios, a mark at height h
above the camera moves in the camera's frame by Ẋ = -(ω [n]× + v nᵀ / h) X: n, the vertical, ω and v are
constant, and nᵀX = h. So its image x ~ K X moves by a constant matrix, ẋ ~ S x. After the motion it is
exp(S) x, and what motors do adds up: S = Σ f(word) S of the motor.

Of marks that differ in height S = B + D / h: B turns with the robot, D goes with it.
S has the eigenvalues 0 and ±iω. So tr S = 0, ω² = -tr S² / 2, exp(S) = I + sin ω / ω S + (1 - cos ω) / ω² S²
(Rodrigues), and the third coordinate of exp(S) x is the mark's depth after the motion over that before it.
Nothing of this asks for a metre, an angle, a focal length or a track. Learned from what is seen are, of each
camera and motor, B and D, 8 numbers each, of each mark 1 / h, of each motor a curvature, and of each camera
how its lens bends lines.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import IMAGE_UNIT, lengths_px

from ..base.checks import checked_array
from ..base.observation import Array, Flags
from ..base.weights import cauchy_weights

TRACELESS = np.eye(9)[:8].reshape(8, 3, 3)
"""A basis (8, 3, 3) of the matrices without a trace."""
TRACELESS[[0, 4], 2, 2] = -1
NEAREST = 0.05
"""No mark is taken to come nearer than this share of its depth (a guard: one behind a camera would be seen in
its image again)."""
FARTHEST = 8.0
"""No image point is predicted farther out than so many image units (a guard)."""


class Motion(NamedTuple):
    """What a motion did.

    Attributes:
        before: Image points (p, 2) before it.
        words: Its control words (m,).
        after: Image points (p, 2) after it.
        seen: Which of them were seen before and after (p,).
    """

    before: Array
    words: Array
    after: Array
    seen: Flags


def homogeneous(points: Array) -> Array:
    """Image points (..., 2) as columns (..., 3, 1) whose third coordinate is 1."""
    return np.concatenate([points, np.ones_like(points[..., :1])], -1)[..., None]


def projected(columns: Array) -> Array:
    """Image points (..., 2) of such columns (..., 3, 1), see `NEAREST` and `FARTHEST`."""
    flat = columns[..., :2, 0] / np.maximum(columns[..., 2:, 0], NEAREST)
    return np.clip(flat, -FARTHEST, FARTHEST)


def homography(before: Array, after: Array) -> Array:
    """The projectivity G (3, 3) of determinant 1 that takes image points (p, 2), four at least, to others.

    Least squares of linear equations (Hartley & Zisserman 2004, section 4.1).
    """
    x, zero = homogeneous(before)[..., 0], np.zeros((len(before), 3))
    of_x = np.concatenate([x, zero, -after[:, :1] * x], 1)
    of_y = np.concatenate([zero, x, -after[:, 1:] * x], 1)
    found = np.linalg.svd(np.concatenate([of_x, of_y]))[2][-1].reshape(3, 3)
    return np.asarray(found / np.cbrt(np.linalg.det(found)))


def exponential(generators: Array) -> Array:
    """exp(S) (..., 3, 3) of generators S whose eigenvalues are 0 and ±iω."""
    square = generators @ generators
    angle = np.sqrt(-np.trace(square, axis1=-2, axis2=-1) / 2 + 0j)[..., None, None]
    first, second = np.sinc(angle / np.pi).real, (np.sinc(angle / (2 * np.pi)) ** 2).real / 2
    return np.asarray(np.eye(3) + first * generators + second * square)


class ProjectiveModel:
    """What words do to marks in images, learned from motions.

    Attributes:
        turning, going: B and D of each camera and motor (k, m, 8), for a word of 1, see `TRACELESS`: views.
        nearness: 1 / h of each mark in each camera (p,), but for scale and origin: a view.
        bends: Curvatures of the motors (m,), f(w) = w + c w |w|, and of the lenses (k,): a pinhole would
            show at x / (1 + c |x|²) what is seen at x (Fitzgibbon 2001): a view.
        motions: What it learns from.
        learned: All that is learned, in this order (l,).
        motors: m.

    Args:
        points: p: all marks, in all cameras.
        motors: m.
        cameras: k, in which each mark is seen, in turn.
    """

    KEPT = 120
    """So many motions are remembered. Choice: more than it takes to learn all."""
    ENTRY, NEARNESS, CURVATURE, LENS = 3.0, 1.0, 0.3, 0.05
    """Standard deviations before anything is known. Choice: a word of 1 may turn the robot by some radians,
    and so move images by some focal lengths; a lens bends lines by some per cent."""
    CARRIED = 1 / 6
    """So much less is unknown after a knock. Choice: cameras are displaced, by less than marks are off."""
    DEVIATION_PX, SLIP = 1.0, 0.01
    """Of a predicted image coordinate, and of its way, as a share of it. Choice: two looks of 0.5 px and a
    margin of √2; wheels slip by a hundredth."""
    MISTAKEN = 5.0
    """A point that is so many deviations off counts half (a guard)."""
    SETTLED = 0.01
    """Less is not worth another round. Derived: in units of a squared deviation."""
    STEP = 1e-6
    """Of numerical derivatives (a guard)."""

    def __init__(self, points: int, motors: int, cameras: int = 1) -> None:
        self.motions: list[Motion] = []
        self._points, self.motors, self._cameras = points, motors, cameras
        entries = 8 * motors * cameras
        sizes = (entries, self.ENTRY), (entries, self.ENTRY), (points, self.NEARNESS)
        sizes += (motors, self.CURVATURE), (cameras, self.LENS)
        self._before_all = np.concatenate([np.full(size, deviation) for size, deviation in sizes])
        self._prior, self._deviations = np.zeros_like(self._before_all), self._before_all
        self.learned = np.zeros_like(self._prior)
        self.nearness[:] = np.repeat(np.linspace(-1, 1, points // cameras), cameras)  # any that differ

    @property
    def turning(self) -> Array:
        return self._parts(self.learned)[0]

    @property
    def going(self) -> Array:
        return self._parts(self.learned)[1]

    @property
    def nearness(self) -> Array:
        return self._parts(self.learned)[2]

    @property
    def bends(self) -> Array:
        return self._parts(self.learned)[3]

    def _parts(self, learned: Array) -> tuple[Array, Array, Array, Array]:
        entries = 8 * self.motors * self._cameras
        turning, going, nearness, bends = np.split(
            learned, [entries, 2 * entries, 2 * entries + self._points]
        )
        shape = self._cameras, self.motors, 8
        return turning.reshape(shape), going.reshape(shape), nearness, bends

    def entries(self, learned: Array) -> Array:
        """Those of S of each mark and motor (p, m, 8)."""
        turning, going, nearness, _ = self._parts(learned)
        marks = self._points // self._cameras
        return np.tile(turning, (marks, 1, 1)) + nearness[:, None, None] * np.tile(going, (marks, 1, 1))

    def transforms(self, words: Array) -> Array:
        """What words (..., m) do to marks: exp(S) (..., p, 3, 3)."""
        return _transforms(words, self.entries(self.learned), self.bends)

    def straight(self, points: Array) -> Array:
        """Where a pinhole would show what is seen at points (..., p, 2)."""
        return _straight(points, self.bends[self.motors :])

    def predict(self, points: Array, words: Array) -> Array:
        """Where marks are seen after words (..., m) that are seen at points (..., p, 2) before."""
        return _moved(points, words, self.entries(self.learned), self.bends)

    def learn(self, motion: Motion) -> None:
        """Remembers a motion; `fit` learns from it."""
        self.motions = [*self.motions, motion][-self.KEPT :]

    def forget(self, kept: int) -> None:
        """Wheels are others than before: only the latest motions count."""
        self.motions = self.motions[-kept:]
        self._prior, self._deviations = np.zeros_like(self.learned), self._before_all

    def carry_over(self, homographies: Array) -> None:
        """Cameras were knocked: what pinholes showed at x is now at G x, but for how far they were displaced.

        Args:
            homographies: G (k, 3, 3) of each camera.
        """
        g = homographies[:, None]
        for part in (self.turning, self.going):
            carried = g @ np.tensordot(part, TRACELESS, 1) @ np.linalg.inv(g)
            part[:] = carried.reshape(*part.shape[:2], 9)[..., :8]
        self._prior, self._deviations = self.learned.copy(), self.CARRIED * self._before_all
        self.motions = []

    def fit(self, rounds: int) -> None:
        """Goes to what is most probable by at most so many rounds of Levenberg and Marquardt's method."""
        if not self.motions:
            return
        before, words, after, seen = (np.stack(each) for each in zip(*self.motions, strict=True))
        deviations = np.hypot(self.DEVIATION_PX, self.SLIP * lengths_px(after - before)) * IMAGE_UNIT
        units = (seen / deviations)[..., None]

        def residuals(entries: Array, bends: Array) -> Array:
            """How far motions end (p, n, 2) from where they did, in deviations."""
            off = (_moved(before, words, entries, bends) - after) * units
            return np.asarray(off.swapaxes(0, 1))

        def cost(learned: Array) -> float:
            """-2 log of the probability, but for a constant; points far off count little (Cauchy)."""
            off = (residuals(self.entries(learned), self._parts(learned)[3]) ** 2).sum(-1)
            prior = ((learned - self._prior) / self._deviations) ** 2
            return float(self.MISTAKEN**2 * np.log1p(off / self.MISTAKEN**2).sum() + prior.sum())

        now, damping, least = self.learned, 1e-3, cost(self.learned)
        for _ in range(rounds):
            entries, bends = self.entries(now), self._parts(now)[3]
            off = residuals(entries, bends)
            weights = np.sqrt(cauchy_weights(np.linalg.norm(off, axis=-1) / self.MISTAKEN))[..., None]
            ways = self.STEP * np.eye(8 * self.motors).reshape(-1, self.motors, 8)
            of_entries = np.stack([residuals(entries + way, bends) - off for way in ways], 1)
            ways = self.STEP * np.eye(len(bends))
            of_bends = np.stack([residuals(entries, bends + way) - off for way in ways], 1)
            slopes = self._slopes(now, of_entries, of_bends) * weights[:, None] / self.STEP
            slopes = slopes.swapaxes(0, 1).reshape(len(now), -1)
            hessian = slopes @ slopes.T + np.diag(self._deviations**-2)
            gradient = slopes @ (off * weights).ravel() + (now - self._prior) / self._deviations**2
            then = now - np.linalg.solve(hessian + damping * np.diag(np.diag(hessian)), gradient)
            gain = least - cost(then)
            if gain > 0:
                now, least = then, least - gain
            damping *= 0.2 if gain > 0 else 10
            if 0 < gain < self.SETTLED:
                break
        self.learned = now

    def _slopes(self, learned: Array, of_entries: Array, of_bends: Array) -> Array:
        """Derivatives by all that is learned (p, l, n, 2), from those by a mark's own S (p, 8 m, n, 2)."""
        _, going, nearness, _ = self._parts(learned)
        slopes = np.zeros((self._points, len(learned), *of_entries.shape[2:]))
        turning_of, going_of, nearness_of, bends_of = self._parts(np.arange(len(learned)))
        for point in range(self._points):
            camera = point % self._cameras
            slopes[point, turning_of[camera].ravel()] = of_entries[point]
            slopes[point, going_of[camera].ravel()] = nearness[point] * of_entries[point]
            slopes[point, nearness_of[point]] = np.tensordot(going[camera].ravel(), of_entries[point], 1)
        slopes[:, bends_of] = of_bends
        return slopes

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """All that is known, as named arrays."""
        known = {"learned": self.learned, "prior": self._prior, "deviations": self._deviations}
        if self.motions:
            stacked = (np.stack(each).astype(float) for each in zip(*self.motions, strict=True))
            known |= dict(zip(Motion._fields, stacked, strict=True))
        return known

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Takes over what `arrays` returned."""
        names, (points, motors) = ("learned", "prior", "deviations"), (self._points, self.motors)
        known = [checked_array(arrays, name, self.learned.shape) for name in names]
        self.learned, self._prior, self._deviations = known
        self.motions = []
        if "words" in arrays:
            shapes = ((None, points, 2), (None, motors), (None, points, 2), (None, points))
            read = [checked_array(arrays, *each) for each in zip(Motion._fields, shapes, strict=True)]
            for before, words, after, seen in zip(*read, strict=True):
                self.motions.append(Motion(before, words, after, seen > 0))


def _transforms(words: Array, entries: Array, bends: Array) -> Array:
    effect = words + bends[: words.shape[-1]] * words * np.abs(words)
    generators = np.tensordot(effect, entries @ TRACELESS.reshape(8, 9), ([-1], [1]))
    return exponential(generators.reshape(*generators.shape[:-1], 3, 3))


def _moved(points: Array, words: Array, entries: Array, bends: Array) -> Array:
    lenses = bends[words.shape[-1] :]
    straight = projected(_transforms(words, entries, bends) @ homogeneous(_straight(points, lenses)))
    root = np.sqrt(np.maximum(1 - 4 * _of_lenses(straight, lenses), 0))
    return np.asarray(2 * straight / (1 + root))


def _straight(points: Array, lenses: Array) -> Array:
    return np.asarray(points / (1 + _of_lenses(points, lenses)))


def _of_lenses(points: Array, lenses: Array) -> Array:
    """By how much lenses bend (..., p, 1), c |x|², at points (..., p, 2)."""
    return np.tile(lenses, points.shape[-2] // len(lenses))[:, None] * (points**2).sum(-1, keepdims=True)
