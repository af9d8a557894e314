"""The calibrated robot that calibrates itself, and never ceases to (paper, sections 1 and 2.2)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from enum import Enum
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from agents.base.observation import Array, Observation
from agents.base.procedure import Procedure, ProcedureAgent
from agents.calibrated.identification import Identification, identify
from agents.calibrated.model import CalibratedModel
from agents.calibrated.model_based import move_by_model
from agents.calibrated.observations import Looks
from agents.calibrated.parameters import model_of
from agents.jacobian import TestMotions
from agents.servo.trial import Findings, Motions, Trial
from calfree_gym.world import nominal


@dataclass
class Calibration:
    """What is known of the robot, and from which observations.

    Attributes:
        observations: Those of earlier trials, and of this one.
        known: What was identified from them; None before there were enough.
    """

    observations: Looks
    known: Identification | None


class Validity(Enum):
    """Whether what was identified still holds."""

    VALID = "the latest observations agree with it"
    DOUBTED = "they do not, once: the robot acts by the latest fit, and keeps the earlier one for comparison"
    NOISE_UNKNOWN = "they do not, again; but nobody knows yet how noisy they are"
    INVALID = "they do not, again: all that was known is dropped"


class ValidityCheck:
    """Judges by each motion whether what was identified still holds."""

    INCONSISTENT = 50.0
    """Observations are inconsistent with the model where the least cost rises by more, see
    `Identification.innovation`; about 4 an observation is usual. Tuned on wild worlds 3000 and up."""
    TRIES, MISSED = 6, 8.0
    """So are they where the object is missed by so many times the noise after so many motions: tuned."""
    DOUBTS = 2
    """So many in a row end its validity: one may be a mistaken point."""

    def __init__(self) -> None:
        self._doubts = self._tries = 0
        self._noise_known = False

    def begin(self) -> None:
        """Something new was identified."""
        self._tries = 0

    def judge(self, innovation: float, distance_px: float, noise_px: float) -> Validity:
        """What the latest observation says of the model.

        Args:
            innovation: See `Identification.innovation`.
            distance_px: Image distance between gripper and object.
            noise_px: Standard deviation of an image coordinate.
        """
        missed = self._tries >= self.TRIES and distance_px > self.MISSED * noise_px
        self._doubts = self._doubts + 1 if missed or innovation > self.INCONSISTENT else 0
        if self._doubts < self.DOUBTS:
            self._tries += 1
            return Validity.DOUBTED if self._doubts else Validity.VALID
        if not self._noise_known:
            self._doubts, self._noise_known = self._doubts - 1, True
            return Validity.NOISE_UNKNOWN
        self._doubts = 0
        return Validity.INVALID


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

    OBSERVATIONS = 3
    """So many at one place tell how noisy they are: `NoiseEstimate.ENOUGH` differences."""
    MEMORY = 80
    """Observations kept from earlier trials at most; of more, the later half is. Their number bounds the time
    that a fit takes."""

    def __init__(self, env: gym.Env[Any, Any], camera_mount: str = "waist", seed: int = 0) -> None:
        super().__init__(env, seed)
        self.camera_mount = camera_mount
        self.calibration = Calibration(Looks.none(), None)
        self._built = CalibratedModel.of(nominal(), camera_mount)

    @property
    def kind(self) -> str:
        """See `ProcedureAgent`."""
        return f"SelfCalibrating(camera_mount={self.camera_mount!r})"

    def new_findings(self) -> Calibration:
        """See `ProcedureAgent`."""
        return Calibration(self.calibration.observations, self.calibration.known)

    def procedure(self, first: Observation, findings: Calibration) -> Procedure:
        """See `ProcedureAgent`. The findings begin with what earlier trials have taught."""
        trial = _RecordedTrial(first)
        yield from trial.begin()
        earlier, known = findings.observations, findings.known
        validity = ValidityCheck()
        while True:
            if known is None:
                yield from trial.explore()
                known = identify(earlier.and_trial(trial.recorded), self._built, trial.noise_px)
                validity.begin()
            observations = earlier.and_trial(trial.recorded)
            latest = identify(observations, self._built, trial.noise_px, known)
            innovation = known.innovation(latest, trial.noise_px)
            match validity.judge(innovation, trial.now.distance_px, trial.noise_px):
                case Validity.NOISE_UNKNOWN:
                    yield from trial.observe_again(self.OBSERVATIONS)
                    continue
                case Validity.INVALID:
                    earlier, known = Looks.none(), None
                    trial.recorded = trial.recorded[-validity.DOUBTS :]
                    continue
                case Validity.VALID:
                    known = latest
            findings.observations, findings.known = observations, latest
            yield from trial.go(model_of(self._built, latest.signs, latest.parameters), latest.objects[-1])

    def learn_trial(self, findings: Calibration, last: Observation, ended: bool) -> None:
        """See `ProcedureAgent`. Observations teach the model, however the trial ends."""
        if len(findings.observations.trial) > self.MEMORY:
            kept = findings.observations.latest(self.MEMORY // 2)
            findings = Calibration(kept, identify(kept, self._built, known=findings.known))
        self.calibration = findings

    def arrays(self) -> dict[str, NDArray[Any]]:
        """See `ProcedureAgent`."""
        known = self.calibration.known
        return {} if known is None else {**vars(self.calibration.observations), **vars(known)}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """See `ProcedureAgent`."""
        self.calibration = Calibration(Looks.none(), None)
        if arrays:
            looks = Looks(**{field.name: arrays[field.name] for field in fields(Looks)})
            known = Identification(**{field.name: arrays[field.name] for field in fields(Identification)})
            self.calibration = Calibration(looks, known)


class _RecordedTrial(Trial):
    """A trial whose estimated observations are recorded.

    Attributes:
        recorded: The estimates after each motion, the home view first.
    """

    FIRST_WORD = 0.04
    TEST_PX = 30.0
    """Tuned on wild worlds 3000 and up: larger than a servo's, so that curvature shows."""
    TOGETHER = np.array([[1.0, 1.0, -1.0], [-1.0, 1.0, 1.0]])
    """Test motions of all motors at once, in units of their test words."""

    def __init__(self, first: Observation) -> None:
        findings = Findings(TestMotions(len(first.registers)))
        super().__init__(first, findings, self.FIRST_WORD, self.TEST_PX)
        self.recorded: list[Observation] = []

    @property
    def noise_px(self) -> float:
        """Standard deviation of an image coordinate."""
        return self.filter.noise.px

    def begin(self) -> Motions:
        """See `Trial`."""
        yield from super().begin()
        self.recorded.append(self.now)

    def move(self, words: Array) -> Motions:
        """See `Trial`."""
        made = yield from super().move(words)
        self.recorded.append(self.now)
        return made

    def observe_again(self, times: int) -> Motions:
        """Observes so many times without a motion, and records none of these observations."""
        for _ in range(times):
            yield from super().move(np.zeros_like(self.now.registers))

    def explore(self) -> Motions:
        """Test motions of each motor alone, and a few of all together."""
        self.forget()
        for motor in self.unmeasured():
            yield from self.test(motor)
        for signs in self.TOGETHER:
            yield from self.move_in_view(signs * self.test_words)

    def go(self, model: CalibratedModel, object_: Array) -> Motions:
        """Goes to the object by `model`, see `move_by_model`."""
        words = model.registers(object_) - self.now.registers
        observations = yield from move_by_model(model, object_, self.filter, self.now, words)
        self.now = observations[-1]
        self.recorded += observations
