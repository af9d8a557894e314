"""How marks move in the images of a robot on wheels: by projectivities, whatever its cameras are.

A camera is fixed to a robot on a flat floor. As long as wheels turn in constant ratios, a mark at height h
above the camera moves in the camera's frame by Ẋ = -(ω [n]× + v nᵀ / h) X: n, the vertical, ω and v are
constant, and nᵀX = h. So its image x ~ K X moves by a constant matrix, ẋ ~ S x. After the motion it is
exp(S) x, and what motors do adds up: S = Σ f(word) S of the motor.

S has the eigenvalues 0 and ±iω. So tr S = 0, ω² = -tr S² / 2, exp(S) = I + sin ω / ω S + (1 - cos ω) / ω² S²
(Rodrigues), and the third coordinate of exp(S) x is the mark's depth after the motion over that before it.
Nothing of this asks for a metre, an angle, a focal length or a track: of each mark and motor 8 numbers are
learned from what is seen, and of each motor a curvature.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import IMAGE_UNIT

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


class DrivenArc(NamedTuple):
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
        entries: Of S of each mark and motor (p, m, 8), for a word of 1, see `TRACELESS`.
        curvature: Of the motors (m,): f(w) = w + c w |w|.
        motions: What it learns from.

    Args:
        points: p: all marks, in all cameras.
        motors: m.
    """

    KEPT = 60
    """So many motions are remembered. Choice: each tells two numbers of a mark, and two motors have 16."""
    PRIOR, CURVATURE = 3.0, 0.3
    """Standard deviations of entries and curvatures before anything is known. Choice: a word of 1 may turn
    the robot by some radians, and so move images by some focal lengths."""
    CARRIED = 0.5
    """Of entries that were carried over a knock. Choice: a sixth; the camera was also displaced."""
    DEVIATION_PX = 1.5
    """Of a predicted image coordinate. Choice: twice what two looks of 0.5 px have, for wheels slip."""
    MISTAKEN = 5.0
    """A point that is so many deviations off counts half (a guard)."""
    SETTLED = 0.01
    """Less is not worth another round. Derived: in units of a squared deviation."""
    STEP = 1e-6
    """Of numerical derivatives (a guard)."""

    def __init__(self, points: int, motors: int) -> None:
        self.entries = np.zeros((points, motors, 8))
        self.curvature = np.zeros(motors)
        self.motions: list[DrivenArc] = []
        self._prior, self._deviation = self.entries, self.PRIOR

    def transforms(self, words: Array) -> Array:
        """What words (..., m) do to marks: exp(S) (..., p, 3, 3)."""
        return _transforms(words, self.entries, self.curvature)

    def predict(self, points: Array, words: Array) -> Array:
        """Where points (..., p, 2) are seen after words (..., m)."""
        return projected(self.transforms(words) @ homogeneous(points))

    def learn(self, motion: DrivenArc) -> None:
        """Remembers a motion; `fit` learns from it."""
        self.motions = [*self.motions, motion][-self.KEPT :]

    def forget(self, kept: int) -> None:
        """Wheels are others than before: only the latest motions count."""
        self.motions = self.motions[-kept:]
        self._prior, self._deviation = np.zeros_like(self.entries), self.PRIOR

    def carry_over(self, homographies: Array) -> None:
        """Cameras were knocked: what was seen at x is now seen at G x, but for how far they were displaced.

        Args:
            homographies: G (p, 3, 3) of the camera of each point.
        """
        g = homographies[:, None]
        carried = g @ np.tensordot(self.entries, TRACELESS, 1) @ np.linalg.inv(g)
        self.entries = carried.reshape(*carried.shape[:2], 9)[..., :8]
        self._prior, self._deviation, self.motions = self.entries, self.CARRIED, []

    def fit(self, rounds: int) -> None:
        """Goes to what is most probable by at most so many rounds of Levenberg and Marquardt's method.

        Marks share nothing but curvatures, for which it solves first (Schur complement).
        """
        if not self.motions:
            return
        of_all = _Residuals(self.motions, self._prior, self._deviation)
        points, motors, _ = self.entries.shape
        own = np.eye(8 * motors).reshape(-1, motors, 8)
        now = self.entries, self.curvature
        cost, damping = of_all.cost(*now), 1e-3
        for _ in range(rounds):
            residuals = of_all(*now)
            sizes = np.linalg.norm(residuals, axis=-1, keepdims=True) / self.MISTAKEN
            weights = np.sqrt(cauchy_weights(sizes))
            changed = [of_all(now[0] + self.STEP * each, now[1]) for each in own]
            changed += [of_all(now[0], now[1] + self.STEP * each) for each in np.eye(motors)]
            slopes = (np.stack(changed, 1) - residuals[:, None]) * weights[:, None] / self.STEP
            slopes = slopes.reshape(points, len(changed), -1)
            squares = slopes @ slopes.swapaxes(1, 2)
            gradients = slopes @ (residuals * weights).reshape(points, -1, 1)
            a, of_own, of_shared = np.eye(len(own)), slice(len(own)), slice(len(own), None)
            prior = of_all.off_prior(now[0]).reshape(points, -1, 1)
            gradient = gradients[:, of_own] + prior / self._deviation
            hessian = squares[:, of_own, of_own] + a / self._deviation**2
            mixed = squares[:, of_own, of_shared]
            solved = np.linalg.solve(hessian + damping * hessian * a, np.concatenate([gradient, mixed], 2))
            complement = squares[:, of_shared, of_shared] - mixed.swapaxes(1, 2) @ solved[..., 1:]
            left = gradients[:, of_shared] - mixed.swapaxes(1, 2) @ solved[..., :1]
            shared = -np.linalg.solve(
                complement.sum(0) + np.eye(motors) / self.CURVATURE**2,
                left.sum(0)[:, 0] + now[1] / self.CURVATURE**2,
            )
            step = -(solved[..., 0] + solved[..., 1:] @ shared).reshape(points, motors, 8)
            then = now[0] + step, now[1] + shared
            gain = cost - of_all.cost(*then)
            if gain > 0:
                now, cost = then, cost - gain
            damping *= 0.2 if gain > 0 else 10
            if 0 < gain < self.SETTLED:
                break
        self.entries, self.curvature = now

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """All that is known, as named arrays."""
        known = {"entries": self.entries, "curvature": self.curvature, "prior": self._prior}
        known |= {"deviation": np.array([self._deviation])}
        if self.motions:
            stacked = (np.stack(each).astype(float) for each in zip(*self.motions, strict=True))
            known |= dict(zip(DrivenArc._fields, stacked, strict=True))
        return known

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Takes over what `arrays` returned."""
        points, motors, _ = shape = self.entries.shape
        self.entries = checked_array(arrays, "entries", shape)
        self.curvature = checked_array(arrays, "curvature", (motors,))
        self._prior = checked_array(arrays, "prior", shape)
        (self._deviation,) = checked_array(arrays, "deviation", (1,)).tolist()
        self.motions = []
        if "words" in arrays:
            shapes = ((None, points, 2), (None, motors), (None, points, 2), (None, points))
            read = [checked_array(arrays, *each) for each in zip(DrivenArc._fields, shapes, strict=True)]
            for before, words, after, seen in zip(*read, strict=True):
                self.motions.append(DrivenArc(before, words, after, seen > 0))


def _transforms(words: Array, entries: Array, curvature: Array) -> Array:
    effect = words + curvature * words * np.abs(words)
    generators = np.tensordot(effect, entries @ TRACELESS.reshape(8, 9), ([-1], [1]))
    return exponential(generators.reshape(*generators.shape[:-1], 3, 3))


class _Residuals:
    """How far motions ended (p, n, 2) from where a model has them end, in deviations.

    Args:
        motions: n.
        prior: Entries (p, m, 8) before anything was seen.
        deviation: Of them.
    """

    def __init__(self, motions: list[DrivenArc], prior: Array, deviation: float) -> None:
        before, self._words, self._after, seen = (np.stack(each) for each in zip(*motions, strict=True))
        self._before, self._prior, self._deviation = homogeneous(before), prior, deviation
        self._units = seen[..., None] / (ProjectiveModel.DEVIATION_PX * IMAGE_UNIT)

    def __call__(self, entries: Array, curvature: Array) -> Array:
        there = projected(_transforms(self._words, entries, curvature) @ self._before)
        return np.asarray(((there - self._after) * self._units).swapaxes(0, 1))

    def off_prior(self, entries: Array) -> Array:
        """How far entries are from what they were before (p, m, 8), in deviations."""
        return np.asarray((entries - self._prior) / self._deviation)

    def cost(self, entries: Array, curvature: Array) -> float:
        """-2 log of their probability, but for a constant: points that are far off count little (Cauchy)."""
        limit = ProjectiveModel.MISTAKEN**2
        of_points = limit * np.log1p((self(entries, curvature) ** 2).sum(-1) / limit).sum()
        of_prior = (self.off_prior(entries) ** 2).sum()
        return float(of_points + of_prior + ((curvature / ProjectiveModel.CURVATURE) ** 2).sum())
