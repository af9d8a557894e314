"""One trial: words from the network, corrected by what the trial itself has shown."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ...base.observation import Array, Observation
from ...base.procedure import Procedure
from .inverse_model import InverseModel


@dataclass
class Reach:
    """What is known of a trial while it goes on.

    Attributes:
        latest: The last observation in which all points were seen.
        nearest: The one of them with the shortest image distance.
        idle: Motions since that one.
        kept: Whether the replay holds its first observation.
        changes: Changes of the image distance (4,) on the trial's motions.
        residuals: By how much the words (m,) of these motions differ from the network's for these changes.
    """

    latest: Observation | None = None
    nearest: Observation | None = None
    idle: int = 0
    kept: bool = False
    changes: list[Array] = field(default_factory=list)
    residuals: list[Array] = field(default_factory=list)

    def observe(self, now: Observation, model: InverseModel) -> None:
        """Takes in an observation."""
        self.idle += 1
        if not now.visible.all():
            return
        before, self.latest = self.latest, now
        if self.nearest is None or np.linalg.norm(now.distance) < np.linalg.norm(self.nearest.distance):
            self.nearest, self.idle = now, 0
        if before is not None and model.ready and (now.registers != before.registers).any():
            change = now.distance - before.distance
            self.changes.append(change)
            made = now.registers - before.registers
            self.residuals.append(made - _words(model, before, change))

    def stuck(self, patience: int, small: float) -> bool:
        """Whether it is not near, and came no nearer in `patience` motions.

        Args:
            patience: In motions.
            small: A shorter image distance is near.
        """
        near = self.nearest is not None and np.linalg.norm(self.nearest.distance) <= small
        return self.idle >= patience and not near

    def correction(self, small: float) -> Array:
        """The linear correction E (m, 4) of the network that explains the residuals, by ridge regression.

        Args:
            small: Changes of the image distance of this length are noise as much as motion.
        """
        if not self.changes:
            return np.zeros((1, 4))  # of any number of motors
        changes, residuals = np.array(self.changes), np.array(self.residuals)
        normal = changes.T @ changes + small**2 * np.eye(4)
        return np.asarray(np.linalg.solve(normal, changes.T @ residuals).T)


def _words(model: InverseModel, at: Observation, change: Array) -> Array:
    sensors = at.points.reshape(1, -1)
    return model.words(sensors, at.registers[None], change[None])[0]


def reach(
    first: Observation,
    trial: Reach,
    model: InverseModel,
    rng: np.random.Generator,
    patience: int,
    extent: float,
    adapts: bool,
) -> Procedure:
    """Asks for the change of the image distance that makes it zero, again and again.

    Where a point gets out of view, the arm goes half the way back to the nearest place so far, again and
    again. Where it is stuck, it makes a random motion.

    Args:
        first: The trial's first observation.
        trial: Filled as the trial goes on.
        model: Says the words.
        rng: Draws random ones.
        patience: In motions.
        extent: Random motions go to registers of at most this magnitude.
        adapts: Whether the trial's own motions correct the model.
    """
    now = first
    while True:
        trial.observe(now, model)
        small = model.SMALL_CHANGE * model.image_scale
        lost = not now.visible.all()
        if trial.nearest is None or not (lost or model.ready) or trial.stuck(patience, small):
            trial.idle = 0
            words = random_words(rng, now.registers, extent)
        elif lost:
            words = (trial.nearest.registers - now.registers) / 2
        else:
            words = _words(model, now, -now.distance)
            if adapts:
                words -= trial.correction(small) @ now.distance
        now = yield np.clip(words, -1, 1)


def random_words(rng: np.random.Generator, registers: Array, extent: float) -> Array:
    """Words (m,) to registers drawn uniformly within ±`extent`."""
    return rng.uniform(-extent, extent, len(registers)) - registers
