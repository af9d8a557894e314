"""The calibrated robot that calibrates itself, and never ceases to (paper, sections 1 and 2.2)."""

import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from calfree_gym.errors import check_choice
from calfree_gym.world import nominal

from ..base.observation import Array, Observation
from ..base.prior_knowledge import PriorKnowledge
from ..base.procedure import Procedure, ProcedureAgent
from ..base.registration import agent
from ..servo.jacobian import Estimator, TestMotions
from ..servo.perception import ObservationFilter
from ..servo.trial import Findings, Motions, ServoTrial
from .identification import Identification, identify
from .model_based import move_by_model
from .prediction import Measurements
from .robot_model import RobotModel


class RecordedTrial(ServoTrial):
    """A trial whose estimated observations are recorded.

    Attributes:
        recorded: The estimates after each motion, the home view first.
    """

    FIRST_WORD = 0.04
    """Of the first test motion (METHODS: 0.04 in a toy study of wild worlds)."""
    TEST_PX = 30.0
    """Wanted of a test motion: larger than a servo's, so that the motors' curvature shows. Tuned on wild
    worlds 3000 and up."""
    TOGETHER = np.array([[1.0, 1.0, -1.0], [-1.0, 1.0, 1.0]])
    """Test motions of all motors at once, in units of their test words: these show what motors do
    to each other. Tuned likewise."""
    OBSERVATIONS = 3
    """This many more at one place tell how noisy they are: `NoiseEstimate.ENOUGH` differences (derived: 3
    times 8 coordinates)."""

    def __init__(self, first: Observation, filter_: ObservationFilter) -> None:
        findings: Findings[Estimator] = Findings(TestMotions(len(first.registers)), filter_)
        super().__init__(first, findings, self.FIRST_WORD, self.TEST_PX)
        self.recorded: list[Observation] = []

    @property
    def noise_px(self) -> float:
        """Standard deviation of an image coordinate."""
        return self.filter.noise.px

    def begin(self) -> Motions:
        yield from super().begin()
        self.recorded.append(self.now)

    def move(self, words: Array) -> Motions:
        made = yield from super().move(words)
        self.recorded.append(self.now)
        return made

    def measure_noise(self) -> Motions:
        """Observes without a motion until it is known how noisy observations are; records none of these."""
        for _ in range(self.OBSERVATIONS):
            yield from super().move(np.zeros_like(self.now.registers))

    def explore(self) -> Motions:
        """Test motions of each motor alone, and a few of all together."""
        self.forget()
        for motor in self.unmeasured():
            yield from self.test(motor)
        for signs in self.TOGETHER:
            yield from self.move_in_view(signs * self.test_words)

    def go(self, model: RobotModel, object_: Array) -> Motions:
        """Goes by `model` to where it has the object (3,), see `move_by_model`."""
        words = model.registers(object_) - self.now.registers
        observations = yield from move_by_model(model, object_, self.filter, self.now, words)
        self.now = observations[-1]
        self.recorded += observations


class Validity(Enum):
    """Whether what was identified still holds."""

    VALID = "the latest observations agree with it"
    DOUBTED = "they do not, once: the robot acts by the latest fit, and keeps the earlier one for comparison"
    NOISE_UNKNOWN = "they do not, again; but nobody knows yet how noisy they are"
    INVALID = "they do not, again: all that was known is dropped"


class ValidityCheck:
    """Judges by each motion of a trial whether what was identified still holds.

    The paper's section 1 asks for a robot that keeps determining its parameters; when it is to begin anew, it
    leaves open. Here: where the model contradicts the latest observations, or where it misses again and
    again, twice running.
    """

    INCONSISTENT = 50.0
    """Observations contradict the model where the least cost rises by more, see `Identification.innovation`;
    about 4 is usual. Tuned on wild worlds 3000 and up."""
    TRIES, MISSED = 6, 8.0
    """So they do where the object is still missed, by this many times the noise, after this many motions:
    tuned likewise."""
    CONTRADICTIONS = 2
    """This many in a row end the validity: a single one may be a mistaken point. Choice."""

    def __init__(self) -> None:
        self._contradictions = self._tries = 0
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
        contradicted = missed or innovation > self.INCONSISTENT
        self._contradictions = self._contradictions + 1 if contradicted else 0
        if self._contradictions < self.CONTRADICTIONS:
            self._tries += 1
            return Validity.DOUBTED if self._contradictions else Validity.VALID
        if not self._noise_known:
            self._contradictions, self._noise_known = self._contradictions - 1, True
            return Validity.NOISE_UNKNOWN
        self._contradictions = 0
        return Validity.INVALID


MOTOR_CURVES: dict[str, tuple[str, ...]] = {"cubic": (), "linear": ("motor_curvature",)}
LENSES: dict[str, tuple[str, ...]] = {"radial": (), "none": ("lens_k1",)}
"""Kinds of models, and which of `PARAMETERS` they lack."""
_OF_ONE_KIND = re.compile(r"^(SelfCalibrating\(camera_mount='\w+')\)$")


@dataclass
class Calibration:
    """What is known of the robot, and from what.

    Attributes:
        measurements: Those of earlier trials, and of this one.
        known: What was identified from them; None before there were enough.
        filter: What is known of observations.
    """

    measurements: Measurements
    known: Identification | None
    filter: ObservationFilter


@agent(
    "self_calibrating",
    "A calibrated robot that identifies its own model as it moves.",
    arms="movemaster",
)
class SelfCalibrating(ProcedureAgent):
    """Identifies cameras, arm and motors from its own motions, and acts by the model.

    The paper's section 1: robots of this kind are as robust as those without models "if they do not limit
    themselves to an initial self-calibration, but continue to determine the actual values of the relevant
    parameters during their normal operation".

    Identification needs no phase of its own. A trial that begins with nothing known begins with test motions,
    and goes on as soon as there is a model; every further observation, in failure and success, refits it.
    `learn` keeps measurements and model for later trials; `predict` refits for the trial only.

    It gets no privileged observations, but is built on much prior knowledge:

    * of the arm, the kinematics as built: which joint moves what, link lengths to within 20 %, joint zeros to
      within 0.3 rad, joint limits, and that the wrist holds the hand vertical;
    * of the motors, the simulator's own curve from register to joint angle, and bounds of its coefficients:
      only signs, gains and curvatures are unknown;
    * of the cameras, what they are fixed to, a lens of one coefficient, and where they were meant to be and
      to look, to within 15 cm and 0.6 rad of tilt; their roll is free;
    * of objects, where they may lie (`OBJECT_BOUND`), with a weak prior;
    * of all these, how widely the simulator's wild worlds differ, as a prior (`PARAMETERS`).

    So its model is never wrong in kind, only in numbers. With `motor_curve="linear"` and `lens="none"` it is:
    these are the models of an engineer who does not have the simulator's formulas.

    Args:
        camera_mount: What the cameras are fixed to: "waist" or "stand".
        motor_curve: How it takes joint angles to follow registers: "cubic", as they do, or "linear".
        lens: What it takes lenses to do: "radial" distortion, as they do, or "none".
    """

    prior_knowledge = frozenset(
        {
            PriorKnowledge.IMAGE_SCALE,
            PriorKnowledge.NOISE,
            PriorKnowledge.CAMERA_MODEL,
            PriorKnowledge.ARM,
            PriorKnowledge.MOUNT,
            PriorKnowledge.MOTOR_ORDER,
            PriorKnowledge.WORD_LIMIT,
        }
    )
    MEMORY = 80
    """Measurements kept from earlier trials at most; of more, the later half is. Their number bounds the time
    that a fit takes. Tuned on wild worlds 3000 and up."""

    def __init__(
        self,
        env: gym.Env[Any, Any],
        camera_mount: str = "waist",
        motor_curve: str = "cubic",
        lens: str = "radial",
        seed: int = 0,
    ) -> None:
        super().__init__(env, seed)
        check_choice("motor_curve", motor_curve, MOTOR_CURVES)
        check_choice("lens", lens, LENSES)
        self.camera_mount, self.motor_curve, self.lens = camera_mount, motor_curve, lens
        self.calibration = Calibration(Measurements.none(), None, ObservationFilter())
        self._built = RobotModel.of(nominal(), camera_mount)
        lacking = MOTOR_CURVES[motor_curve] + LENSES[lens]
        self._identify = partial(identify, built=self._built, lacking=lacking)

    @property
    def kind(self) -> str:
        model = f"motor_curve={self.motor_curve!r}, lens={self.lens!r}"
        return f"SelfCalibrating(camera_mount={self.camera_mount!r}, {model})"

    def present_kind(self, saved: str) -> str:
        """See `ProcedureAgent`. In version 0.1 there was one kind of model."""
        return _OF_ONE_KIND.sub(r"\1, motor_curve='cubic', lens='radial')", saved)

    def new_findings(self) -> Calibration:
        return replace(self.calibration, filter=self.calibration.filter.for_next_trial())

    def procedure(self, first: Observation, findings: Calibration) -> Procedure:
        """Explores if it must; then identifies and goes to the object by the model, again and again.

        Args:
            first: What is observed at home.
            findings: What earlier trials have taught, and what this one adds.
        """
        trial = RecordedTrial(first, findings.filter)
        yield from trial.begin()
        earlier, known = findings.measurements, findings.known
        validity = ValidityCheck()
        while True:
            if known is None:
                yield from trial.explore()
                known = self._identify(earlier.with_trial(trial.recorded), noise_px=trial.noise_px)
                validity.begin()
            measurements = earlier.with_trial(trial.recorded)
            latest = self._identify(measurements, noise_px=trial.noise_px, known=known)
            innovation = known.innovation(latest, trial.noise_px)
            match validity.judge(innovation, trial.now.distance_px, trial.noise_px):
                case Validity.NOISE_UNKNOWN:
                    yield from trial.measure_noise()
                    continue
                case Validity.INVALID:
                    earlier, known = Measurements.none(), None
                    trial.recorded = trial.recorded[-validity.CONTRADICTIONS :]
                    continue
                case Validity.VALID:
                    known = latest
            findings.measurements, findings.known = measurements, latest
            yield from trial.go(latest.model(self._built), latest.objects[-1])

    def learn_trial(self, findings: Calibration, last: Observation, ended: bool) -> None:
        """See `ProcedureAgent`. Measurements teach the model, however the trial ends."""
        if len(findings.measurements.trial) > self.MEMORY:
            kept = findings.measurements.latest(self.MEMORY // 2)
            noise_px = findings.filter.noise.px
            known = self._identify(kept, noise_px=noise_px, known=findings.known)
            findings = replace(findings, measurements=kept, known=known)
        self.calibration = findings

    def arrays(self) -> dict[str, NDArray[Any]]:
        known, arrays = self.calibration.known, self.calibration.filter.arrays()
        return arrays if known is None else {**arrays, **vars(self.calibration.measurements), **vars(known)}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """See `ProcedureAgent`. Files of version 0.1 are read with a warning."""
        self.calibration = Calibration(Measurements.none(), None, ObservationFilter())
        self.calibration.filter.restore(arrays)
        if arrays.keys() - self.calibration.filter.arrays().keys():
            if "off_px" in arrays:
                warnings.warn("arrays of version 0.1 were read: save them anew", stacklevel=3)
                arrays = _of_version_0_1(arrays)
            measurements = Measurements.of_arrays(arrays)
            known = Identification.of_arrays(arrays, measurements)
            self.calibration = replace(self.calibration, measurements=measurements, known=known)


def _of_version_0_1(arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Arrays of version 0.1, with eight coordinates and flags a measurement, in today's shapes and names.

    Args:
        arrays: Among them points, seen and off_px (n, 8): xy of gripper left, right, object left, right.
    """
    of_points = {"points": "points", "off_px": "residuals_px"}
    present = {name: array for name, array in arrays.items() if name not in of_points}
    for old, name in of_points.items():
        if old in arrays and arrays[old].ndim == 2:
            present[name] = arrays[old].reshape(len(arrays[old]), -1, 2)
    if "seen" in arrays and arrays["seen"].ndim == 2:
        present["seen"] = arrays["seen"][:, ::2]
    return present
