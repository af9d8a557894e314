"""`safe_start`: first motions, then any servo on a leash."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.checks import checked_array
from ...base.observation import POINTS, Array, Observation
from ...base.prior_knowledge import PriorKnowledge
from ...base.procedure import Procedure, RunningTrial
from ...base.registration import agent
from ...jacobian import Slopes
from ..servo_agent import Servo, ServoAgent
from ..settings import SERVO_KNOWLEDGE
from ..trial import Findings
from .first_motions import FirstMotions
from .leash import Leash, equal_units, in_units
from .linear_view import LinearView
from .straight_way import StraightWay


@dataclass
class SafeFindings(Findings[Any]):
    """What it finds out in a trial.

    Attributes:
        units: What the servo takes for a word of 1, of each motor (m,), see `Leash`.
        tested: How far each motor (m,) was moved alone.
        handed_over: Whether the servo went on.
        gave_up: Why it makes no more motions; nothing, where it does.
    """

    units: Array = field(default_factory=lambda: np.ones(0))
    tested: Array = field(default_factory=lambda: np.ones(0))
    handed_over: bool = False
    gave_up: str = ""


@agent("safe_start", "[Begins with tiny motions](safe-reach.md), then lets a servo go on.")
class SafeStart(ServoAgent):
    """Begins to move as one that knows nothing of itself should, then lets a servo go on, on a leash.

    It observes contacts by nothing but registers: words that were executed in part. It gives up where no
    motor can be moved, where no motor's motion is seen, and where it met something again and again; then
    it sends zero words, and `gave_up` says why. A later trial begins with what the last one has taught, on
    a leash as short as at first; over a servo whose Jacobian does not last (`paper_servo`,
    `work_plane_servo`), with first motions again.

    Args:
        env, seed: See `Agent`.
        servo: The servo.
    """

    def __init__(self, env: Any, servo: Servo, seed: int = 0) -> None:
        super().__init__(env, servo, seed)
        self.units = self.tested = np.ones(self.motors)
        self.prior_knowledge = (servo.prior_knowledge | SERVO_KNOWLEDGE) - {PriorKnowledge.WORD_LIMIT}

    def new_findings(self) -> SafeFindings:
        """See `ProcedureAgent`."""
        findings = super().new_findings()
        return SafeFindings(findings.estimator, findings.filter, units=self.units, tested=self.tested)

    def procedure(self, first: Observation, findings: Any) -> Procedure:
        """See `ProcedureAgent`."""
        now = yield from findings.filter.first(first)
        view = LinearView(self.motors)
        if self.slopes is None:
            motions = FirstMotions(now, findings.filter)
            yield from motions.run()
            now, view = motions.now, motions.view
            findings.tested = np.maximum(motions.tested, FirstMotions.FIRST_WORD)
            if now.last:
                return
            findings.gave_up = _hopeless(motions)
            if findings.gave_up:
                return
            findings.units = equal_units(view.jacobian, findings.tested)
        else:
            view.jacobian = self.slopes.jacobian / findings.units
            view.variances = self.slopes.variances.mean(0) / np.outer(findings.units, findings.units)
        leash = Leash(now, view, findings.tested, findings.filter, findings.units)
        way = StraightWay(view, leash, findings.units)
        findings.gave_up = yield from leash.hold(way.go(in_units(now, findings.units)), whole=False)
        findings.estimator = self.servo.new_estimator(self.motors, _slopes(view, findings, leash.now))
        findings.handed_over = True
        if findings.gave_up or leash.now.last:
            return
        now = in_units(leash.now, findings.units)
        findings.stops = leash.stops.of(findings.units)
        findings.gave_up = yield from leash.hold(self.servo(now, findings))

    def learn_trial(self, findings: Any, last: Observation, ended: bool) -> None:
        """See `ProcedureAgent`. A trial that ended before the servo went on teaches nothing but noise."""
        if not findings.handed_over:
            self.filter = findings.filter
            return
        super().learn_trial(findings, last, ended)
        self.units, self.tested = findings.units, findings.tested

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """See `ProcedureAgent`."""
        return super().arrays() | {"units": self.units, "tested": self.tested}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """See `ProcedureAgent`."""
        super().restore(arrays)
        self.units, self.tested = (
            checked_array(arrays, name, (self.motors,)) for name in ("units", "tested")
        )

    @staticmethod
    def gave_up(state: list[RunningTrial]) -> list[str]:
        """Why it gave up, for each environment of a state that `predict` returned; or nothing."""
        return [trial.findings.gave_up for trial in state]

    @property
    def kind(self) -> str:
        """See `ProcedureAgent`."""
        return f"safe_start over {super().kind}"


def _slopes(view: LinearView, findings: SafeFindings, now: Observation) -> Slopes:
    """The Jacobian as a servo begins with it, in its units."""
    units = findings.units
    variances = np.tile(view.variances * np.outer(units, units), (POINTS, 1, 1))
    return Slopes.of(view.jacobian * units, now.registers / units, variances)


def _hopeless(motions: FirstMotions) -> str:
    """Why nothing can be done after these first motions, or nothing."""
    if not motions.now.visible[:2].any() and not motions.view.jacobian.any():
        return "the gripper is not seen"
    if motions.blocked.all():
        return "no motor executes its smallest words, either way"
    if not motions.view.jacobian[:4].any() or (motions.blocked | motions.unseen).all():
        return "no motor moves the gripper in the images"
    return ""
