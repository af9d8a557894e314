"""The agent `polynomial`: regression over polynomials, which begins with nothing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from copy import copy
from typing import Any, ClassVar, Self

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import CAMERAS

from ..base.observation import Array
from ..base.registration import agent
from ..base.storage import prefixed, under
from .images import coordinates, look_variances
from .looks import RegressionLooks
from .monomials import Exponents, exponents, monomials
from .regression import BayesianRegression
from .regression_agent import RegressionAgent

REGISTERS, OBJECT, HOME = 5, 3, 2
"""Degrees of the gripper's polynomial in registers, and of the object's in registers and in its home view.
Choice, as all numbers here; tried in wild worlds 81000 to 81002."""
MOST = 300
"""No polynomial has more monomials (a guard: decisions take their square): with more motors than three its
degree is the highest that this allows."""
BY_DEGREE = np.array([1.0, 2.0, 2.0, 1.5, 1.0, 0.7])
"""Standard deviations of coefficients by their degree in registers, in image units, of registers in words."""
BY_HOME = np.array([1.0, 1.0, 0.5])
"""Factors of these by the degree in the home view."""


class PolynomialImages:
    """The gripper's sensor vector, and how far the object's is from its home view, as polynomials.

    Gripper and object, left and right camera: each has a regression of its own.

    Args:
        motors: Number of registers m.
    """

    misfit_px: ClassVar[float] = 0.7
    """With the noise of a good marker, the pixel that was tried in wild worlds 81000 to 81002."""

    def __init__(self, motors: int) -> None:
        self._gripper = _highest((REGISTERS,), (motors,))
        object_ = _highest((OBJECT, HOME), (motors, 4))
        self._object = object_[object_[:, :motors].any(1)]
        gripper = BY_DEGREE[self._gripper.sum(1)]
        of_home = BY_HOME[self._object[:, motors:].sum(1)]
        moved = BY_DEGREE[self._object[:, :motors].sum(1)] * of_home
        self._regressions = [
            [BayesianRegression(deviations, 2) for _ in CAMERAS] for deviations in (gripper, moved)
        ]

    def copy(self) -> Self:
        other = copy(self)
        other._regressions = [[each.copy() for each in part] for part in self._regressions]
        return other

    def learn(self, looks: RegressionLooks) -> None:
        away = np.stack([np.ones(len(looks), bool), looks.registers.any(1)])
        variances = look_variances(looks, self.misfit_px)
        targets = looks.points - np.stack([np.zeros_like(looks.homes), looks.homes], 1)
        for part, features in enumerate(self._features(looks.registers, looks.homes)):
            for camera, regression in enumerate(self._regressions[part]):
                of_camera = targets[:, part, coordinates(camera)]
                told = away[part] & np.isfinite(of_camera).all(1)
                regression.learn(features[told], of_camera[told], variances[told, part])

    def points(self, registers: Array, home: Array) -> Array:
        parts = zip(self._features(registers, home[None]), self._regressions, strict=True)
        gripper, moved = (features @ np.hstack([each.mean for each in both]) for features, both in parts)
        return np.stack([gripper, home + moved], 1)

    def variances(self, registers: Array, origin: Array, home: Array) -> Array:
        there, here = (self._features(places, home[None]) for places in (registers, origin[None]))
        parts = zip(there, here, self._regressions, strict=True)
        return np.stack(
            [np.stack([each.variances(one - other) for each in both], 1) for one, other, both in parts], 1
        ).repeat(2, 2)

    def distance_variances(self, registers: Array, origin: Array, home: Array) -> Array:
        return np.asarray(self.variances(registers, origin, home).sum(1))

    def arrays(self) -> dict[str, NDArray[Any]]:
        arrays: dict[str, NDArray[Any]] = {}
        for name, regression in self._named():
            arrays |= prefixed(name, regression.arrays())
        return arrays

    def restore(self, arrays: Mapping[str, NDArray[Any]], looks: RegressionLooks) -> None:
        for name, regression in self._named():
            regression.restore(under(name, arrays))

    def _named(self) -> Iterator[tuple[str, BayesianRegression]]:
        for part, both in zip(("gripper", "object"), self._regressions, strict=True):
            for camera, regression in zip(CAMERAS, both, strict=True):
                yield f"{part} {camera}", regression

    def _features(self, registers: Array, homes: Array) -> tuple[Array, Array]:
        """Of gripper and object at registers (n, m); home views are (n, 4), or (1, 4) for all of them."""
        both = np.hstack([registers, np.broadcast_to(homes, (len(registers), 4))])
        return monomials(registers, self._gripper), monomials(both, self._object)


def _highest(degrees: tuple[int, ...], variables: tuple[int, ...]) -> Exponents:
    """Exponents of the highest total degree that has at most `MOST` monomials; at least of the first."""
    most = sum(degrees)
    while most > 1 and len(exponents(degrees, variables, most)) > MOST:
        most -= 1
    return exponents(degrees, variables, most)


@agent("polynomial", "Regression over all its looks: polynomials of registers and of the object's home view.")
class Polynomial(RegressionAgent):
    """Fits polynomials to all that it has ever seen, and goes where they have gripper and object meet.

    What everybody would try first: Bayesian linear regression, one fit for all trials. It knows no world, and
    takes arms of any number of motors.
    """

    def __init__(self, env: gym.Env[Any, Any], seed: int = 0) -> None:
        super().__init__(env, PolynomialImages(env.action_space.shape[0]), seed)  # type: ignore[index]

    @property
    def kind(self) -> str:
        return "Polynomial()"
