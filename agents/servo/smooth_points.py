"""Image points as smooth random functions of the registers: what has been seen tells what will be."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calfree_gym.image import IMAGE_UNIT

from ..base.observation import POINTS, Array, Observation
from ..jacobian import Slopes, distance_jacobian
from ..perception.noise import MARKER_NOISE_PX

SIDES = (slice(0, 2), slice(2, 4))
"""Points of the gripper, and of the object: those of one side are as smooth in both images."""


class Expected(NamedTuple):
    """What should be seen at one place.

    Attributes:
        points: Gripper and object points (4, 2), in image units.
        variances: Of their coordinates (4,).
        jacobian: Of the points by registers (8, m).
        slope_variances: Covariances of a row of the Jacobian, for each point (4, m, m).
        variance_slopes: Derivatives of `variances` by registers (4, m).
    """

    points: Array
    variances: Array
    jacobian: Array
    slope_variances: Array
    variance_slopes: Array

    @property
    def distance(self) -> Array:
        """The image distance d (4,)."""
        return (self.points[:2] - self.points[2:]).reshape(4)

    @property
    def distance_jacobian(self) -> Array:
        """Of the image distance (4, m)."""
        return distance_jacobian(self.jacobian)


class SmoothPoints:
    """Each coordinate of an image point as a Gaussian process over the registers.

    No motor is told from another, and nothing is said of how many there are. Over how many registers points
    are smooth is what explains the looks best (the evidence, Rasmussen & Williams 2006, section 5.4.1), apart
    for gripper and object: so points that hardly move, and robots whose words do much or little, need no
    setting. Slopes that are known from before are one more look, at the derivative; where they do not explain
    what is seen, they do not count.

    Attributes:
        noise_px: Standard deviation of an image coordinate.
        jacobian: Of gripper and object points (8, m) where they were looked at last.

    Args:
        motors: m.
        start: The Jacobian from before.
    """

    SPREAD = 2.0
    """Standard deviation of where points may be, in image units. Derived: the width of an image."""
    OFFSET = 10.0
    """Standard deviation of what is added to that everywhere, in image units (a guard: far beyond)."""
    LENGTHS = 2.0 ** np.arange(-3, 4)
    """Registers over which points may be smooth. Choice: from an eighth to eight times what a motor has to
    its farther stop."""
    USUAL, UNUSUAL = 2.0, 1.0
    """Beforehand these lengths are log-normal, with that median and deviation of the logarithm. Choice: a
    handful of looks outweighs it."""
    SLOPE_ERROR = 0.3
    """Slopes from before are wrong by this share of their root mean square: tuned on wild worlds 3000 and
    up."""
    CHANGED = 0.05
    """Beforehand slopes from before do not hold in this share of trials. Choice, as above."""

    def __init__(self, motors: int, start: Slopes | None = None) -> None:
        self.noise_px = MARKER_NOISE_PX
        self.jacobian = np.zeros((2 * POINTS, motors)) if start is None else start.jacobian
        self._slopes = start
        self._registers = np.empty((0, motors))
        self._points = np.empty((0, POINTS, 2))
        self._seen = np.empty((0, POINTS), bool)
        self._fit()

    def look(self, observation: Observation, noise_px: float) -> None:
        """Takes in the points of an observation that are visible in it.

        Args:
            observation: Points as they were seen.
            noise_px: Standard deviation of an image coordinate, as far as known.
        """
        self.noise_px = noise_px
        self._registers = np.concatenate([self._registers, [observation.registers]])
        self._points = np.concatenate([self._points, [observation.points]])
        self._seen = np.concatenate([self._seen, [observation.visible]])
        self._fit()
        self.jacobian = self.at(observation.registers).jacobian

    def look_anew(self, observation: Observation, noise_px: float) -> None:
        """As `look`, where the world has changed: forgets earlier looks; known slopes may still hold."""
        self._slopes = self._slopes_at(observation.registers)
        self._registers, self._points, self._seen = self._registers[:0], self._points[:0], self._seen[:0]
        self.look(observation, noise_px)

    def slopes_for_next(self) -> Slopes | None:
        """What the next trial begins with: the Jacobian at home; without looks that from before."""
        if not len(self._registers):
            return self._slopes
        return self._slopes_at(np.zeros(self._registers.shape[1]))

    def _slopes_at(self, registers: Array) -> Slopes:
        expected = self.at(registers)
        return Slopes(registers, expected.jacobian, expected.slope_variances)

    def at(self, registers: Array) -> Expected:
        """What should be seen at registers (m,)."""
        apart, lengths = self._registers - registers, self._lengths[:, None] ** 2
        squares = np.einsum("nm,nm->n", apart, apart)
        near = self._seen.T * self.SPREAD**2 * np.exp(-squares / (2 * lengths))
        kernel = near + self._seen.T * self.OFFSET**2
        steep = near[:, :, None] * apart / lengths[:, :, None]
        points, slopes = np.zeros((POINTS, 2)), np.zeros((POINTS, 2, len(registers)))
        variances = np.full(POINTS, self.SPREAD**2 + self.OFFSET**2)
        slope_variances = np.eye(len(registers)) * self.SPREAD**2 / lengths[:, :, None]
        variance_slopes = np.zeros((POINTS, len(registers)))
        if self._slopes is not None:
            known, curved = self._with_slopes_at(registers)
            looks = self._known @ self._weights
            weighed = np.einsum("pkm,pm->pk", self._weights, known)
            jacobian = self._slopes.jacobian.reshape(POINTS, 2, -1)
            points += np.einsum("pm,pcm->pc", weighed, jacobian)
            slopes += jacobian @ self._weights @ curved
            kernel = kernel - np.einsum("pnm,pm->pn", looks, known)
            steep = steep - looks @ curved
            variances = variances - np.einsum("pm,pm->p", known, weighed)
            slope_variances = slope_variances - curved @ self._weights @ curved
            variance_slopes -= 2 * np.einsum("pkm,pm->pk", curved, weighed)
        solved = np.einsum("pij,pj->pi", self._inverses, kernel)
        return Expected(
            points=points + np.einsum("pn,pnc->pc", kernel, self._sums),
            variances=np.maximum(variances - np.einsum("pn,pn->p", kernel, solved), 0.0),
            jacobian=(slopes + self._sums.swapaxes(1, 2) @ steep).reshape(2 * POINTS, -1),
            slope_variances=slope_variances - steep.swapaxes(1, 2) @ self._inverses @ steep,
            variance_slopes=variance_slopes - 2 * np.einsum("pnm,pn->pm", steep, solved),
        )

    def _fit(self) -> None:
        """Chooses how smooth the points of each side are, and whether slopes from before hold."""
        apart = self._registers[:, None] - self._registers
        squares = np.einsum("ijm,ijm->ij", apart, apart)
        covariance = (
            self.SPREAD**2 * np.exp(-squares / (2 * self.LENGTHS[:, None, None] ** 2)) + self.OFFSET**2
        )
        covariance = covariance + (self.noise_px * IMAGE_UNIT) ** 2 * np.eye(len(apart))
        sides = [self._fit_side(side, covariance) for side in SIDES]
        self._lengths, self._weights, self._known, self._inverses, self._sums = (
            np.concatenate(parts) for parts in zip(*sides, strict=True)
        )

    def _fit_side(self, side: slice, covariance: Array) -> tuple[Array, ...]:
        """The hypothesis that explains what was seen of two points best, and what follows from it.

        Args:
            side: Which points.
            covariance: Of a coordinate at all looks, for each length (h, n, n).

        Returns:
            For each point: the length (2,), the weights of slopes from before (2, m, m), the covariances of
            looks and slopes (2, n, m), the inverse of the looks' covariance (2, n, n), and what each look
            adds to what is expected (2, n, 2). Looks that did not show a point add nothing.
        """
        lengths, motors = self.LENGTHS, self._registers.shape[1]
        weights, known = (
            np.zeros((len(lengths), motors, motors)),
            np.zeros((len(lengths), *self._registers.shape)),
        )
        points = self._points[:, None, side].swapaxes(0, 2)  # (2, 1, n, 2)
        if self._slopes is not None:
            lengths = np.tile(lengths, 2)
            weights = np.concatenate([weights, self._slope_weights(side)])
            known = np.concatenate([known, self._with_slopes(self._registers)])
            jacobian = self._slopes.jacobian.reshape(POINTS, 2, -1)[side]
            points = points - known @ weights @ jacobian[:, None].swapaxes(2, 3)
            covariance = np.tile(covariance, (2, 1, 1)) - known @ weights @ known.swapaxes(1, 2)
        evidence = -(np.log(lengths / self.USUAL) ** 2) / (2 * self.UNUSUAL**2)
        evidence += np.log(np.where(weights.any((1, 2)), 1 - self.CHANGED, self.CHANGED))
        inverses, sums = [], []
        for seen, values in zip(self._seen.T[side], points, strict=True):
            both, shown = np.outer(seen, seen), np.where(seen[:, None], values, 0.0)
            inverse = np.linalg.inv(np.where(both, covariance, np.eye(len(seen))))
            inverses.append(inverse * both)
            sums.append(inverse @ shown)
            evidence += np.linalg.slogdet(inverse)[1] - (shown * sums[-1]).sum((1, 2)) / 2
        best = int(evidence.argmax())
        return (
            np.repeat(lengths[best], 2),
            np.stack([weights[best]] * 2),
            known[best] * self._seen.T[side, :, None],
            np.stack([each[best] for each in inverses]),
            np.stack([each[best] for each in sums]),
        )

    def _slope_weights(self, side: slice) -> Array:
        """One over the variance of slopes from before, for each length (h, m, m)."""
        assert self._slopes is not None
        error = self._slopes.variances[side].mean(0)
        usual = self.SLOPE_ERROR**2 * np.square(self._slopes.jacobian.reshape(POINTS, -1)[side]).mean()
        unit = np.eye(len(error))
        return np.linalg.inv(error + unit * usual + unit * (self.SPREAD / self.LENGTHS[:, None, None]) ** 2)

    def _with_slopes(self, registers: Array) -> Array:
        """Covariances of a coordinate at registers (n, m) and slopes from before, by length (h, n, m)."""
        assert self._slopes is not None
        towards = registers - self._slopes.registers
        near = np.exp(-np.square(towards).sum(1) / (2 * self.LENGTHS[:, None] ** 2))
        return (self.SPREAD / self.LENGTHS[:, None, None]) ** 2 * near[:, :, None] * towards

    def _with_slopes_at(self, registers: Array) -> tuple[Array, Array]:
        """The same at registers (m,) for each point's length (4, m), and the derivatives (4, m, m)."""
        assert self._slopes is not None
        towards, lengths = registers - self._slopes.registers, self._lengths[:, None] ** 2
        near = self.SPREAD**2 / lengths * np.exp(-towards @ towards / (2 * lengths))
        straight = np.eye(len(towards)) - np.outer(towards, towards) / lengths[:, :, None]
        return near * towards, near[:, :, None] * straight
