"""The agent `simulation_prior`: regression that begins with what simulated worlds have in common."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from os import PathLike
from typing import Any, ClassVar, Self

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import CAMERAS, IMAGE_UNIT

from ..base.observation import Array
from ..base.prior_knowledge import PriorKnowledge
from ..base.registration import agent
from .images import coordinates, look_variances
from .looks import RegressionLooks
from .prior import KEPT, Prior, features, load_prior
from .regression import BayesianRegression
from .regression_agent import RegressionAgent
from .residuals import ResidualProcess

LATEST = 120
"""Residuals of so many latest looks are kept. Choice, as all numbers here; tried in wild worlds 81000 to
81002."""
RESIDUAL_PX = 12.0
"""Standard deviation of residuals, in pixels."""
GRIPPER_LENGTH, OBJECT_LENGTH = 0.35, 0.5
"""Over which residuals are alike: in words, and in words and image units."""


class SimulatedImages:
    """All coordinates by one vector of weights, whose prior and features come from simulated worlds.

    After ALPaCA (Harrison et al. 2018): there a network makes the features, here a principal component
    analysis. What is left is a Gaussian process over the latest looks.

    Args:
        prior: Of the mount.
    """

    misfit_px: ClassVar[float] = 1.3
    """With the noise of a good marker, the 1.5 pixels that were tried in wild worlds 81000 to 81002."""

    def __init__(self, prior: Prior) -> None:
        self._prior = prior
        self._weights = BayesianRegression(prior.deviations, 1)
        self._latest = RegressionLooks.none(3)
        self._residuals: list[list[ResidualProcess]] = []

    def copy(self) -> Self:
        other = copy(self)
        other._weights = self._weights.copy()
        return other

    def learn(self, looks: RegressionLooks) -> None:
        design, mean = self._design(looks.registers, looks.homes)
        variances = look_variances(looks, self.misfit_px).repeat(4, 1).reshape(-1, 2, 4)
        away = np.stack([np.ones(len(looks), bool), looks.registers.any(1)], 1)
        told = away[:, :, None] & np.isfinite(looks.points)
        self._weights.learn(design[told], (looks.points - mean)[told][:, None], variances[told])
        self._latest = (self._latest + looks).only(slice(-LATEST, None))
        self._residuals = self._processes(self._latest)

    def arrays(self) -> dict[str, NDArray[Any]]:
        return self._weights.arrays()

    def restore(self, arrays: Mapping[str, NDArray[Any]], looks: RegressionLooks) -> None:
        self._weights.restore(arrays)
        self._latest = looks.only(slice(-LATEST, None))
        self._residuals = self._processes(self._latest)

    def _processes(self, looks: RegressionLooks) -> list[list[ResidualProcess]]:
        """Of gripper and object, in each camera."""
        residuals = looks.points - self._linear(looks.registers, looks.homes)
        variances, places = look_variances(looks, 0.0), self._places(looks.registers, looks.homes)
        processes = []
        for part, length in enumerate((GRIPPER_LENGTH, OBJECT_LENGTH)):
            of_part = []
            for camera in range(len(CAMERAS)):
                of_camera = residuals[:, part, coordinates(camera)]
                told = np.isfinite(of_camera).all(1)
                seen = places[part][told], of_camera[told], variances[told, part]
                of_part.append(ResidualProcess(*seen, RESIDUAL_PX * IMAGE_UNIT, length))
            processes.append(of_part)
        return processes

    def points(self, registers: Array, home: Array) -> Array:
        points = self._linear(registers, home[None])
        for part, places in enumerate(self._places(registers, home[None])):
            if self._residuals:
                points[:, part] += np.hstack([each.mean(places) for each in self._residuals[part]])
        return points

    def variances(self, registers: Array, origin: Array, home: Array) -> Array:
        changes = self._changes(registers, origin, home)
        return self._weights.variances(changes.reshape(-1, changes.shape[-1])).reshape(-1, 2, 4)

    def distance_variances(self, registers: Array, origin: Array, home: Array) -> Array:
        changes = self._changes(registers, origin, home)
        changes = (changes[:, 0] - changes[:, 1]).reshape(-1, changes.shape[-1])
        return self._weights.variances(changes).reshape(-1, 4)

    def _changes(self, registers: Array, origin: Array, home: Array) -> Array:
        design, _ = self._design(np.vstack([registers, origin]), home[None])
        return np.asarray(design[:-1] - design[-1])

    def _linear(self, registers: Array, homes: Array) -> Array:
        design, mean = self._design(registers, homes)
        return np.asarray(mean + design @ self._weights.mean[:, 0])

    def _design(self, registers: Array, homes: Array) -> tuple[Array, Array]:
        """Features (n, 2, 4, k) of gripper and object, and what they add to (n, 2, 4)."""
        gripper, moved = features(registers, homes)
        here, parts = len(registers), np.split(np.arange(len(self._prior.mean)), [gripper.shape[1]])
        design, mean = np.empty((here, 2, *self._prior.basis.shape[1:])), np.empty((here, 2, 4))
        for part, (terms, each) in enumerate(zip(parts, (gripper, moved), strict=True)):
            basis = self._prior.basis[terms].reshape(len(terms), -1)
            design[:, part] = (each @ basis).reshape(design[:, part].shape)
            mean[:, part] = each @ self._prior.mean[terms]
        mean[:, 1] += homes
        return design, mean

    @staticmethod
    def _places(registers: Array, homes: Array) -> tuple[Array, Array]:
        return registers, np.hstack([registers, np.broadcast_to(homes, (len(registers), 4))])


@agent(
    "simulation_prior",
    "Such a regression with a prior from simulated worlds, and a Gaussian process on the rest.",
    arms="movemaster",
)
class SimulationPrior(RegressionAgent):
    """Knows beforehand which images are likely, from hundreds of simulated worlds (domain randomisation).

    Its prior was made by `python -m agents.rivals.train`, one for each mount, with the built arm: it takes no
    other one. Which motor is which it knows from there, too.

    Attributes:
        training: How the prior was made: command, worlds, CPU seconds, versions.

    Args:
        env: The environment, with the built arm.
        camera_mount: What the cameras are fixed to: "waist" or "stand".
        seed: Of places and probes that are drawn.
        prior: File of other priors than those kept with the code.
    """

    prior_knowledge = RegressionAgent.prior_knowledge | {
        PriorKnowledge.CAMERA_MODEL,
        PriorKnowledge.MOUNT,
        PriorKnowledge.MOTOR_ORDER,
        PriorKnowledge.WORD_LIMIT,
        PriorKnowledge.TRAINING_WORLDS,
    }

    def __init__(
        self, env: gym.Env[Any, Any], camera_mount: str = "waist", seed: int = 0, prior: str | None = None
    ) -> None:
        if not isinstance(prior, str | PathLike | None):
            raise ValueError(f"prior is {prior!r}; it must be the name of a file")
        motors = env.action_space.shape[0]  # type: ignore[index]
        known, self.training = load_prior(KEPT if prior is None else prior, camera_mount, motors)
        super().__init__(env, SimulatedImages(known), seed)
        self.camera_mount, self._prior = camera_mount, known.checksum

    @property
    def kind(self) -> str:
        return f"SimulationPrior(camera_mount={self.camera_mount!r}, prior={self._prior:08x})"
