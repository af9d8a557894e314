"""Remembers every look, over any servo, and sees that the world has changed (paper, sections 4 and 5)."""

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import IMAGE_UNIT

from ..base.checks import check_number, checked_array
from ..base.observation import Array, Observation, RawObservation
from ..base.procedure import Procedure
from ..base.registers import Stops, at_home
from ..knowledge.learning_servo import KnowledgeAgent, knowledge_base
from ..servo.image_model.least_distance import Seeker
from ..servo.image_model.smooth_points import SmoothPoints
from ..servo.servo_agent import Servo
from ..servo.slopes import Slopes
from ..servo.trial import Findings, jump
from ..servo.unified import UnifiedServo
from .adaptive_memory import AdaptiveMemory, WorldEvent
from .remembered import Remembered


class Memory(KnowledgeAgent):
    """A servo that begins each trial with all that was ever seen.

    The unified servo needs no more: where it remembers enough, its first step ends at the rendezvous. Other
    servos begin where the least distance is expected, with the Jacobian there.

    Where the servo has given up in a trial what was remembered, for it predicts worse than the servo alone,
    the next trial begins without it; after one more, the next three; and so on.

    Attributes:
        adaptation: What it remembers, and what it does with that where the world has changed.

    Args:
        knowledge: Remembers; empty.
        servo: Goes where it is told by what is remembered.
        jump_px: With another servo than the unified one, it moves at once only where it expects to end up no
            further off than this.
        on_change: What it does with what it remembers where the world has changed: one of
            `agents.memory.adaptive_memory.ON_CHANGE`.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        knowledge: Remembered,
        servo: Servo,
        seed: int = 0,
        jump_px: float = 60.0,
        on_change: str = "recognise",
    ) -> None:
        super().__init__(env, servo, seed)
        self.jump_px = check_number("jump_px", jump_px, least=0, finite=False)
        self.adaptation = AdaptiveMemory(knowledge, on_change)
        self._given_up = self._rests = 0
        self.prior_knowledge |= knowledge.prior_knowledge | self.adaptation.prior_knowledge

    def procedure(self, first: Observation, findings: Findings[Any]) -> Procedure:
        now = yield from findings.filter.first(first)
        findings.trusted.append(now)
        points = self.adaptation.points_for(now, findings.filter.noise.px, self.slopes)
        points = None if self._rests else points
        if points is not None and isinstance(self.servo, UnifiedServo):
            findings.estimator = points
        elif points is not None:
            registers, expected_px = self._recall(points)
            if now.shows_object and expected_px <= self.jump_px:
                now = yield from jump(registers, now, findings)
            expected = points.at(now.registers)
            slopes = Slopes.of(expected.jacobian, now.registers, expected.slope_variances)
            findings.estimator = self.servo.new_estimator(self.motors, slopes)
        yield from self.servo(now, findings)

    def _recall(self, points: SmoothPoints) -> tuple[Array, float]:
        """Registers (m,) where the least distance is expected, and how long it is there, in pixels."""
        home, stops = np.zeros(self.motors), Stops(np.zeros(self.motors))
        found = Seeker(points, home, stops.lowest, stops.highest, caution=1.0).seek()
        return found.registers, found.length / IMAGE_UNIT

    def expected_px(self, first: RawObservation) -> float | None:
        """How far off it expects to be after its first motion, told before that motion is made.

        Args:
            first: What a trial begins with.

        Returns:
            The distance in an image, root mean square, in pixels; None where it remembers nothing of this
            world, or does not see the object.
        """
        home = at_home(Observation.of(first))
        if not home.visible.all():
            return None
        points = self.adaptation.points_for(home, self.filter.noise.px, self.slopes)
        return None if points is None else self._recall(points)[1]

    def learn_trial(self, findings: Findings[Any], last: Observation, ended: bool) -> None:
        """See `ProcedureAgent`. Every look teaches, however the trial ends."""
        super().learn_trial(findings, last, ended)
        if self._rests:
            self._rests -= 1
        else:
            self._given_up = 2 * self._given_up + 1 if findings.given_up else 0
            self._rests = self._given_up
        if findings.trusted:
            self.adaptation.learn(findings.trusted, findings.filter.noise.px, findings.jumped)

    @property
    def events(self) -> Sequence[WorldEvent]:
        """The changes of the world that it has recognised, the latest last."""
        return self.adaptation.events

    @property
    def kind(self) -> str:
        settings = f"jump_px={self.jump_px:g}, on_change={self.adaptation.on_change}"
        return f"{self.adaptation.known!r} over {self.servo!r}, {settings}"

    def arrays(self) -> dict[str, NDArray[Any]]:
        rests = {"rests": np.array([self._given_up, self._rests])}
        return super().arrays() | self.adaptation.arrays() | rests

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        rests = checked_array(arrays, "rests", (2,), least=0, whole=True) if "rests" in arrays else (0, 0)
        super().restore(arrays)
        self.adaptation.restore(arrays)
        self._given_up, self._rests = (int(each) for each in rests)


knowledge_base(
    "memory",
    "[Remembers looks of all trials](experience.md), and notices when the world changes.",
    Memory,
)(Remembered)
