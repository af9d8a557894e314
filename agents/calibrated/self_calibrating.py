"""The calibrated robot that calibrates itself, and never ceases to (paper, sections 1 and 2.2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from agents.base.agent import Array, Look, Procedure, ProcedureAgent, relive
from agents.calibrated.identification import Identification, identify
from agents.calibrated.model import CalibratedModel
from agents.calibrated.model_based import move_by_model
from agents.calibrated.observations import Looks
from agents.calibrated.parameters import model_of
from agents.jacobian import TestMotions, displacement_px
from agents.servo.trial import Motions, Trial
from calfree_gym.world import nominal


class Calibration:
    """What is known of the robot, and from which looks.

    Attributes:
        looks: Those of earlier trials, and of this one.
        known: What was identified from them; None before there were enough.
    """

    def __init__(self, looks: Looks, known: Identification | None) -> None:
        self.looks = looks
        self.known = known


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

    SURPRISE = 50.0
    """A look that surprises the model by more puts it into doubt, see `Identification.surprise`."""
    TRIES, MISSED = 6, 8.0
    """So does missing the object by so many times the noise after so many motions."""
    DOUBTS = 2
    """So many in a row end its validity."""
    LOOKS = 3
    """But not before so many looks at one place have told how noisy they are."""
    MEMORY = 80
    """Looks kept from earlier trials at most; of more, the later half is."""

    def __init__(self, env: gym.Env[Any, Any], camera_mount: str = "waist", seed: int = 0) -> None:
        super().__init__(env, seed)
        self.camera_mount = camera_mount
        self.calibration = Calibration(Looks.none(), None)
        self._built = CalibratedModel.of(nominal(), camera_mount)

    @property
    def kind(self) -> str:
        """See `ProcedureAgent`."""
        return f"SelfCalibrating(camera_mount={self.camera_mount!r})"

    def procedure(self, look: Look) -> Procedure:
        """See `ProcedureAgent`."""
        return self.seek(look, Calibration(self.calibration.looks, self.calibration.known))

    def seek(self, look: Look, calibration: Calibration) -> Procedure:
        """The procedure, which keeps what it finds out in `calibration`."""
        trial = _NotedTrial(look)
        yield from trial.begin()
        earlier, known = calibration.looks, calibration.known
        doubts = tries = 0
        noise_known = False
        while True:
            if known is None:
                yield from trial.explore()
                known, tries = identify(earlier.and_trial(trial.looks), self._built, trial.noise_px), 0
            looks = earlier.and_trial(trial.looks)
            latest = identify(looks, self._built, trial.noise_px, known)
            missed = displacement_px(trial.look.distance) > self.MISSED * trial.noise_px
            surprising = known.surprise(latest, trial.noise_px) > self.SURPRISE
            doubts = doubts + 1 if surprising or (missed and tries >= self.TRIES) else 0
            if doubts == self.DOUBTS and not noise_known:
                yield from trial.look_again(self.LOOKS)
                doubts, noise_known = doubts - 1, True
                continue
            if doubts == self.DOUBTS:
                earlier, known, doubts = Looks.none(), None, 0
                trial.looks = trial.looks[-self.DOUBTS :]
                continue
            known = known if doubts else latest
            calibration.looks, calibration.known = looks, latest
            model = model_of(self._built, latest.signs, latest.parameters)
            yield from trial.go(model, latest.objects[-1])
            tries += 1

    def learn_trial(self, looks: Sequence[Look], ended: bool) -> None:
        """See `ProcedureAgent`. Looks teach the model, however the trial ends."""
        calibration = Calibration(self.calibration.looks, self.calibration.known)
        relive(self.seek(looks[0], calibration), looks)
        if len(calibration.looks.trial) > self.MEMORY:
            calibration.looks = calibration.looks.latest(self.MEMORY // 2)
            calibration.known = identify(calibration.looks, self._built, known=calibration.known)
        self.calibration = calibration

    def arrays(self) -> dict[str, NDArray[Any]]:
        """See `ProcedureAgent`."""
        known = self.calibration.known
        return {} if known is None else {**vars(self.calibration.looks), **vars(known)}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """See `ProcedureAgent`."""
        self.calibration = Calibration(Looks.none(), None)
        if arrays:
            looks = Looks(**{field.name: arrays[field.name] for field in fields(Looks)})
            known = Identification(**{field.name: arrays[field.name] for field in fields(Identification)})
            self.calibration = Calibration(looks, known)


class _NotedTrial(Trial):
    """A trial whose looks are noted.

    Attributes:
        looks: Those that can be trusted.
    """

    FIRST_WORD = 0.04
    TEST_PX = 30.0
    TOGETHER = np.array([[1.0, 1.0, -1.0], [-1.0, 1.0, 1.0]])
    """Test motions of all motors at once, in units of their test words."""

    def __init__(self, look: Look) -> None:
        super().__init__(look, TestMotions(len(look.registers)), self.FIRST_WORD, self.TEST_PX)
        self.looks: list[Look] = []

    @property
    def noise_px(self) -> float:
        """Standard deviation of an image coordinate."""
        return self.senses.noise_px

    def begin(self) -> Motions:
        """See `Trial`."""
        yield from super().begin()
        self.looks.append(self.look)

    def move(self, words: Array) -> Motions:
        """See `Trial`."""
        made = yield from super().move(words)
        self.looks.append(self.look)
        return made

    def look_again(self, times: int) -> Motions:
        """Looks so many times without a motion, and keeps none of these looks."""
        for _ in range(times):
            yield from super().move(np.zeros(len(self.look.registers)))

    def explore(self) -> Motions:
        """Test motions of each motor alone, and a few of all together."""
        self.forget()
        yield from self.test_hidden()
        for signs in self.TOGETHER:
            yield from self.move_in_view(signs * self.test_words)

    def go(self, model: CalibratedModel, object_: Array) -> Motions:
        """Goes to the object by `model`, see `move_by_model`."""
        words = model.registers(object_) - self.look.registers
        looks = yield from move_by_model(model, object_, self.senses, self.look, words)
        self.look = looks[-1]
        self.looks += looks
