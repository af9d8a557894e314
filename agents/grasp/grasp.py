"""Grasps: the paper's whole procedure, over any servo and any knowledge (sections 3.1, 3.4 and 3.5)."""

from collections.abc import Generator, Mapping
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from calfree_gym.errors import check_choice, check_flag

from ..base.agent import Agent
from ..base.checks import check_number, checked_array
from ..base.observation import Array, RawObservation
from ..base.prior_knowledge import PriorKnowledge
from ..base.procedure import ProcedureAgent
from ..base.registration import KNOWLEDGE, Settings, agent, named_settings
from ..base.storage import prefixed, under
from ..knowledge.learning_servo import Knowledge, KnowledgeAgent, make_knowledge
from ..memory.adaptive_memory import AdaptiveMemory
from ..memory.memory import Memory
from ..servo.image_model.smooth_points import SmoothPoints
from ..servo.servo_agent import UNIFIED, ServoAgent
from .observation import OBJECT, GraspObservation
from .seen import INTERMEDIATE
from .trial import OPEN, SURE_PX, GraspFindings, GraspTrial, Motions
from .turning import ORIENTATION, Turning, direction_key

GRASP_KNOWLEDGE = frozenset({PriorKnowledge.MOTOR_ORDER, PriorKnowledge.WORD_LIMIT})
"""What it is built on beside the agent that reaches: which word turns the jaws; test turns of one size."""
SHARES = (0.5, 0.15, 0.0)
"""Of the way from the intermediate position that are left after each motion of the descent. Choice. Where the
arm meets something, it comes down once more: near the object by the last two, for of a short way it goes back
by little."""
ACCURATE, BLOCKED = 0.06, 0.15
"""The jaws close where the gripper is seen so near to its place, in gripper lengths; or where it has met
something, came from above once more, and comes no nearer, so near. Choice: a sphere is often missed at the
second."""
FORESEEN_PX = 1.5
"""Where it is known so well where the tip meets the object (a deviation), it goes there in one motion.
Derived: 95 % end within 3 px."""
CORRECTIONS = 8
"""So often it is brought nearer, or comes down once more, where it is not there (a guard)."""
TEST_TURNS = 2
"""So often the jaws are turned only to learn how they turn, before the gripper descends (a guard)."""
CLOSED = 0.06
"""Jaws that were told to close and are less open than this share hold nothing. Choice: less than any thing's
width."""
LIFTS = 10
"""So often the object is brought nearer to its place (a guard)."""


def surely(given: Settings) -> Settings:
    """The unified servo must not touch what it comes near to: it goes only where it surely expects to be."""
    return {"sure_px": SURE_PX} if given.get("servo", UNIFIED) == UNIFIED else {}


@agent(
    "grasp",
    "The paper's whole procedure: to a position above the object, down, the jaws closed, and up.",
    tasks=("grasp",),
    defaults=surely,
)
class Grasp(ProcedureAgent):
    """Approaches an intermediate position, turns the jaws, descends, closes them, lifts; after a miss again.

    Attributes:
        reacher: Goes to the intermediate position, and remembers how.
        descent: Remembers where the tip and objects are seen, if the reacher is one that remembers all looks.
        turning: What turns the jaws, and how far.

    Args:
        reacher: Makes the agent that goes to the intermediate position, for an environment that it moves in.
        intermediate: Where the gripper goes first, of `INTERMEDIATE`.
        orientation: How the jaws' angle is seen, of `ORIENTATION`.
        tries: How often it tries to grasp.
        table: Knowledge of the registers of arm and turn, by keys of six dimensions (section 4.3).
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        reacher: Any,
        intermediate: str = "along_axis",
        orientation: str = "least_squares",
        tries: int = 2,
        seed: int = 0,
        table: Knowledge | None = None,
    ) -> None:
        super().__init__(env, seed)
        check_choice("intermediate", intermediate, INTERMEDIATE)
        check_choice("orientation", orientation, ORIENTATION)
        check_number("tries", tries, least=1, whole=True)
        arm = env.action_space.shape[-1] - 2  # type: ignore[index]
        self.reacher: ServoAgent = reacher(ReachSpaces(arm))
        self.intermediate, self.orientation, self.tries = intermediate, orientation, tries
        self.prior_knowledge = self.reacher.prior_knowledge | GRASP_KNOWLEDGE
        if intermediate == "pixel_offset":
            self.prior_knowledge |= {PriorKnowledge.CAMERA_MODEL}
        self.turning = Turning.unknown(arm)
        self.table = table
        self.descent: AdaptiveMemory | None = None
        if isinstance(self.reacher, Memory):
            of_reacher = self.reacher.adaptation
            self.descent = AdaptiveMemory(of_reacher.known.nothing(), of_reacher.on_change)

    @classmethod
    def settings(cls, given: Settings) -> Settings:
        """See `Agent`. Those of the agent that reaches, or of the table and the servo, are among them."""
        reaching: type[ServoAgent] = KnowledgeAgent
        if given.get("knowledge", "memory") is None:
            reaching = ServoAgent
        own = {**named_settings(cls), "direction": False}
        without = ["reacher", "table"]
        without += ["jump_px", "every_look", "on_change"] if given.get("direction") else []
        settings = {"seed": 0, "knowledge": "memory", "servo": UNIFIED} | own | reaching.settings(given)
        return {name: default for name, default in settings.items() if name not in without}

    @classmethod
    def make(
        cls,
        env: gym.Env[Any, Any],
        seed: int = 0,
        knowledge: str | None = "memory",
        intermediate: str = "along_axis",
        orientation: str = "least_squares",
        tries: int = 2,
        direction: bool = False,
        **settings: Any,
    ) -> Agent:
        """See `Agent`. Where the direction joins keys, knowledge of these is its own, and a servo reaches."""
        check_flag("direction", direction)
        table = None
        if direction:
            of_six = [name for name, base in KNOWLEDGE.items() if "dimensions" in named_settings(base)]
            check_choice("knowledge", knowledge, of_six)
            turned = env.action_space.shape[0] - 1  # type: ignore[index]
            table = make_knowledge(str(knowledge), turned, settings, dimensions=6)
        reacher = partial(ServoAgent.make, seed=seed, **settings)
        if knowledge is not None and not direction:
            reacher = partial(KnowledgeAgent.make, seed=seed, knowledge=knowledge, **settings)
        return cls(env, reacher, intermediate, orientation, tries, seed, table)

    def observed(self, raw: RawObservation) -> GraspObservation:
        return GraspObservation.of(raw)

    def new_findings(self) -> GraspFindings:
        return GraspFindings(self.reacher.new_findings(), self.turning.in_new_trial())

    def procedure(self, first: Any, findings: GraspFindings) -> Generator[Array, Any, None]:
        findings.descent = self._remembered(first, findings.noise_px)
        trial = GraspTrial(self.reacher, self.intermediate, self.orientation, first, findings)
        if self.table is not None and first.visible.all():
            findings.key = np.concatenate([first.object, direction_key(first)])
            if (recall := self.table.recall(findings.key)) is not None:
                yield from trial.jump(recall.registers)
        yield from trial.approach()
        for _ in range(self.tries):
            yield from descend(trial)
            yield from trial.close()
            if CLOSED < trial.now.opening < OPEN:
                yield from lift(trial)
            yield from trial.open()
            yield from trial.toward(1.0)

    def learn_trial(self, findings: GraspFindings, last: Any, ended: bool) -> None:
        """See `ProcedureAgent`: the approach, turns, and where tip and object were seen all the way."""
        self.turning = findings.turning
        if findings.looks:
            self.reacher.learn_trial(findings.reach, findings.looks[-1], findings.approached)
        if self.table is not None and ended and findings.key is not None and findings.above is not None:
            self.table.learn(findings.key, findings.above)
        if self.descent is not None and findings.untouched:
            self.descent.learn(findings.untouched, findings.noise_px)

    def _remembered(self, first: GraspObservation, noise_px: float) -> SmoothPoints | None:
        """What is known of where tip and object are seen, of an object and in a world as seen at home."""
        home = first.toward(first.at("object"), first.visible[OBJECT])
        if self.descent is None or not home.visible.all():
            return None
        return self.descent.points_for(home, noise_px)

    @property
    def kind(self) -> str:
        settings = f"intermediate={self.intermediate}, orientation={self.orientation}, tries={self.tries}"
        table = "" if self.table is None else f"{self.table!r} of six dimensions, "
        return f"grasp over {self.reacher.kind}, {table}{settings}"

    def arrays(self) -> dict[str, NDArray[Any]]:
        own = {"turning": self.turning.state, "turning_covariance": self.turning.covariance}
        for name, knowledge in self._own_knowledge.items():
            own |= prefixed(name, knowledge.arrays())
        return own | prefixed("reacher", self.reacher.arrays())

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        size = len(self.turning.state)
        self.turning = Turning(
            checked_array(arrays, "turning", (size,)),
            checked_array(arrays, "turning_covariance", (size, size)),
        )
        self.reacher.restore(under("reacher", arrays))
        for name, knowledge in self._own_knowledge.items():
            knowledge.restore(under(name, arrays))

    @property
    def _own_knowledge(self) -> dict[str, AdaptiveMemory | Knowledge]:
        both = {"descent": self.descent, "table": self.table}
        return {name: each for name, each in both.items() if each is not None}


def descend(trial: GraspTrial) -> Motions:
    """Down to the object, the jaws along it: in one motion where that is foreseen, else look by look."""
    for _ in range(TEST_TURNS):
        if not (trial.turned or trial.knows_turns):
            yield from trial.turn()
    way: tuple[float, ...] = SHARES
    if trial.foreseen_px < FORESEEN_PX:
        way = SHARES[-1:]
        if not trial.turned:
            yield from trial.turn()
    for correction in range(1 + CORRECTIONS):
        for share in way:
            yield from trial.toward(share)
            if trial.touched:
                break
        left = trial.left(SHARES[-1])
        if left < (BLOCKED if trial.touched and correction else ACCURATE) and trial.turned:
            break
        way = SHARES[-1:]
        if trial.touched:
            way = SHARES[-2:] if left < 2 * BLOCKED else SHARES


def lift(trial: GraspTrial) -> Motions:
    """Up to where the object is to be; first back where the gripper came from, if the way is not foreseen."""
    if not trial.lift_foreseen:
        yield from trial.back()
    for _ in range(LIFTS):
        if trial.now.opening < CLOSED:
            break
        yield from trial.lift()


class ReachSpaces(gym.Env[Any, Any]):
    """The spaces in which an agent reaches for the intermediate position; it makes no motions of its own.

    Args:
        arm: How many motors bring the gripper there.
    """

    def __init__(self, arm: int) -> None:
        box = spaces.Box(-1.0, 1.0, (4,), np.float32)
        state = spaces.Box(-1.0, 1.0, (4 + arm,), np.float32)
        goals = {"achieved_goal": box, "desired_goal": box}
        self.observation_space = spaces.Dict({**goals, "observation": state})
        self.action_space = spaces.Box(-1.0, 1.0, (arm,), np.float32)
