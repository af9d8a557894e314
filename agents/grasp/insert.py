"""Inserts: to an intermediate position by any servo, then down along the gripper's axis (paper, 3.4)."""

from collections.abc import Generator, Mapping
from functools import partial
from typing import Any

import gymnasium as gym
from numpy.typing import NDArray

from ..base.agent import Agent
from ..base.observation import Array, RawObservation
from ..base.procedure import ProcedureAgent
from ..base.registration import Settings, agent
from ..servo.servo_agent import ServoAgent
from .grasp import GRASP_KNOWLEDGE, ReachSpaces, surely
from .observation import ARM, INSERT_WORDS, InsertObservation
from .trial import GraspFindings, GraspTrial, Motions
from .turning import Turning

ABOVE = (0.5, 0.2, 0.1, 0.1, 0.04)
"""Of the way from the intermediate position that are left after each motion towards the plate. Tuned on
worlds 1100 to 1179: lower at last is a little surer than 0.08."""
LOOKS = 4
"""So often the peg is brought nearer to its place above the hole, and looked at. Choice: with six it
was no surer there."""
BELOW = (0.0, -0.04, -0.09, -0.14, -0.18, -0.22, -0.26)
"""The same after each motion into the hole: beyond it. Choice: short, for an arm that meets the plate presses
the more the faster it goes."""
TRIES = 6
"""So often it comes down once more (a guard)."""


class InsertTrial(GraspTrial):
    """A trial of inserting: nothing needs to be turned."""

    def _look_at_angle(self, words: Array) -> None:
        """See `GraspTrial`: a round peg fits at any angle."""


@agent(
    "insert",
    "To a position on the gripper's own axis before the hole, and down along it.",
    tasks=("insert",),
    defaults=surely,
)
class Insert(ProcedureAgent):
    """Approaches one gripper length before the hole on the gripper's own axis, and descends along it.

    Looks on the way tell where peg and hole are seen over registers, as in `Grasp`. Where the peg meets the
    plate it goes back up, looks again, and comes down once more.

    Args:
        reacher: Makes the agent that goes to the intermediate position, for an environment that it moves in.
    """

    def __init__(self, env: gym.Env[Any, Any], reacher: Any, seed: int = 0) -> None:
        super().__init__(env, seed)
        self.reacher: ServoAgent = reacher(ReachSpaces(ARM))
        self.prior_knowledge = self.reacher.prior_knowledge | GRASP_KNOWLEDGE

    @classmethod
    def settings(cls, given: Settings) -> Settings:
        """See `Agent`. They are those of the servo that reaches."""
        return ServoAgent.settings(given)

    @classmethod
    def make(cls, env: gym.Env[Any, Any], seed: int = 0, **settings: Any) -> Agent:
        """See `Agent`. All other settings are of the servo that reaches."""
        return cls(env, partial(ServoAgent.make, seed=seed, **settings), seed)

    def observed(self, raw: RawObservation) -> InsertObservation:
        return InsertObservation.of(raw)

    def new_findings(self) -> GraspFindings:
        return GraspFindings(self.reacher.new_findings(), Turning.unknown(ARM))

    def procedure(self, first: Any, findings: GraspFindings) -> Generator[Array, Any, None]:
        trial = InsertTrial(self.reacher, "along_axis", "least_squares", first, findings)
        yield from without_jaws(trial.approach())
        yield from without_jaws(insert(trial))

    def learn_trial(self, findings: GraspFindings, last: Any, ended: bool) -> None:
        """See `ProcedureAgent`: how the approach went."""
        if findings.looks:
            self.reacher.learn_trial(findings.reach, findings.looks[-1], findings.approached)

    @property
    def kind(self) -> str:
        return f"insert over {self.reacher.kind}"

    def arrays(self) -> dict[str, NDArray[Any]]:
        """See `ProcedureAgent`: what the reacher knows."""
        return self.reacher.arrays()

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        self.reacher.restore(arrays)


def insert(trial: InsertTrial) -> Motions:
    """Down to the hole, look by look, and into it; where the peg meets the plate, once more from above."""
    for share in ABOVE:
        yield from trial.toward(share)
    for _ in range(TRIES):
        for _ in range(LOOKS):
            yield from trial.toward(ABOVE[-1])
        for share in BELOW:
            yield from trial.toward(share)
            if trial.touched:
                break
        yield from trial.toward(ABOVE[-1])


def without_jaws(motions: Motions) -> Generator[Array, Any, None]:
    """The same motions for an arm whose jaws have no word."""
    words = next(motions, None)
    while words is not None:
        now = yield words[:INSERT_WORDS]
        try:
            words = motions.send(now)
        except StopIteration:
            return
