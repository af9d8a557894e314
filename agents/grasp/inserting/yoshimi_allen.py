"""The procedure of Yoshimi & Allen (1994), as far as it goes with cameras that stand beside the arm."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

import numpy as np

from calfree_gym.image import IMAGE_UNIT

from ...base.observation import Array, RawObservation
from ...base.prior_knowledge import PriorKnowledge
from ...base.procedure import ProcedureAgent
from ...servo.settings import SERVO_KNOWLEDGE
from ...servo.trial import met_something
from ..observation import ARM, BASE, OBJECT, TIP
from .ellipse import ellipse_centre
from .observation import InsertObservation

Motions = Generator[Array, InsertObservation, Any]
"""Yields control words (4,), is sent what is observed after them."""

TURNS, TURN = 6, 0.15
"""Words by which the tool is turned. Choice: from a quarter turn, at the smallest gain, to a half."""
TEST = 0.04
"""Of each motor's first test word. Choice: the peg moves by 2 to 10 cm."""
TRANSLATION_PX = 12.0
"""So far the two small translations move the peg across its axis in the images. Choice: a column is known to a
tenth."""
LONGEST = 0.25
"""Of a word, where the peg is far from the hole. Choice: farther, the Jacobian no longer holds."""
ABOVE, NEAR = 0.5, 0.1
"""So far above the plate the peg is brought over the hole, and at last, in gripper lengths. Choice: test motions
do not reach the plate, nor does noise."""
OVER_PX = 1.5
"""The peg is over the hole where the hole is seen so near to its axis, in both images. Choice: twice the noise."""
FAR_PX = 12.0
"""Far from there the axis is one that the tool does not turn about. Choice: a third of the gripper's length."""
STEPS, ROUNDS, LOOKS = 5, 4, 4
"""So many steps by one Jacobian, and so many of these (guards). So often it looks before it goes down."""
SHARE = 0.4
"""Of an error that one look shows, so much is made good, near the hole. Choice: the rest may be noise."""
DOWN = 0.05
"""Of each step into the hole, in gripper lengths; and so deep it goes. Choice: short, as in `Insert`."""
DEEPEST = 0.27


class YoshimiAllen(ProcedureAgent):
    """Turns the tool, finds its axis, brings that over the hole by a 2 x 2 Jacobian, and inserts along it.

    Yoshimi & Allen fix one camera to the hand, and move the tool in a plane by a calibrated robot. Here two
    cameras stand beside the arm, and it is not known what words do. So, of theirs: points that turn with the
    tool trace ellipses, whose centre is on its axis; two small translations across that axis tell a 2 x 2
    Jacobian; by this the axis is brought through the hole; then the peg goes along it. Their error, of hole and
    axis in one image, is here that of hole and the axis's line in each of two. What replaces their robot's
    plane: three test motions, one a motor, tell which words move the peg across its axis, and which along it.

    It remembers nothing, and filters nothing but by looking again.

    Args:
        env, seed: See `Agent`.
    """

    kind = "yoshimi_allen"
    prior_knowledge = SERVO_KNOWLEDGE | {PriorKnowledge.MOTOR_ORDER}

    def observed(self, raw: RawObservation) -> InsertObservation:
        """See `ProcedureAgent`."""
        return InsertObservation.of(raw)

    def procedure(self, first: Any, findings: None) -> Generator[Array, Any, None]:
        """See `ProcedureAgent`."""
        tool = Tool(first)
        yield from tool.turn(TURN)
        for _ in range(ROUNDS):
            yield from tool.test_motors()
            yield from tool.test_translations()
            yield from tool.servo(-ABOVE)
            if tool.off_px < FAR_PX:
                break
        yield from tool.turn(-TURN)
        yield from tool.test_translations()
        while True:
            yield from tool.servo(-NEAR)
            for _ in range(LOOKS):
                yield from tool.across(SHARE)
            yield from tool.insert()


class Tool:
    """What is known of the tool, and the motions of the procedure.

    Attributes:
        now: What was seen last.

    Args:
        first: The first observation.
    """

    def __init__(self, first: InsertObservation) -> None:
        self.now = first
        self._touched = False
        self._axis = first.points[TIP] - first.points[BASE]
        self._motors = np.eye(3)
        self._ways = np.eye(ARM, 2)
        self._jacobian = np.eye(2)

    @property
    def errors(self) -> Array:
        """How far the hole is seen from the tool's axis (2,), left and right, in image units; signed."""
        way, axis = self.now.points[OBJECT] - self.now.points[TIP], self._axis
        sides = axis[:, 0] * way[:, 1] - axis[:, 1] * way[:, 0]
        return np.asarray(sides / np.linalg.norm(axis, axis=1))

    @property
    def off_px(self) -> float:
        """The larger of both, in pixels."""
        return float(np.abs(self.errors).max() / IMAGE_UNIT)

    @property
    def _depth(self) -> float:
        """How deep the peg's end is, in gripper lengths, as both images tell."""
        axis, way = self._axis.ravel(), (self.now.points[TIP] - self.now.points[OBJECT]).ravel()
        return float(way @ axis / (axis @ axis))

    def _features(self) -> Array:
        return np.append(self.errors, self._depth)

    def _move(self, words: Array, turn: float = 0.0) -> Motions:
        before = self.now
        words = words / max(1.0, float(np.abs(words).max()) / LONGEST)
        self.now = yield np.append(words, turn)
        short = words - (self.now.registers - before.registers)[:ARM]
        self._touched = met_something(words, short)

    def turn(self, word: float) -> Motions:
        """Turns the tool: its axis goes from the middle of the ellipses of its edges to the peg's end."""
        looks = []
        for _ in range(TURNS):
            yield from self._move(np.zeros(ARM), word)
            looks.append(self.now)
        self._axis = axis_of(looks)

    def test_motors(self) -> Motions:
        """Moves each motor of the arm: what it does across the tool's axis, and along it."""
        for motor in range(ARM):
            before, words = self._features(), np.zeros(ARM)
            here = self.now.registers[motor]
            words[motor] = -TEST if here > 0 else TEST
            yield from self._move(words)
            executed = self.now.registers[motor] - here
            if executed:
                self._motors[:, motor] = (self._features() - before) / executed

    def test_translations(self) -> Motions:
        """Two small translations across the axis tell the 2 x 2 Jacobian of the errors."""
        inverse = np.linalg.pinv(self._motors)
        self._ways = TRANSLATION_PX * IMAGE_UNIT * inverse[:, :2]
        for i, way in enumerate(self._ways.T):
            back = self.errors[i] > 0
            before, registers = self.errors, self.now.registers[:ARM]
            yield from self._move(-way if back else way)
            share = (self.now.registers[:ARM] - registers) @ way / (way @ way)
            if abs(share) > 0.1:
                self._jacobian[:, i] = (self.errors - before) / share

    def servo(self, depth: float) -> Motions:
        """Brings the axis over the hole, and the peg's end to a depth; ends where that makes it no better."""
        along = np.linalg.pinv(self._motors)[:, 2]
        for _ in range(STEPS):
            off = self.off_px
            way = depth - self._depth
            yield from self._move(self._over(1.0) + along * way)
            near = abs(self._depth - depth) < NEAR
            if near and (self.off_px < OVER_PX or self.off_px > off / 2):
                return

    def across(self, share: float) -> Motions:
        """Makes good a share of the error that is seen."""
        yield from self._move(self._over(share))

    def insert(self) -> Motions:
        """Along the axis into the hole, until that is met or the peg is in."""
        along = np.linalg.pinv(self._motors)[:, 2]
        for _ in range(round((NEAR + DEEPEST) / DOWN)):
            yield from self._move(DOWN * along)
            if self._touched:
                return

    def _over(self, share: float) -> Array:
        """Words (3,) that make good a share of the errors, by the 2 x 2 Jacobian."""
        return -share * self._ways @ np.linalg.lstsq(self._jacobian, self.errors, rcond=None)[0]


def axis_of(looks: list[InsertObservation]) -> Array:
    """The tool's axis in both images (2, 2), from looks between which it turned: a gripper's length.

    From the middle of the ellipse that its edges trace to the middle of what the peg's end traces.
    """
    points = np.stack([each.points for each in looks])
    edges = points[:, 4:6].reshape(-1, 2, 2)
    centres = np.stack([ellipse_centre(edges[:, image]) for image in range(2)])
    return np.asarray(points[:, TIP].mean(0) - centres)


