"""Gripper and object points as smooth functions of the registers: what a trial's looks tell of them."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import NamedTuple

import numpy as np

from calfree_gym.image import IMAGE_UNIT, rounded

from ...base.observation import POINTS, Array, Observation
from ..perception import MARKER_NOISE_PX
from ..slopes import Slopes
from .gaussian_process import NOISIER, Expected, GaussianProcess, relative_lengths, without_mistaken

GRIPPER, OBJECT = slice(0, 2), slice(2, 4)


class ExpectedPoints(NamedTuple):
    """What should be seen at one place; of several at once only `gripper`, `object` and `apart`.

    Attributes:
        gripper: Of the gripper.
        object: Of the object.
    """

    gripper: Expected
    object: Expected

    @property
    def points(self) -> Array:
        """Gripper and object points (4, 2), in image units."""
        return np.concatenate([self.gripper.points, self.object.points])

    @property
    def variances(self) -> Array:
        """Of their coordinates (4,)."""
        return np.concatenate([self.gripper.variances, self.object.variances])

    @property
    def jacobian(self) -> Array:
        """Of the points by registers (8, m)."""
        slopes = np.concatenate([self.gripper.slopes, self.object.slopes])
        return slopes.reshape(2 * POINTS, -1)

    @property
    def slope_variances(self) -> Array:
        """Covariances of a row of the Jacobian, for each point (4, m, m)."""
        return np.concatenate([self.gripper.slope_variances, self.object.slope_variances])

    @property
    def apart(self) -> Expected:
        """Of the gripper point less the object point, in both images (p = 2)."""
        return self.gripper - self.object

    @property
    def distance(self) -> Array:
        """The image distance d (4,)."""
        return (self.gripper.points - self.object.points).reshape(4)

    @property
    def distance_jacobian(self) -> Array:
        """Of the image distance (4, m)."""
        return (self.gripper.slopes - self.object.slopes).reshape(4, -1)


class SmoothPoints:
    """What is known of gripper and object points in a trial.

    Where they are seen depends on the registers; of the object also on where it is, that is, on where it is
    seen from home.

    Attributes:
        home: Where the object is seen from home (2, 2), in image units; zero where nothing is remembered.
        noise_px: Standard deviation of an image coordinate.
        remembers: Whether it knows what was seen in earlier trials.

    Args:
        motors: m.
        start: The Jacobian from before.
    """

    EXACT = 1e-8
    """Variance of what is known exactly (a guard against 0)."""
    ALIKE = 0.9
    """Points at two places are alike where they correlate more (a guard: it saves time)."""

    def __init__(self, motors: int, start: Slopes | None = None) -> None:
        self.noise_px = MARKER_NOISE_PX
        self.motors = motors
        self._slopes = start
        self.remembers = False
        self._began: Array | None = None
        self._forget()

    @cached_property
    def before(self) -> tuple[GaussianProcess, GaussianProcess]:
        """What was known of gripper and object before the first look of this trial."""
        lengths = (None, None) if self._slopes is None else self._slopes.lengths
        gripper = GaussianProcess.unknown(self.motors, self.motors, lengths[0])
        object_ = GaussianProcess.unknown(self.motors + 4, self.motors, lengths[1])
        if self._slopes is not None:
            registers, jacobian, variances, changes, *_ = self._slopes
            slopes = jacobian.reshape(POINTS, 2, -1)
            variances = variances + changes[:, None] * np.eye(self.motors)
            gripper = gripper.with_slopes(slopes[GRIPPER], variances[GRIPPER], registers)
            object_ = object_.with_slopes(slopes[OBJECT], variances[OBJECT], self._place(registers))
        return gripper, object_

    @cached_property
    def gripper(self) -> GaussianProcess:
        """Over registers."""
        return self.before[0]

    @cached_property
    def object(self) -> GaussianProcess:
        """How far the object is seen from where it is at home, over registers and that home view."""
        return self.before[1]

    @classmethod
    def remembered(
        cls,
        gripper: GaussianProcess,
        of_object: tuple[GaussianProcess, Array] | None,
        noise_px: float,
        start: Slopes | None = None,
    ) -> SmoothPoints:
        """With all that is remembered of earlier trials.

        What it tells of the Jacobian corrects `start`; it does not begin with that.

        Args:
            gripper: What is remembered of the gripper.
            of_object: The same of the object, and where it is seen from home (2, 2); None where it is not.
            noise_px: Standard deviation of an image coordinate.
            start: The Jacobian as it usually is.
        """
        points = cls(gripper.motors)
        points._slopes = start
        points._began = np.zeros(gripper.motors)
        object_ = GaussianProcess.unknown(gripper.motors + 4, gripper.motors)
        if of_object is not None:
            points.remembers, (object_, points.home) = True, of_object
            at_home = points._place(points._began), np.zeros((2, 2)), cls.EXACT
            object_ = object_.with_look(*at_home, np.ones(2, bool))
            object_ = object_.in_new_trial((noise_px * IMAGE_UNIT) ** 2)
        points.before = gripper, object_
        points.gripper, points.object = points.before
        return points

    @property
    def jacobian(self) -> Array:
        """Of gripper and object points (8, m) where they were looked at last; zero before the first look."""
        if self._seen:
            return self.at(self._seen[-1].registers).jacobian
        return np.zeros((2 * POINTS, self.motors)) if self._slopes is None else self._slopes.jacobian

    def _forget(self) -> None:
        """Knows nothing but slopes from before."""
        self.home = np.zeros((2, 2))
        self._expected: dict[tuple[tuple[int, ...], bytes], ExpectedPoints] = {}
        for known in ("before", "gripper", "object"):  # made when first asked for
            vars(self).pop(known, None)
        self._seen: list[Observation] = []

    def _place(self, registers: Array) -> Array:
        """What the object depends on (..., m + 4)."""
        place = np.empty((*registers.shape[:-1], self.motors + 4))
        place[..., : self.motors], place[..., self.motors :] = registers, self.home.ravel()
        return place

    def look(self, observation: Observation, noise_px: float) -> None:
        """Takes in the points of an observation that are visible in it.

        Args:
            observation: Points as they were seen.
            noise_px: Standard deviation of an image coordinate, as far as known.
        """
        self._began = observation.registers if self._began is None else self._began
        self._seen.append(observation)
        noisier = noise_px**2 > NOISIER * self.noise_px**2
        self.noise_px = noise_px
        if noisier:
            self.gripper, self.object = self.before
            for each in self._seen:
                self._take_in(each)
        else:
            self._take_in(observation)

    def _take_in(self, observation: Observation) -> None:
        self._expected.clear()
        registers, points, seen = observation.registers, observation.points, observation.visible
        variance = (self.noise_px * IMAGE_UNIT) ** 2
        self.gripper = self.gripper.with_look(registers, points[GRIPPER], variance, seen[GRIPPER])
        from_home = points[OBJECT] - self.home
        tells_home = observation is self._seen[0] and not from_home.any()
        if not tells_home and seen[OBJECT].any():  # the look that tells home tells no more
            self.object = self.object.with_look(self._place(registers), from_home, variance, seen[OBJECT])

    def leave_out_mistaken(self) -> None:
        """Leaves out looks of this trial that are not where the others say."""
        gripper, object_ = self.before
        if len(gripper.looks.places) == gripper.known_slopes:
            self.gripper = without_mistaken(self.gripper, gripper)
            self.object = without_mistaken(self.object, object_)
            self._expected.clear()

    def object_moved(self, by: Array) -> None:
        """Corrects where the object is by how far it was moved (2, 2); forgets its looks of this trial."""
        self.object = self.before[1]
        self.home = self.home + by
        self._expected.clear()

    def look_anew(self, observation: Observation, noise_px: float) -> None:
        """As `look`, where the world has changed: forgets earlier looks; known slopes may still hold."""
        now = self._slopes_at(observation.registers)
        if self._slopes is not None:
            before = self._slopes
            now = now._replace(
                changes=before.changes, trials=before.trials, lengths=before.lengths, looks=before.looks
            )
        self._slopes = now
        self._forget()
        self.look(observation, noise_px)

    def forget_earlier_trials(self) -> None:
        """Forgets looks of earlier trials; the Jacobian from before and the looks of this trial stay."""
        seen = self._seen
        self._forget()
        self.remembers = False
        for each in seen:
            self.look(each, self.noise_px)

    def slopes_for_next(self) -> Slopes | None:
        """The Jacobian where trials begin, as the next one begins with it; without looks that from before."""
        if self._began is None:
            return self._slopes
        now = self._slopes_at(self._began)
        if self._slopes is not None:
            hold = [self.gripper.slopes_hold] * 2 + [self.object.slopes_hold] * 2
            now = self._slopes.corrected(now, np.array(hold))
        functions = zip((self.gripper, self.object), self.before, strict=True)
        told = [relative_lengths(each, len(before.looks.places)) for each, before in functions]
        lengths, looks = zip(*told, strict=True)
        return now.with_lengths(np.array(lengths), np.array(looks))

    def _slopes_at(self, registers: Array) -> Slopes:
        expected = self.at(registers)
        return Slopes.of(expected.jacobian, registers, expected.slope_variances)

    def places_near(self, registers: Array) -> Iterator[Array]:
        """Registers (m,) where the gripper was seen, nearest first to where the object is from `registers`.

        Of places that are alike, only the first.
        """
        gripper = self.gripper
        places, points, _, _ = gripper.looks.only(slice(gripper.known_slopes, None))
        apart = np.square(points - self.at(registers).object.points).sum((1, 2))
        left = places[rounded(apart).argsort(kind="stable")]
        while len(left):
            yield left[0]
            left = left[gripper.alike(left[0], left) < self.ALIKE]

    def unsure(self, registers: Array) -> Array:
        """Variances (4,) of the points' coordinates at registers (m,), over all lengths that may be."""
        functions = (self.gripper, registers), (self.object, self._place(registers))
        return np.concatenate(
            [
                function.unsure(place) if len(function.lengths) > 1 else expected.variances
                for (function, place), expected in zip(functions, self.at(registers), strict=True)
            ]
        )

    def at(self, registers: Array) -> ExpectedPoints:
        """What should be seen at registers (m,), or at several at once (k, m)."""
        key = registers.shape, registers.tobytes()
        if key not in self._expected:
            gripper, object_ = self.gripper.at(registers), self.object.at(self._place(registers))
            object_.values[..., 0] += self.home
            self._expected[key] = ExpectedPoints(gripper, object_)
        return self._expected[key]
