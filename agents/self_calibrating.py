"""The calibrated robot that calibrates itself, and never ceases to (paper, sections 1 and 2.2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from agents.agent import Look, Procedure, ProcedureAgent
from agents.calibrated_model import CalibratedModel
from agents.identification import Identification, Looks, identify, model_of
from agents.jacobian import TestMotions, displacement_px
from agents.servo.trial import Trial
from calfree_gym.world import nominal


class SelfCalibrating(ProcedureAgent):
    """Identifies cameras, arm and motors from its own motions, and acts by the model.

    It knows of what kind cameras, arm and motors are, and how they were meant to be; not where the cameras
    are now, how they are turned and zoomed, how far the arm is off, or what words do to it.

    Identification needs no phase of its own: a trial that begins with nothing known begins with test motions,
    and goes on as soon as there is a model. Every further look, in failure and success, refits it. `learn`
    keeps looks and model for later trials; `predict` refits for the trial only.

    Args:
        camera_mount: What the cameras are fixed to: "waist" or "stand".
    """

    FIRST_WORD = 0.04
    TEST_PX = 30.0
    TOGETHER = np.array([[1.0, 1.0, -1.0], [-1.0, 1.0, 1.0]])
    """Test motions of all motors at once, in units of their test words."""
    SURPRISE = 50.0
    """Two looks in a row that surprise the model by more end its validity, see `Identification.surprise`."""
    TRIES, MISSED = 6, 6.0
    """So does missing the object by so many times the noise after so many motions."""
    MEMORY = 80
    """Looks kept from earlier trials."""

    def __init__(self, env: gym.Env[Any, Any], camera_mount: str = "waist", seed: int = 0) -> None:
        super().__init__(env, seed)
        self.camera_mount = camera_mount
        self.looks = Looks.none()
        self.known: Identification | None = None
        self._built = CalibratedModel.of(nominal(), camera_mount)

    @property
    def kind(self) -> str:
        """See `ProcedureAgent`."""
        return f"SelfCalibrating(camera_mount={self.camera_mount!r})"

    def procedure(self, look: Look) -> Procedure:
        """See `ProcedureAgent`."""
        earlier, known = self.looks, self.known
        trial, doubts, tries = [look], 0, 0
        while True:
            if known is None:
                yield from _noting(self._explore(trial[-1]), trial)
                known, tries = identify(earlier.and_trial(trial), self._built), 0
            latest = identify(earlier.and_trial(trial), self._built, known)
            doubts = doubts + 1 if known.surprise(latest) > self.SURPRISE else 0
            missed_px = displacement_px(trial[-1].distance)
            if doubts == 2 or (tries >= self.TRIES and missed_px > self.MISSED * latest.noise_px):
                earlier, trial, known, doubts = Looks.none(), trial[-2:], None, 0
                continue
            known = known if doubts else latest
            model = model_of(self._built, latest.signs, latest.parameters)
            before = trial[-1]
            trial.append((yield model.registers(latest.objects[-1]) - before.registers))
            tries += 1
            while not trial[-1].visible.all():
                trial.append((yield (before.registers - trial[-1].registers) / 2))

    def _explore(self, look: Look) -> Procedure:
        """Test motions of each motor alone, and a few of all together."""
        trial = Trial(look, TestMotions(len(look.registers)), self.FIRST_WORD, self.TEST_PX)
        yield from trial.test_hidden()
        for signs in self.TOGETHER:
            before = trial.look
            yield from trial.move(signs * trial.test_words)
            while not trial.look.visible.all():
                yield from trial.move((before.registers - trial.look.registers) / 2)

    def learn_trial(self, looks: Sequence[Look], ended: bool) -> None:
        """See `ProcedureAgent`. Looks teach the model, however the trial ends."""
        both = self.looks.and_trial(looks)
        latest = identify(both, self._built, self.known)
        if self.known is not None and self.known.surprise(latest) > self.SURPRISE:
            both = Looks.none().and_trial(looks)
            latest = identify(both, self._built)
        self.looks = both.latest(self.MEMORY)
        self.known = identify(self.looks, self._built, latest)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """See `ProcedureAgent`."""
        return {} if self.known is None else {**vars(self.looks), **vars(self.known)}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """See `ProcedureAgent`."""
        self.looks, self.known = Looks.none(), None
        if arrays:
            self.looks = Looks(**{field.name: arrays[field.name] for field in fields(Looks)})
            self.known = Identification(
                **{field.name: arrays[field.name] for field in fields(Identification)}
            )


def _noting(motions: Procedure, looks: list[Look]) -> Procedure:
    """The same motions, with every look after them appended to `looks`."""
    words = next(motions)
    while True:
        looks.append((yield words))
        try:
            words = motions.send(looks[-1])
        except StopIteration:
            return
