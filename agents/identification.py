"""Identifying cameras, arm and motors by bounded least squares on the image points seen at known registers.

Images alone leave some combinations of parameters open: the scale of all lengths, where the frame of the room
lies, how cameras on the waist stand to its axis as long as nothing was seen beside the work plane. These are
held by a weak pull towards the robot as built.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from agents.agent import Array, Look
from agents.calibrated_model import CalibratedModel
from agents.jacobian import Flags, both_points, both_seen
from calfree_gym.world import AIM, IMAGE_UNIT

PARAMETERS = (
    ("camera_position", (2, 3), 0.05, 0.15),
    ("camera_tilt", (2, 2), 0.15, 0.6),
    ("camera_roll", (2, 1), 10.0, 20.0),
    ("focal_length", (2,), 0.25, 0.8),
    ("lens_k1", (2,), 0.05, 0.15),
    ("link_lengths", (5,), 0.06, 0.2),
    ("joint_zeros", (4,), 0.10, 0.3),
    ("motor_gain", (3,), 0.4, 0.9),
    ("motor_curvature", (3,), 0.2, 0.43),
)
"""What may be off from the robot as built: name, shape, by how much as a rule, and at most. Positions are in
m, angles in rad, focal lengths and gains logarithms of a factor, link lengths shares; rolls are left open."""
_SIZES = [int(np.prod(shape)) for _, shape, _, _ in PARAMETERS]
COUNT = sum(_SIZES)
_ENDS = np.cumsum(_SIZES)[:-1]
_RULE = np.repeat([rule for *_, rule, _ in PARAMETERS], _SIZES)
_MOST = np.repeat([most for *_, most in PARAMETERS], _SIZES)
_OBJECT_RULE = np.array([0.2, 0.3, 0.15])
_OBJECT_MOST = np.array([0.6, 0.8, 0.5])
_LEAST_PX = 0.3
_STEP = 1e-6
_SIGNS = np.array(list(product([1.0, -1.0], repeat=3)))


@dataclass(frozen=True)
class Looks:
    """What was seen at known registers, in several trials.

    Attributes:
        registers: (n, 3).
        points: Gripper and object points (n, 8).
        seen: Which of their coordinates were seen (n, 8).
        trial: In which trial (n,), counted from 0: each has an object of its own.
    """

    registers: Array
    points: Array
    seen: Flags
    trial: Array

    @classmethod
    def none(cls) -> Looks:
        """Nothing seen yet."""
        return cls(np.zeros((0, 3)), np.zeros((0, 8)), np.zeros((0, 8), bool), np.zeros(0, int))

    @property
    def trials(self) -> int:
        """Number of trials."""
        return int(self.trial.max(initial=-1)) + 1

    def and_trial(self, looks: Sequence[Look]) -> Looks:
        """These, and those of one more trial."""
        return Looks(
            np.concatenate([self.registers, [look.registers for look in looks]]),
            np.concatenate([self.points, [both_points(look) for look in looks]]),
            np.concatenate([self.seen, [both_seen(look) for look in looks]]),
            np.concatenate([self.trial, np.full(len(looks), self.trials)]),
        )

    def latest(self, count: int) -> Looks:
        """The last `count` of them."""
        trial = self.trial[-count:]
        trial = trial - trial.min(initial=self.trials)
        return Looks(self.registers[-count:], self.points[-count:], self.seen[-count:], trial)


@dataclass(frozen=True)
class Identification:
    """What was identified from looks.

    Attributes:
        signs: Of the motors (3,).
        parameters: How far the robot is off as built (COUNT,), in the order of `PARAMETERS`.
        objects: Where the trials' objects are (trials, 3) in m.
        off_px: How far image coordinates (n, 8) are from where they should be; 0 where not seen.
        cost: Of the least squares.
    """

    signs: Array
    parameters: Array
    objects: Array
    off_px: Array
    cost: Array

    @property
    def noise_px(self) -> float:
        """Standard deviation of an image coordinate, as far as the parameters have not adapted to it."""
        free = np.count_nonzero(self.off_px) - COUNT - self.objects.size
        return max(float(np.sqrt((self.off_px**2).sum() / max(free, 8))), _LEAST_PX)

    def surprise(self, later: Identification) -> float:
        """By how much `later`, of the same looks and more, had to give way to each of the further looks.

        The least cost rises by half the squared innovation of the further looks, in units of its standard
        deviation (which includes what was not known well): about 4 a look in a world that stands still.
        """
        further = max(len(later.off_px) - len(self.off_px), 1)
        return float(later.cost - self.cost) / self.noise_px**2 / further


def model_of(built: CalibratedModel, signs: Array, parameters: Array) -> CalibratedModel:
    """The model of a robot that is off as `built` by `parameters` (..., COUNT)."""
    from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]

    lead = parameters.shape[:-1]
    position, tilt, roll, focal, k1, lengths, zeros, gain, curvature = (
        part.reshape(lead + shape)
        for part, (_, shape, _, _) in zip(np.split(parameters, _ENDS, -1), PARAMETERS, strict=True)
    )
    turns = np.concatenate([tilt, roll], -1).reshape(-1, 3)
    return replace(
        built,
        camera_position=built.camera_position + position,
        camera_axes=built.camera_axes @ Rotation.from_euler("XYZ", turns).as_matrix().reshape(*lead, 2, 3, 3),
        focal_length=built.focal_length * np.exp(focal),
        lens_k1=built.lens_k1 + k1,
        link_lengths=built.link_lengths * (1 + lengths),
        joint_zeros=built.joint_zeros + zeros,
        motor_gain=built.motor_gain * signs * np.exp(gain),
        motor_curvature=built.motor_curvature + curvature,
    )


def identify(looks: Looks, built: CalibratedModel, known: Identification | None = None) -> Identification:
    """What explains `looks` best, beginning with what is known already.

    Without that it begins eight times, once for each set of motor signs, with the cameras rolled and zoomed
    as fits these signs, and the best of the ends wins.
    """
    if known is not None:
        model = model_of(built, known.signs, known.parameters)
        return _fit(looks, built, known.signs, known.parameters, _triangulated(looks, model))
    middle = np.tile(AIM, (looks.trials, 1))
    fits = [_fit(looks, built, signs, _rolled(looks, built, signs), middle) for signs in _SIGNS]
    return min(fits, key=lambda fit: fit.cost)


def _triangulated(looks: Looks, model: CalibratedModel) -> Array:
    """Where the trials' objects (trials, 3) were last seen by `model`; where they never were, the middle."""
    objects = np.tile(AIM, (looks.trials, 1))
    rows = np.flatnonzero(looks.seen[:, 4:].all(1))
    objects[looks.trial[rows]] = model.triangulate(
        looks.points[rows, 4:], model.joints(looks.registers[rows])
    )
    return np.clip(objects, AIM - 0.9 * _OBJECT_MOST, AIM + 0.9 * _OBJECT_MOST)


def _predicted(looks: Looks, model: CalibratedModel, objects: Array) -> Array:
    """Points (..., n, 8) that are to be seen, with the trials' objects at `objects` (..., trials, 3)."""
    joints = model.joints(looks.registers)
    gripper = model.image(model.gripper(joints), joints)
    return np.concatenate([gripper, model.image(objects[..., looks.trial, :], joints)], -1)


def _rolled(looks: Looks, built: CalibratedModel, signs: Array) -> Array:
    """Parameters (COUNT,) of the built robot with each camera rolled and zoomed as fits best what it saw.

    The rotation and scale that take predicted displacements to seen ones, in closed form.
    """
    expected = _predicted(looks, model_of(built, signs, np.zeros(COUNT)), np.tile(AIM, (looks.trials, 1)))
    roll, zoom = np.zeros(2), np.zeros(2)
    for camera in range(2):
        overlap, square = 0.0 + 0.0j, 0.0
        for point in (2 * camera, 4 + 2 * camera):
            for trial in range(looks.trials):
                rows = (looks.trial == trial) & looks.seen[:, point]
                away, seen = (
                    points[rows, point] + 1j * points[rows, point + 1] for points in (expected, looks.points)
                )
                away, seen = away - away.mean(), seen - seen.mean()
                overlap += np.vdot(away, seen)
                square += np.vdot(away, away).real
        roll[camera] = np.angle(overlap)
        zoom[camera] = np.log(np.abs(overlap) / square)
    parts = {"camera_roll": roll, "focal_length": np.clip(zoom, -0.4, 0.4)}
    return np.concatenate(
        [parts.get(name, np.zeros(size)) for (name, *_), size in zip(PARAMETERS, _SIZES, strict=True)]
    )


def _fit(
    looks: Looks, built: CalibratedModel, signs: Array, parameters: Array, objects: Array
) -> Identification:
    """Bounded least squares from `parameters` on; the objects begin where the cameras were meant to look."""
    from scipy.optimize import least_squares  # type: ignore[import-untyped]

    rule = np.concatenate([_RULE, np.tile(_OBJECT_RULE, looks.trials)])
    most = np.concatenate([_MOST, np.tile(_OBJECT_MOST, looks.trials)])
    middle = np.concatenate([np.zeros(COUNT), np.tile(AIM, looks.trials)])
    weight = looks.seen / IMAGE_UNIT

    def predicted(parameters: Array, objects: Array) -> Array:
        return _predicted(looks, model_of(built, signs, parameters), objects)

    def residuals(x: Array) -> Array:
        off = predicted(x[:COUNT], x[COUNT:].reshape(-1, 3)) - looks.points
        return np.concatenate([(off * weight).ravel(), (x - middle) / rule])

    def derivatives(x: Array) -> Array:
        """All columns from one batch of models; objects step together, as each has looks of its own."""
        parameters = x[:COUNT] + _STEP * np.eye(COUNT + 4, COUNT)
        objects = np.tile(x[COUNT:].reshape(-1, 3), (COUNT + 4, 1, 1))
        objects[COUNT : COUNT + 3] += _STEP * np.eye(3)[:, None]
        points = predicted(parameters, objects)
        slopes = np.moveaxis((points[:-1] - points[-1]) / _STEP * weight, 0, -1)
        jacobian = np.zeros((len(looks.trial), 8, len(x)))
        jacobian[..., :COUNT] = slopes[..., :COUNT]
        for axis in range(3):
            columns = COUNT + 3 * looks.trial + axis
            jacobian[np.arange(len(columns)), :, columns] = slopes[..., COUNT + axis]
        return np.concatenate([jacobian.reshape(-1, len(x)), np.diag(1 / rule)])

    start = np.concatenate([parameters, objects.ravel()])
    found = least_squares(
        residuals, start, derivatives, (middle - most, middle + most), x_scale=rule, ftol=1e-3, max_nfev=60
    )
    off = found.fun[: weight.size].reshape(-1, 8)
    return Identification(signs, found.x[:COUNT], found.x[COUNT:].reshape(-1, 3), off, found.cost)
