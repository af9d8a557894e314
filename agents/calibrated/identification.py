"""Identifying cameras, arm and motors by bounded least squares on image points measured at known registers.

Images alone leave some combinations of parameters open: the scale of all lengths, where the frame of the room
lies, how cameras on the waist stand to its axis as long as nothing was seen beside the work plane. A weak
prior, the robot as built, determines these.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import CAMERAS, IMAGE_UNIT, rounded
from calfree_gym.robot.arms.movemaster import AIM

from ..base.checks import checked_array
from ..base.observation import POINTS, Array
from ..base.weights import cauchy_weights
from .prediction import BOUND, COUNT, MOTORS, Measurements, Prediction, model_of, named, prior_std
from .robot_model import RobotModel

Residuals = Callable[[Array], tuple[Array, Callable[[], Array]]]
"""Residuals (starts, r) at parameters (starts, p), and what computes their derivatives (starts, r, p) there:
these cost most, and are not wanted where the search ends."""

_DAMPING, _LESS, _MORE = 1e-3, 0.1, 5.0
"""Marquardt's damping at first, and its factors after steps that were accepted and rejected: usual values
(Press et al. 2007, section 15.5, has 10⁻³, 0.1 and 10)."""
_LEAST_DAMPING, _MOST_DAMPING = 1e-9, 1e3
"""Guards: less damping changes no step, and with more there is no step that helps."""
_TOLERANCE = 1e-3
"""A search ends where a step gains less than this share of its cost. Tuned on wild worlds 3000 and up."""


def least_squares(
    residuals: Residuals,
    start: Array,
    prior_mean: Array,
    prior_std: Array,
    bound: Array,
    steps: int,
    outlying: float,
) -> tuple[Array, Array, Array]:
    """Minimises half of ρ(residuals) + ‖(x - prior_mean) / prior_std‖² where |x - prior_mean| <= `bound`.

    Levenberg-Marquardt (Marquardt 1963), each step clipped to the bounds; all starts go their own ways at the
    same time. It ends where no start gains more than 1/1000 of its cost by a step, or after this many steps.
    ρ is Cauchy's function of the length of every two residuals, an image point's; iteratively reweighted, it
    weighs points by 1 / (1 + (length / outlying)²).

    Args:
        residuals: Of the data, in any unit.
        start: Where to begin (starts, p).
        prior_mean: Where each parameter is without data (p,).
        prior_std: Its standard deviation without data, divided by that of a residual (p,).
        bound: How far from the prior mean it can be (p,).
        steps: How many steps to make at most.
        outlying: Length of a point's residual beyond which it counts as an outlier rather than as noise.

    Returns:
        Parameters (starts, p), their residuals (starts, r) and costs (starts,).
    """
    x = np.clip(start, prior_mean - bound, prior_mean + bound)
    off, derivatives = residuals(x)
    jacobian = derivatives()
    weights, cost = _robust(off, (x - prior_mean) / prior_std, outlying)
    damping = np.full(len(x), _DAMPING)
    ended = np.zeros(len(x), bool)
    for _ in range(steps):
        step = _step(x - prior_mean, prior_std, off, jacobian, weights, damping)
        further = np.clip(x - step, prior_mean - bound, prior_mean + bound)
        further_off, derivatives = residuals(further)
        further_weights, further_cost = _robust(further_off, (further - prior_mean) / prior_std, outlying)
        better = further_cost < cost
        ended = np.where(better, cost - further_cost < _TOLERANCE * cost, damping > _MOST_DAMPING)
        damping = np.where(better, np.maximum(_LESS * damping, _LEAST_DAMPING), _MORE * damping)
        for kept, new in ((x, further), (off, further_off), (weights, further_weights)):
            kept[better] = new[better]
        cost = np.minimum(cost, further_cost)
        if ended.all():
            break
        if better.all():
            jacobian = derivatives()
        elif better.any():
            jacobian[better] = derivatives()[better]
    return x, off, cost


def _step(
    from_mean: Array, prior_std: Array, off: Array, jacobian: Array, weights: Array, damping: Array
) -> Array:
    """Marquardt's step (starts, p) along the gradient: x - step is where to go.

    JᵀWJ is a matrix by its own transpose, start by start: BLAS takes half the time for that.
    """
    roots = np.sqrt(weights)
    root_w_j = roots[..., None] * jacobian
    jt_w_off = np.array([j.T @ r for j, r in zip(root_w_j, roots * off, strict=True)])
    gradient = from_mean / prior_std**2 + jt_w_off
    normal = np.array([j.T @ j for j in root_w_j])
    diagonal = np.einsum("bii->bi", normal)
    diagonal += 1 / prior_std**2
    diagonal *= 1 + damping[:, None]
    return np.asarray(np.linalg.solve(normal, gradient[..., None])[..., 0])


def _robust(off: Array, from_mean: Array, outlying: float) -> tuple[Array, Array]:
    """Weights (starts, r) of the residuals, and costs (starts,).

    Args:
        off: Residuals (starts, r).
        from_mean: Distances from the prior mean in standard deviations (starts, p).
        outlying: See `least_squares`.
    """
    lengths = np.sqrt((off * off).reshape(len(off), -1, 2).sum(-1)) / outlying
    cost = outlying**2 * np.log1p(lengths * lengths).sum(-1) + (from_mean * from_mean).sum(-1)
    return np.repeat(cauchy_weights(lengths), 2, -1), cost / 2


OBJECT_PRIOR_STD = np.array([0.2, 0.3, 0.15])
OBJECT_BOUND = np.array([0.6, 0.8, 0.5])
"""Of the objects' places about the middle of the work space, `AIM`, in m. The simulator draws objects with
standard deviations of 0.10, 0.19 and 0.07: a weak prior has about twice that. At least twice the work space
bounds them (a guard: the frame of the room may come out shifted)."""
_INSIDE_BOUND = 0.9
"""Triangulated objects are brought within this share of their bounds (a guard: on a bound nothing moves)."""
_SIGNS = np.array(list(product([1.0, -1.0], repeat=MOTORS)))
"""All that the motors' signs can be."""
_SCREENING_STEPS, _FITTING_STEPS = 8, 60
"""Of least squares with each set of signs, then with the best of them; a fit from what is known takes two or
three of the latter. Tuned on wild worlds 3000 and up."""
_GO_ON_WITH = 2
"""This many sets of signs go on after screening: tuned likewise."""
_LARGEST_ZOOM = 0.4
"""Of the start, as a logarithm: what the wild worlds' cameras have, a factor of 0.67 to 1.5."""
_FAR_PX = 40.0
"""Residuals beyond this count as outliers as long as nothing is known: tuned likewise."""
_OUTLYING = 8.0
"""Then those beyond this many times the noise do: tuned likewise, with and without mistaken points."""
_LEAST_NOISE_PX = 1.0
"""Against the prior, image points count as if they were at least so noisy: model errors add to their noise.
Tuned likewise."""


@dataclass(frozen=True)
class Identification:
    """What was identified from measurements.

    Attributes:
        signs: Of the motors (3,).
        parameters: How the robot differs from the robot as built (COUNT,), in the order of `PARAMETERS`.
        objects: Where the trials' objects are (trials, 3) in m.
        residuals_px: Predicted less measured image points (n, 4, 2); 0 where not seen.
        cost: Of the least squares, in px².
    """

    signs: Array
    parameters: Array
    objects: Array
    residuals_px: Array
    cost: Array

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]], measurements: Measurements) -> Identification:
        """What was saved under the names of the attributes, as identified from `measurements`.

        Raises:
            ValueError: An array is missing or of a wrong shape.
        """
        return cls(
            signs=checked_array(arrays, "signs", (MOTORS,)),
            parameters=checked_array(arrays, "parameters", (COUNT,)),
            objects=checked_array(arrays, "objects", (measurements.trials, 3)),
            residuals_px=checked_array(arrays, "residuals_px", (len(measurements.trial), POINTS, 2)),
            cost=checked_array(arrays, "cost", ()),
        )

    def model(self, built: RobotModel) -> RobotModel:
        """The robot that was identified."""
        return model_of(built, self.signs, self.parameters)

    def innovation(self, later: Identification, noise_px: float) -> float:
        """By how much `later`, of the same measurements and more, contradicts this.

        The least cost rises by half the squared innovation of the further measurements, in units of its
        standard deviation (which includes what was not known well): about 4 for each of them in a world that
        stands still, half of its 8 coordinates.

        Returns:
            The rise in units of the noise, for each further measurement.
        """
        further = max(len(later.residuals_px) - len(self.residuals_px), 1)
        return float(later.cost - self.cost) / noise_px**2 / further


def identify(
    measurements: Measurements,
    built: RobotModel,
    noise_px: float = 0.5,
    known: Identification | None = None,
    lacking: Collection[str] = (),
) -> Identification:
    """What explains `measurements` best.

    Args:
        measurements: Of one trial or several.
        built: The robot as built.
        noise_px: Standard deviation of an image coordinate.
        known: Where to start. Without it, it starts eight times, once for each set of motor signs, with the
            cameras rolled and zoomed as fits these signs, and goes on with the two that have come furthest.
        lacking: Names of parameters that the model lacks: they stay as built.
    """
    fit = _LeastSquares(measurements, built, noise_px, lacking)
    if known is None:
        known = _identify_from_nothing(fit)
    objects = _triangulated(measurements, known.model(built))
    start = np.concatenate([known.parameters, objects.ravel()])
    return fit(known.signs[None], start[None], _FITTING_STEPS, _OUTLYING * noise_px)[0]


class _LeastSquares:
    """Least squares on the same measurements, with sets of motor signs each from a start of its own."""

    def __init__(
        self, measurements: Measurements, built: RobotModel, noise_px: float, lacking: Collection[str]
    ) -> None:
        trials = measurements.trials
        self.measurements = measurements
        self.built = built
        self._prior_mean = np.concatenate([np.zeros(COUNT), np.tile(AIM, trials)])
        std = np.concatenate([prior_std(lacking), np.tile(OBJECT_PRIOR_STD, trials)])
        self._prior_std_by_px = std / max(noise_px, _LEAST_NOISE_PX)
        self._bound = np.concatenate([BOUND, np.tile(OBJECT_BOUND, trials)])
        self._per_px = measurements.seen[..., None] / IMAGE_UNIT

    def __call__(self, signs: Array, start: Array, steps: int, outlying_px: float) -> list[Identification]:
        """What comes out of each set of signs (s, 3) and each start (s, COUNT + 3 trials)."""

        def residuals(x: Array) -> tuple[Array, Callable[[], Array]]:
            prediction = Prediction(self.measurements, self.built, signs, x)

            def derivatives() -> Array:
                by_x = prediction.derivatives()
                by_x *= self._per_px[..., None]
                return by_x.reshape(len(x), -1, x.shape[1])

            off_px = (prediction.points - self.measurements.points) * self._per_px
            return off_px.reshape(len(x), -1), derivatives

        x, off_px, cost = least_squares(
            residuals, start, self._prior_mean, self._prior_std_by_px, self._bound, steps, outlying_px
        )
        return [
            Identification(
                signs=signs[i],
                parameters=x[i, :COUNT],
                objects=x[i, COUNT:].reshape(-1, 3),
                residuals_px=off_px[i].reshape(-1, POINTS, 2),
                cost=cost[i],
            )
            for i in range(len(x))
        ]


def _identify_from_nothing(fit: _LeastSquares) -> Identification:
    """The best of all sets of motor signs."""
    objects = np.tile(AIM, fit.measurements.trials)
    starts = [np.concatenate([_rolled_and_zoomed(fit, signs), objects]) for signs in _SIGNS]
    screened = fit(_SIGNS, np.array(starts), _SCREENING_STEPS, _FAR_PX)
    best = sorted(screened, key=lambda each: rounded(each.cost))[:_GO_ON_WITH]
    signs = np.array([each.signs for each in best])
    starts = [np.concatenate([each.parameters, each.objects.ravel()]) for each in best]
    return min(fit(signs, np.array(starts), _FITTING_STEPS, _FAR_PX), key=lambda each: rounded(each.cost))


def _rolled_and_zoomed(fit: _LeastSquares, signs: Array) -> Array:
    """Parameters (COUNT,) of the robot as built with each camera rolled and zoomed as fits best what it saw.

    The rotation and scale that take predicted displacements to measured ones, in closed form: image points
    are complex numbers, a rotation and scale one factor, found by least squares.
    """
    measured, built = fit.measurements, fit.built
    objects = np.tile(AIM, (len(measured.trial), 1))
    predicted = model_of(built, signs, np.zeros(COUNT)).points(measured.registers, objects)
    start = np.zeros(COUNT)
    off = named(start)
    for camera in range(len(CAMERAS)):
        overlap, square = 0.0 + 0.0j, 0.0
        for point in (camera, len(CAMERAS) + camera):
            for trial in range(measured.trials):
                rows = (measured.trial == trial) & measured.seen[:, point]
                if not rows.any():
                    continue
                expected, seen = (
                    points[rows, point, 0] + 1j * points[rows, point, 1]
                    for points in (predicted, measured.points)
                )
                expected, seen = expected - expected.mean(), seen - seen.mean()
                overlap += np.vdot(expected, seen)
                square += np.vdot(expected, expected).real
        if not square:  # it has shown nothing twice
            continue
        off["camera_turn"][camera, 2] = np.angle(overlap)
        zoom = np.log(np.abs(overlap) / square)
        off["focal_length"][camera] = np.clip(zoom, -_LARGEST_ZOOM, _LARGEST_ZOOM)
    return start


def _triangulated(measurements: Measurements, model: RobotModel) -> Array:
    """Where the trials' objects (trials, 3) were last seen by `model`; where they never were, `AIM`."""
    objects = np.tile(AIM, (measurements.trials, 1))
    rows = np.flatnonzero(measurements.seen[:, 2:].all(1))
    objects[measurements.trial[rows]] = model.triangulate(
        measurements.points[rows, 2:].reshape(-1, 4), model.joints(measurements.registers[rows])
    )
    return np.clip(objects, AIM - _INSIDE_BOUND * OBJECT_BOUND, AIM + _INSIDE_BOUND * OBJECT_BOUND)
