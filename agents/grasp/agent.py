"""Grasps: the paper's whole procedure, over any servo and any knowledge (sections 3.1, 3.4 and 3.5)."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ..base.checks import check_number, check_one_of, checked_array
from ..base.observation import Array, RawObservation
from ..base.prior_knowledge import PriorKnowledge
from ..base.procedure import ProcedureAgent
from ..base.storage import prefixed, under
from ..servo.servo_agent import ServoAgent
from .intermediate import INTERMEDIATE
from .observation import ARM, GraspObservation
from .orientation import ORIENTATION
from .trial import GraspFindings, GraspTrial, TurnRate

SHARES = (0.5, 0.15, 0.0)
"""Of the way from the intermediate position that are left after each motion of the descent. Choice."""
ACCURATE_PX = 3.0
"""The jaws close where the gripper is seen so near to its place. Derived: half of where every tenth grasp of
a bar misses."""
CORRECTIONS = 3
"""So often it is brought nearer, where it is not (a guard)."""
CLOSED, OPEN = 0.06, 0.95
"""Jaws that were told to close and are less open than the first hold nothing; more open than the second, they
have not closed."""
LIFTS = 10
"""So often the object is brought nearer to its place (a guard)."""


class Grasp(ProcedureAgent):
    """Approaches an intermediate position, turns the jaws, descends, closes them, lifts; after a miss again.

    Attributes:
        reacher: Goes to the intermediate position, and remembers how.
        rate: By how much the wrist's motor turns the jaws.

    Args:
        env: See `Agent`.
        reacher: Makes the agent that goes to the intermediate position, for an environment that it moves in.
        intermediate: Where the gripper goes first, of `INTERMEDIATE`.
        orientation: How the jaws' angle is seen, of `ORIENTATION`.
        tries: How often it tries to grasp.
        seed: See `Agent`.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        reacher: Any,
        intermediate: str = "along_axis",
        orientation: str = "least_squares",
        tries: int = 2,
        seed: int = 0,
    ) -> None:
        super().__init__(env, seed)
        check_one_of("intermediate", intermediate, INTERMEDIATE)
        check_one_of("orientation", orientation, ORIENTATION)
        check_number("tries", tries, least=1, whole=True)
        self.reacher: ServoAgent = reacher(Reaching())
        self.intermediate, self.orientation, self.tries = intermediate, orientation, tries
        self.prior_knowledge = self.reacher.prior_knowledge | {PriorKnowledge.MOTOR_ORDER}
        self.rate = TurnRate()

    def observed(self, raw: RawObservation) -> GraspObservation:
        """See `ProcedureAgent`."""
        return GraspObservation.of(raw)

    def new_findings(self) -> GraspFindings:
        """See `ProcedureAgent`."""
        return GraspFindings(self.reacher.new_findings(), replace(self.rate))

    def procedure(self, first: Any, findings: GraspFindings) -> Generator[Array, Any, None]:
        """See `ProcedureAgent`."""
        trial = GraspTrial(self.reacher, self.intermediate, self.orientation, first, findings)
        yield from trial.approach()
        for _ in range(self.tries):
            for share in SHARES:
                yield from trial.toward(share)
            for _ in range(CORRECTIONS):
                if trial.left_px(SHARES[-1]) < ACCURATE_PX and trial.turned:
                    break
                yield from trial.toward(SHARES[-1])
            yield from trial.close()
            if CLOSED < trial.now.opening < OPEN:
                yield from trial.back()
                for _ in range(LIFTS):
                    if trial.now.opening < CLOSED:
                        break
                    yield from trial.lift()
            yield from trial.open()
            trial.forget_where_the_object_was()
            yield from trial.toward(1.0)

    def learn_trial(self, findings: GraspFindings, last: Any, ended: bool) -> None:
        """See `ProcedureAgent`: of the approach."""
        self.rate = findings.rate
        if findings.looks:
            self.reacher.learn_trial(findings.reach, findings.looks[-1], findings.approached)

    @property
    def kind(self) -> str:
        """See `ProcedureAgent`."""
        settings = f"intermediate={self.intermediate}, orientation={self.orientation}, tries={self.tries}"
        return f"grasp over {self.reacher.kind}, {settings}"

    def arrays(self) -> dict[str, NDArray[Any]]:
        """See `ProcedureAgent`."""
        own = {"rate": np.array([self.rate.words, self.rate.turned])}
        return own | prefixed("reacher", self.reacher.arrays())

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """See `ProcedureAgent`."""
        self.rate = TurnRate(*checked_array(arrays, "rate", (2,)).tolist())
        self.reacher.restore(under("reacher", arrays))


class Reaching(gym.Env[Any, Any]):
    """The spaces in which an agent reaches for the intermediate position; it makes no motions of its own."""

    def __init__(self) -> None:
        box = spaces.Box(-1.0, 1.0, (4,), np.float32)
        state = spaces.Box(-1.0, 1.0, (4 + ARM,), np.float32)
        goals = {"achieved_goal": box, "desired_goal": box}
        self.observation_space = spaces.Dict({**goals, "observation": state})
        self.action_space = spaces.Box(-1.0, 1.0, (ARM,), np.float32)
