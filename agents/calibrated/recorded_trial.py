"""A trial whose observations are recorded, to identify the robot from them."""

from __future__ import annotations

import numpy as np

from ..base.observation import Array, Observation
from ..jacobian import Estimator, TestMotions
from ..servo.trial import Findings, Motions, Trial
from .model_based import move_by_model
from .robot_model import RobotModel


class RecordedTrial(Trial):
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

    def __init__(self, first: Observation) -> None:
        findings: Findings[Estimator] = Findings(TestMotions(len(first.registers)))
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
