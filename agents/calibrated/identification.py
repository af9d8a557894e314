"""Identifying cameras, arm and motors by bounded least squares on the image points seen at known registers.

Images alone leave some combinations of parameters open: the scale of all lengths, where the frame of the room
lies, how cameras on the waist stand to its axis as long as nothing was seen beside the work plane. These are
held by a weak pull towards the robot as built.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from agents.base.observation import Array
from agents.calibrated.least_squares import least_squares
from agents.calibrated.model import CalibratedModel
from agents.calibrated.observations import Looks
from agents.calibrated.parameters import COUNT, MOST, RULE, model_of, named, predicted
from calfree_gym.image import IMAGE_UNIT
from calfree_gym.world import AIM

_OBJECT_RULE = np.array([0.2, 0.3, 0.15])
_OBJECT_MOST = np.array([0.6, 0.8, 0.5])
_SIGNS = np.array(list(product([1.0, -1.0], repeat=3)))
_SCREENING, _FITTING = 8, 60
"""Steps of the least squares with each set of motor signs, and with the best of them."""
_FAR_PX, _OUTLYING = 40.0, 8.0
"""Image points further off count as outliers as long as nothing is known; then, so many times the noise."""


@dataclass(frozen=True)
class Identification:
    """What was identified from looks.

    Attributes:
        signs: Of the motors (3,).
        parameters: How far the robot is off as built (COUNT,), in the order of `PARAMETERS`.
        objects: Where the trials' objects are (trials, 3) in m.
        off_px: How far image coordinates (n, 8) are from where they should be; 0 where not seen.
        cost: Of the least squares, in px².
    """

    signs: Array
    parameters: Array
    objects: Array
    off_px: Array
    cost: Array

    def innovation(self, later: Identification, noise_px: float) -> float:
        """By how much `later`, of the same looks and more, had to give way to each of the further looks.

        The least cost rises by half the squared innovation of the further looks, in units of its standard
        deviation (which includes what was not known well): about 4 a look in a world that stands still.
        """
        further = max(len(later.off_px) - len(self.off_px), 1)
        return float(later.cost - self.cost) / noise_px**2 / further


def identify(
    looks: Looks, built: CalibratedModel, noise_px: float = 0.5, known: Identification | None = None
) -> Identification:
    """What explains `looks` best.

    Args:
        looks: Of one trial or several.
        built: The robot as it was meant to be.
        noise_px: Standard deviation of an image coordinate.
        known: To begin with. Without it, it begins eight times, once for each set of motor signs, with the
            cameras rolled and zoomed as fits these signs, and goes on with the two that have come furthest.
    """
    if known is None:
        known = _from_nothing(looks, built, noise_px)
    model = model_of(built, known.signs, known.parameters)
    start = np.concatenate([known.parameters, _triangulated(looks, model).ravel()])
    return _fit(looks, built, noise_px, known.signs[None], start[None], _FITTING, _OUTLYING * noise_px)[0]


def _from_nothing(looks: Looks, built: CalibratedModel, noise_px: float) -> Identification:
    middle = np.tile(AIM, looks.trials)
    starts = np.array([np.concatenate([_rolled(looks, built, signs), middle]) for signs in _SIGNS])
    screened = _fit(looks, built, noise_px, _SIGNS, starts, _SCREENING, _FAR_PX)
    best = sorted(screened, key=lambda fit: fit.cost)[:2]
    signs = np.array([fit.signs for fit in best])
    starts = np.array([np.concatenate([fit.parameters, fit.objects.ravel()]) for fit in best])
    return min(_fit(looks, built, noise_px, signs, starts, _FITTING, _FAR_PX), key=lambda fit: fit.cost)


def _triangulated(looks: Looks, model: CalibratedModel) -> Array:
    """Where the trials' objects (trials, 3) were last seen by `model`; where they never were, the middle."""
    objects = np.tile(AIM, (looks.trials, 1))
    rows = np.flatnonzero(looks.seen[:, 4:].all(1))
    objects[looks.trial[rows]] = model.triangulate(
        looks.points[rows, 4:], model.joints(looks.registers[rows])
    )
    return np.clip(objects, AIM - 0.9 * _OBJECT_MOST, AIM + 0.9 * _OBJECT_MOST)


def _rolled(looks: Looks, built: CalibratedModel, signs: Array) -> Array:
    """Parameters (COUNT,) of the built robot with each camera rolled and zoomed as fits best what it saw.

    The rotation and scale that take predicted displacements to seen ones, in closed form.
    """
    model = model_of(built, signs, np.zeros(COUNT))
    joints = model.joints(looks.registers)
    objects = np.tile(AIM, (len(joints), 1))
    expected = np.concatenate([model.image(model.gripper(joints), joints), model.image(objects, joints)], -1)
    start = np.zeros(COUNT)
    off = named(start)
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
        off["camera_turn"][camera, 2] = np.angle(overlap)
        off["focal_length"][camera] = np.clip(np.log(np.abs(overlap) / square), -0.4, 0.4)
    return start


def _fit(
    looks: Looks,
    built: CalibratedModel,
    noise_px: float,
    signs: Array,
    start: Array,
    steps: int,
    outlying_px: float,
) -> list[Identification]:
    """Least squares with sets of signs (s, 3), each from its own start (s, COUNT + 3 trials)."""
    rule = np.concatenate([RULE, np.tile(_OBJECT_RULE, looks.trials)])
    most = np.concatenate([MOST, np.tile(_OBJECT_MOST, looks.trials)])
    middle = np.concatenate([np.zeros(COUNT), np.tile(AIM, looks.trials)])
    weight = looks.seen.ravel() / IMAGE_UNIT

    def residuals(x: Array) -> tuple[Array, Array]:
        points, slopes = predicted(looks, built, signs, x)
        return (points - looks.points.ravel()) * weight, slopes * weight[:, None]

    x, off, cost = least_squares(
        residuals, start, middle, rule / max(noise_px, 1.0), most, steps, outlying_px
    )
    return [
        Identification(signs[i], x[i, :COUNT], x[i, COUNT:].reshape(-1, 3), off[i].reshape(-1, 8), cost[i])
        for i in range(len(x))
    ]
