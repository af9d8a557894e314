"""A servo alone: what it keeps from one trial to the next are slopes, and no place."""

import re
from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import partial
from typing import Any, Protocol, TypeVar

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from calfree_gym.errors import check_choice

from ..base.agent import Agent
from ..base.checks import check_covariances, check_number, checked_array
from ..base.observation import POINTS, Observation
from ..base.prior_knowledge import PriorKnowledge
from ..base.procedure import Procedure, ProcedureAgent
from ..base.registration import SERVOS, Settings, agent, named_settings
from .jacobian import JacobianEstimate
from .perception import ObservationFilter
from .slopes import Slopes
from .trial import Findings

SERVO_KNOWLEDGE = frozenset({PriorKnowledge.IMAGE_SCALE, PriorKnowledge.NOISE, PriorKnowledge.WORD_LIMIT})
"""What most servos are built on: lengths in pixels, the noise of a good marker, sizes of words."""
SMALLEST = 1e-6
"""Of settings that must be positive (a guard: some are divided by)."""


def check_motions(servo: Any) -> None:
    """Raises ValueError where a setting of test motions and steps is not allowed."""
    for name in ("test_px", "step_px", "border"):
        check_number(name, getattr(servo, name), least=SMALLEST)
    for name in ("first_word", "step_word"):
        check_number(name, getattr(servo, name), least=SMALLEST, most=1)
    check_number("damping", servo.damping, least=0)


S = TypeVar("S")
_OF_0_1 = {
    r"UnifiedServo\(estimator='test_motions', ([^()]*), patience=[^()]*\)": r"PaperServo(\1)",
    r"UnifiedServo\(estimator=": "JacobianServo(estimator=",
    r"(FactoredTable\(cells=\d+), points=\d+": r"\1",
    ", on_change=keep$": "",  # what tables do
}
"""From what files of version 0.1 name, as regular expressions, to what that is called now."""


UNIFIED = "unified_servo"


def servo(name: str, does: str) -> Callable[[type[S]], type[S]]:
    """Puts a servo (a dataclass, whose fields are its settings) under a name, and `ServoAgent` over it."""

    def named(kind: type[S]) -> type[S]:
        SERVOS[name] = kind
        agent(name, does, fixed={"servo": name})(ServoAgent)
        return kind

    return named


class Servo(Protocol):
    """Seeks a rendezvous; its repr names all its settings."""

    @property
    def prior_knowledge(self) -> frozenset[PriorKnowledge]:
        """What it is built on, see `Agent`."""

    def new_estimator(self, motors: int, start: Slopes | None) -> JacobianEstimate:
        """Makes the estimator of its Jacobian, beginning with `start` where one is known."""

    def __call__(self, first: Observation, findings: Findings[Any]) -> Procedure:
        """Seeks the rendezvous from `first` on, and writes into `findings` what it learns."""


class ServoAgent(ProcedureAgent):
    """Seeks every rendezvous by `servo`, beginning with the Jacobian that the last trial ended with.

    Attributes:
        servo: The servo.
        slopes: That Jacobian; None before the first trial, and where the servo's does not last.
        filter: What is known of observations.
    """

    MOST = 1e6
    """Of saved slopes, registers and so on. Choice: far beyond any, and one can still reckon with it."""

    def __init__(self, env: gym.Env[Any, Any], servo: Servo, seed: int = 0) -> None:
        super().__init__(env, seed)
        (self.motors,) = env.action_space.shape  # type: ignore[misc]
        self.servo = servo
        self.prior_knowledge = servo.prior_knowledge
        self.slopes: Slopes | None = None
        self.filter = ObservationFilter()
        goals = [env.observation_space[key] for key in ("achieved_goal", "desired_goal")]  # type: ignore[index]
        self._edges = np.concatenate([goal.high for goal in goals], dtype=float).reshape(POINTS, 2)

    @classmethod
    def settings(cls, given: Settings) -> Settings:
        """See `Agent`. Those of its servo are among them."""
        name = given.get("servo", UNIFIED)
        check_choice("servo", name, SERVOS)
        own = {"seed": 0, **named_settings(cls), "servo": UNIFIED}
        return own | {field.name: field.default for field in fields(SERVOS[name])}

    @classmethod
    def make(cls, env: gym.Env[Any, Any], seed: int = 0, servo: str = UNIFIED, **settings: Any) -> Agent:
        """See `Agent`. All other settings are of the servo."""
        return cls(env, SERVOS[servo](**settings), seed)

    def new_findings(self) -> Findings:
        estimator = self.servo.new_estimator(self.motors, self.slopes)
        return Findings(estimator, self.filter.for_next_trial(), edges=self._edges)

    def procedure(self, first: Observation, findings: Findings[Any]) -> Procedure:
        return self.servo(first, findings)

    def learn_trial(self, findings: Findings[Any], last: Observation, ended: bool) -> None:
        """See `ProcedureAgent`. Motions teach the Jacobian, however the trial ends."""
        if (slopes := findings.estimator.slopes_for_next()) is not None:
            self.slopes = slopes
        self.filter = findings.filter

    def why_still(self, findings: Findings[Any]) -> str:
        return findings.gave_up

    @property
    def kind(self) -> str:
        return repr(self.servo)

    def present_kind(self, saved: str) -> str:
        for earlier, present in _OF_0_1.items():
            saved = re.sub(earlier, present, saved)
        return saved

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        arrays = self.filter.arrays()
        if self.slopes is not None:
            registers, jacobian, variances, changes, trials, lengths, looks = self.slopes
            arrays |= {"jacobian": jacobian, "slope_registers": registers, "slope_variances": variances}
            arrays |= {"slope_changes": changes, "slope_trials": np.array([trials])}
            arrays |= {"smooth_lengths": lengths, "smooth_looks": looks}
        return arrays

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """See `ProcedureAgent`. Files of 0.1 have no variances and lengths, older ones no registers."""
        self.slopes = None
        self.filter.restore(arrays)
        known = partial(checked_array, arrays, most=self.MOST)
        if "jacobian" in arrays:
            self.slopes = Slopes.of(known("jacobian", (8, self.motors)))
        if self.slopes is not None and "slope_variances" in arrays:
            variances = known("slope_variances", (POINTS, self.motors, self.motors), most=self.MOST**2)
            check_covariances("slope_variances", variances)
            self.slopes = self.slopes._replace(
                variances=variances,
                changes=known("slope_changes", (POINTS, self.motors), least=0),
                trials=int(checked_array(arrays, "slope_trials", (1,), least=0, whole=True)[0]),
            )
        if self.slopes is not None and "smooth_lengths" in arrays:
            self.slopes = self.slopes._replace(
                lengths=known("smooth_lengths", (2, self.motors), above=0),
                looks=checked_array(arrays, "smooth_looks", (2,), above=0),
            )
        if self.slopes is not None and "slope_registers" in arrays:
            registers = known("slope_registers", (self.motors,))
            self.slopes = self.slopes._replace(registers=registers)
