"""The knowledge base `memory`: every look of every trial, and nothing but looks.

Gripper points depend on the registers. Object points depend on the registers, and on where the object is: on
where it is seen from home. So it does not matter which motors move the cameras, the gripper or both, nor that
many registers lead to one place.
"""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import IMAGE_UNIT, lengths, rounded

from ..base.checks import check_number, checked_array
from ..base.observation import Array
from ..base.prior_knowledge import PriorKnowledge
from ..base.storage import prefixed, under
from ..servo.image_model.gaussian_process import (
    NOISIER,
    GaussianProcess,
    Looks,
    price,
    right_looks,
    solved,
    without,
)
from ..servo.image_model.smooth_points import SmoothPoints
from ..servo.slopes import Slopes
from .camera_change import WIDE_STD, CameraChange, turned
from .pairs import Cameras, HomeView, Pairs


class KeptLooks:
    """A smooth function that looks are added to.

    Over what distances the point is smooth is chosen anew as more is seen. Looks that add little to the
    others are dropped (the paper asks for support points "in an irregular pattern where they are actually
    needed", section 4.3).

    Attributes:
        function: What was seen where.

    Args:
        dimensions: Components of a place.
        motors: m; the first components of a place are registers.
        most: So many looks are kept.
    """

    FIRST = 8
    """Distances are first chosen by this many looks. Choice."""
    MORE = 1.4
    """They are chosen anew each time that this times as many looks were seen (a guard: it takes time)."""
    SPARE = 30
    """This many more looks are kept before some are dropped (a guard: that takes time)."""
    TOLD = 0.5
    """A look is not kept where the others tell to this share of its noise what it should be. Choice."""

    def __init__(self, dimensions: int, motors: int, most: int) -> None:
        self.function = GaussianProcess.unknown(dimensions, motors)
        self._unknown = self.function
        self._most = most
        self._settled = 0
        self._seen, self._next_refit = 0, float(self.FIRST)

    def __len__(self) -> int:
        return len(self.function.looks.places)

    def add(self, places: Array, points: Array, variances: Array) -> None:
        """Takes in looks at places (n, d): points (n, 2, 2), and variances (n,), in image units."""
        for look in zip(places, points, variances, strict=True):
            if not self._is_told(look[0], look[2]):
                self.function = self.function.with_look(*look, np.ones(2, bool))
        self._seen += len(places)
        noisier = len(places) and (self.function.looks.variances < variances[-1] / NOISIER).any()
        refit = noisier or self._seen >= self._next_refit
        if refit:
            self._refit(float(variances[-1]))
        if refit or len(self) > self._settled + self.SPARE:
            self._drop()

    def add_and_refit(self, places: Array, points: Array, variances: Array) -> float:
        """As `add`, and chooses distances anew; how probable these looks were then, as a logarithm."""
        if not len(places):
            return 0.0
        least = float(variances[-1])
        before = self._no_less_noisy(least).evidence.max()
        self.function = self._with(places, points, variances)
        self._seen += len(places)
        mistaken = self._refit(least)
        return float(self.function.evidence.max() - before + mistaken * price())

    def _is_told(self, place: Array, variance: float) -> bool:
        """Whether the others tell to the share `TOLD` of its noise what a look would be."""
        return bool(self._settled and self.function.variance(place) <= self.TOLD**2 * variance)

    def _refit(self, least: float) -> int:
        """Chooses distances anew, where no look has less than this variance; leaves out mistaken ones.

        Returns:
            How many points of looks it took for mistaken.
        """
        self.function = self._no_less_noisy(least).refitted()
        looks, motors, mistaken = self.function.looks, self.function.motors, 0
        lengths = np.full(looks.places.shape[1], self.function.USUAL)
        right = right_looks(self.function.of(looks, motors, lengths))
        if not right.all():
            other = self.function.of(looks.only(np.asarray(right.all(1))), motors, lengths).refitted()
            if other.evidence[0] + np.count_nonzero(~right) * price() > self.function.evidence[0]:
                self.function, mistaken = other, int(np.count_nonzero(~right))
        self._settled, self._next_refit = len(self), self.MORE * self._seen
        return mistaken

    def _no_less_noisy(self, least: float) -> GaussianProcess:
        """What was seen, where no look has less than this variance."""
        function, looks = self.function, self.function.looks
        if not len(self) or looks.variances.min() >= least:
            return function
        looks = looks._replace(variances=np.maximum(looks.variances, least))
        return function.of(looks, function.motors, function.lengths[function.best])

    def evidence(self, places: Array, points: Array, variances: Array) -> float:
        """The logarithm of how probable such looks are, given those before."""
        after = self._with(places, points, variances)
        return float(after.evidence.max() - self.function.evidence.max())

    def _with(self, places: Array, points: Array, variances: Array) -> GaussianProcess:
        function = self.function
        for look in zip(places, points, variances, strict=True):
            function = function.with_look(*look, np.ones(2, bool))
        return function

    def map(self, places: Array, points: Array, deviations: Array) -> None:
        """What is stored is seen elsewhere now: at places (n, d) as points (n, 2, 2).

        Args:
            places: Where.
            points: What is seen there, in image units.
            deviations: How far off that may be in each image (2,), in image units.
        """
        self._keep(self.function.looks._replace(places=places, points=points).doubted(deviations))

    def doubt(self, deviations: Array) -> None:
        """What is stored may be off by that in each image (2,), in image units, besides."""
        if len(self):
            self._keep(self.function.looks.doubted(deviations))

    def doubt_one_of(self, deviations: Array) -> None:
        """What is stored may be off by one of these in each image (h, 2), in image units: looks will tell."""
        if len(self):
            self.function = self.function.doubted(deviations)

    def _keep(self, looks: Looks) -> None:
        function = self.function
        self.function = function.of(looks, function.motors, function.lengths[function.best])
        self._settled = len(self)

    def _drop(self) -> None:
        """Drops, one after the other, the looks that add least to the others."""
        inverses, sums = solved(self.function)
        kept = np.ones(len(self), bool)
        while True:
            noise_shares = self.function.looks.variances.T * np.einsum("pii->pi", inverses)
            shares = np.where(kept, noise_shares.mean(0), 0.0)
            index = int(rounded(shares).argmax())
            if shares[index] < 1 / (1 + self.TOLD**2) and np.count_nonzero(kept) <= self._most:
                break
            inverses, sums = without(index, inverses, sums)
            kept[index] = False
        self._keep(self.function.looks.only(kept))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All looks, and what was chosen by them, as named arrays."""
        function = self.function
        lengths = function.lengths if self._settled else np.empty((0, function.lengths.shape[1]))
        counts = np.array([self._settled, self._seen, self._next_refit])
        return function.looks._asdict() | {"lengths": lengths, "counts": counts}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Takes over what `arrays` returned; raises ValueError where it does not fit."""
        dimensions = self._unknown.lengths.shape[1]
        places = checked_array(arrays, "places", (None, dimensions))
        points = checked_array(arrays, "points", (len(places), 2, 2))
        noise = (checked_array(arrays, name, (len(places), 2)) for name in ("variances", "doubts"))
        looks = Looks(places, points, *noise)
        lengths = checked_array(arrays, "lengths", (None, dimensions))
        settled, seen, next_refit = checked_array(arrays, "counts", (3,))
        settled = int(settled)
        function = self._unknown
        if settled:
            function = function.of(looks.only(slice(settled)), function.motors, lengths[0])
        for place, point, variances, _ in zip(*looks.only(slice(settled, None)), strict=True):
            function = function.with_look(place, point, variances, np.ones(2, bool))
        self.function, self._settled = function, settled
        self._seen, self._next_refit = int(seen), float(next_refit)


Arrays = Mapping[str, NDArray[Any]]


PRIOR_STD = 0.5
"""Prior deviation of a scale, about 1 or -1, and of an offset, about 0. Choice: gains of wild worlds differ
by up to a factor of 4, joint zeros by some tenths of a register."""


@dataclass(frozen=True)
class ArmChange:
    """Where registers r led, r * scale + offset now leads.

    A motor of another gain, or reversed, changes its scale; a joint's other zero shifts its offset. A link of
    another length does neither, and fits badly.

    Attributes:
        scale: Of each motor (m,).
        offset: Of each motor (m,).
        deviation_px: How far off that is in each camera (2,), in pixels; larger where there were hardly more
            pairs than motors.
    """

    scale: Array
    offset: Array
    deviation_px: Array

    kind = "arm changed"

    @property
    def parameters(self) -> int:
        """How many numbers it is made of."""
        return 2 * len(self.scale)

    @property
    def log_prior(self) -> float:
        """The logarithm of how probable it is beforehand, but for a constant."""
        apart = np.concatenate([np.abs(self.scale) - 1, self.offset])
        return -float(apart @ apart) / (2 * PRIOR_STD**2)

    def sensors(self, sensors: Array) -> Array:
        """What has become of sensor vectors (n, 4): they stay."""
        return sensors

    def registers(self, registers: Array) -> Array:
        """Registers (n, m) that now lead where these led."""
        return registers * self.scale + self.offset

    def old_home(self, motors: int) -> Array:
        """Registers (m,) that led where home is now."""
        assert motors == len(self.scale)
        return -self.offset / self.scale


class Remembered:
    """What was seen in all trials.

    Attributes:
        gripper: Looks at the gripper, by registers.
        object: Looks at the object, by registers and by where it is seen from home: how far it is seen from
            there.

    Args:
        motors: Number of registers m.
        looks: So many looks are kept, at the gripper and at the object. Choice: 700 are no better with seven
            motors.
    """

    prior_knowledge: ClassVar = frozenset({PriorKnowledge.IMAGE_SCALE, PriorKnowledge.NOISE})

    TURNED_SHARE = 0.2
    """Where a camera has turned, points are off by such a share of how far home has moved. Choice: what an
    unknown focal length does to points half an image away, see `camera_change.PERSPECTIVE_SHARE`."""

    def __init__(self, motors: int, looks: int = 300) -> None:
        self.looks = check_number("looks", looks, least=10, whole=True)
        self.motors = motors
        self.gripper = KeptLooks(motors, motors, looks)
        self.object = KeptLooks(motors + 4, motors, looks)

    def __repr__(self) -> str:
        return f"Remembered(looks={self.looks})"

    def points(self, home: Array | None, noise_px: float, start: Slopes | None = None) -> SmoothPoints:
        """What is known of gripper and object points.

        Args:
            home: Where the object is seen from home (4,), noisily; None where it is not: then nothing is
                known of it.
            noise_px: Standard deviation of an image coordinate.
            start: The Jacobian as it usually is.
        """
        of_object = None if home is None else (self.object.function, home.reshape(2, 2))
        return SmoothPoints.remembered(self.gripper.function, of_object, noise_px, start)

    def learn(self, pairs: Pairs) -> None:
        """Takes in what was seen."""
        self.gripper.add(*self._gripper_looks(pairs))
        self.object.add(*self._object_looks(pairs))

    def learn_anew(self, pairs: Pairs) -> float:
        """As `learn`, where points may be less smooth than they were thought to be.

        Returns:
            The logarithm of how probable pairs are, given what was known before.
        """
        return self.gripper.add_and_refit(*self._gripper_looks(pairs)) + self.object.add_and_refit(
            *self._object_looks(pairs)
        )

    def _gripper_looks(self, pairs: Pairs) -> tuple[Array, Array, Array]:
        """Places (n, m), points (n, 2, 2) and variances (n,)."""
        noise = np.square(pairs.noise_px * IMAGE_UNIT)
        return pairs.registers, pairs.sensors.reshape(-1, 2, 2), noise

    def _object_looks(self, pairs: Pairs) -> tuple[Array, Array, Array]:
        """Places (n, m + 4), points from the home view, which is noisy, too (n, 2, 2), and variances (n,)."""
        seen = pairs.only(pairs.with_object)
        noise = np.square(seen.noise_px * IMAGE_UNIT)
        places = np.column_stack([seen.registers, seen.homes])
        return places, (seen.objects - seen.homes).reshape(-1, 2, 2), 2 * noise

    def map(self, changes: Sequence[CameraChange] | Sequence[ArmChange]) -> None:
        """Maps all that is stored by changes, at least one."""
        deviations = reduce(np.hypot, [change.deviation_px * IMAGE_UNIT for change in changes])
        arm = changes[0]  # cameras, of which there may be two, leave registers as they are
        gripper, object_, motors = self.gripper.function.looks, self.object.function, self.motors
        if len(self.gripper):
            sensors = _changed(changes, gripper.points.reshape(-1, 4)).reshape(-1, 2, 2)
            self.gripper.map(arm.registers(gripper.places), sensors, deviations)
        if len(self.object):
            registers, homes = np.split(object_.looks.places, [motors], axis=1)
            seen = _changed(changes, object_.looks.points.reshape(-1, 4) + homes)
            at_home = np.column_stack([np.tile(arm.old_home(motors), (len(homes), 1)), homes])
            homes = _changed(changes, homes + object_.at_all(at_home)[0].reshape(-1, 4))
            self.object.map(
                np.column_stack([arm.registers(registers), homes]),
                (seen - homes).reshape(-1, 2, 2),
                deviations,
            )

    def as_home_moved(self, home: Array, cameras: Cameras) -> Self:
        """A guess at what is to be seen where these cameras (2,) now see the gripper at home elsewhere (4,).

        As if they had turned; or else they tell nothing. Looks will tell which.
        """
        other, function = self.copy(), self.gripper.function
        was = function.at_all(np.zeros((1, self.motors)))[0][0]
        now, moved = home.reshape(2, 2), np.flatnonzero(cameras)
        other.map([turned(int(camera), was[camera], now[camera]) for camera in moved])
        deviations = np.zeros((2, 2))
        deviations[0, moved] = self.TURNED_SHARE * lengths(now - was)[moved]
        deviations[1, moved] = WIDE_STD
        other.gripper.doubt_one_of(deviations)
        other.object.doubt_one_of(deviations)
        return other

    def errors(self, pairs: Pairs) -> tuple[Array, Array]:
        """How far gripper and object are seen from where they should be; zero where the object is not seen.

        Returns:
            Errors (2, n, 2) of gripper and object in each camera, in pixels, and the same in units of their
            standard deviation.
        """
        gripper, gripper_variances, _ = self.gripper_errors(pairs)
        object_, object_variances, _ = self.object_errors(pairs)
        errors_px = np.linalg.norm([gripper, object_], axis=-1) / IMAGE_UNIT
        return errors_px, errors_px * IMAGE_UNIT / np.sqrt([gripper_variances, object_variances])

    def gripper_errors(self, pairs: Pairs, old: Array | None = None) -> tuple[Array, Array, Array]:
        """How far the gripper is seen from where it should be, in image units.

        Args:
            pairs: What was seen.
            old: The registers (n, m) that led there, where others do now.

        Returns:
            Errors (n, 2, 2), their variances (n, 2), and how points change with registers (n, 2, 2, m).
        """
        points, variances, slopes = self.gripper.function.at_all(pairs.registers if old is None else old)
        noise = np.square(pairs.noise_px * IMAGE_UNIT)
        return pairs.sensors.reshape(-1, 2, 2) - points, variances + noise[:, None], slopes

    def object_errors(self, pairs: Pairs, old: Array | None = None) -> tuple[Array, Array, Array]:
        """The same of the object; nothing where it was not seen, and what is known of it says nothing."""
        points, variances, slopes = self.object.function.at_all(
            np.column_stack([pairs.registers if old is None else old, pairs.homes])
        )
        errors = (pairs.objects - pairs.homes).reshape(-1, 2, 2) - points
        return (
            np.where(np.isfinite(errors), errors, 0.0),
            variances + 2 * np.square(pairs.noise_px * IMAGE_UNIT)[:, None],
            slopes,
        )

    def agrees_with(self, pairs: Pairs, other: Self) -> bool:
        """Whether most pairs are seen where they should be, and on average nearer there than by `other`.

        Most may agree with both: a motor that has reversed shows only where it has moved.
        """
        errors_px, by_other_px = (each.errors(pairs)[0].max(0) for each in (self, other))
        agrees = np.median(errors_px) < HomeView.SIGMAS * pairs.noise_px.mean()
        return bool(agrees and errors_px.mean() < by_other_px.mean())

    def evidence(self, pairs: Pairs) -> float:
        """The logarithm of how probable pairs are, given what is known."""
        return self.gripper.evidence(*self._gripper_looks(pairs)) + self.object.evidence(
            *self._object_looks(pairs)
        )

    def copy(self) -> Self:
        """A second one that knows the same."""
        other = copy.copy(self)
        other.gripper, other.object = copy.copy(self.gripper), copy.copy(self.object)
        return other

    def nothing(self) -> Self:
        """A second one that knows nothing."""
        return type(self)(self.motors, self.looks)

    def copy_of(self, arrays: Arrays) -> Self:
        """A second one that knows what `arrays` returned."""
        other = self.nothing()
        other.restore(arrays)
        return other

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All that it knows, as named arrays."""
        return prefixed("gripper", self.gripper.arrays()) | prefixed("object", self.object.arrays())

    def restore(self, arrays: Arrays) -> None:
        """Takes over what `arrays` returned; raises ValueError where it does not fit."""
        self.gripper.restore(under("gripper", arrays))
        self.object.restore(under("object", arrays))


def _changed(changes: Sequence[CameraChange] | Sequence[ArmChange], sensors: Array) -> Array:
    """Sensor vectors (n, 4) after all changes: each camera's by what both cameras saw before any of them."""
    found = sensors
    for change in changes:
        changed = change.sensors(sensors)
        found = np.where(changed != sensors, changed, found)
    return found
