"""The procedure of Yoshimi & Allen (1994), as far as it goes with cameras that stand beside the arm."""

from collections.abc import Generator
from typing import Any

import numpy as np

from calfree_gym.image import IMAGE_UNIT

from ..base.observation import Array, RawObservation
from ..base.prior_knowledge import PriorKnowledge
from ..base.procedure import ProcedureAgent
from ..base.registers import met_something
from ..base.registration import agent
from ..servo.servo_agent import SERVO_KNOWLEDGE
from .observation import ARM, BASE, OBJECT, TIP, InsertObservation


def ellipse_centre(points: Array) -> Array:
    """The centre (2,) of the ellipse that fits points (k, 2) best; their mean, where none does.

    By direct least squares (Halir & Flusser 1998), with points moved and scaled to about 1.
    """
    middle = points.mean(0)
    size = float(np.sqrt(np.square(points - middle).mean()))
    if len(points) < 6 or size == 0:
        return np.asarray(middle)
    x, y = ((points - middle) / size).T
    squares, lines = np.stack([x * x, x * y, y * y], 1), np.stack([x, y, np.ones_like(x)], 1)
    try:
        of_lines = -np.linalg.solve(lines.T @ lines, lines.T @ squares)
    except np.linalg.LinAlgError:
        return np.asarray(middle)
    reduced = squares.T @ squares + squares.T @ lines @ of_lines
    values, vectors = np.linalg.eig(np.stack([reduced[2] / 2, -reduced[1], reduced[0] / 2]))
    a, b, c = np.real(vectors)
    is_ellipse = 4 * a * c - b * b > 0
    if not is_ellipse.any():
        return np.asarray(middle)
    best = int(np.where(is_ellipse, np.abs(np.real(values)), np.inf).argmin())
    a, b, c = np.real(vectors[:, best])
    d, e, _ = of_lines @ np.real(vectors[:, best])
    centre = np.linalg.solve([[2 * a, b], [b, 2 * c]], [-d, -e])
    return np.asarray(middle + size * centre)


Motions = Generator[Array, InsertObservation, Any]
"""Yields control words (4,), is sent what is observed after them."""

TURNS, TURN = 6, 0.15
"""Words by which the tool is turned. Choice: from a quarter turn, at the smallest gain, to a half."""
TEST = 0.04
"""Of each motor's first test word. Choice: the peg moves by 2 to 10 cm."""
TRANSLATION_PX = 8.0
"""So far the two small translations move the peg across its axis in the images. Tuned on worlds 1000
to 1059, from 8 to 28."""
LONGEST = 0.25
"""Of a word, where the peg is far from the hole. Choice: farther, the Jacobian no longer holds."""
ABOVE, NEAR = 0.35, 0.06
"""So far above the plate the peg is brought over the hole, and at last, in gripper lengths. Tuned likewise,
from 0.35 to 1 and from 0.06 to 0.1."""
OVER_PX = 1.5
"""The peg is over the hole where the hole is seen so near to its axis, in both images. Choice: twice the
noise."""
FAR_PX = 12.0
"""Far from there the axis is one that the tool does not turn about. Choice: a third of the gripper's
length."""
STEPS, ROUNDS, LOOKS = 5, 4, 2
"""So many steps by one Jacobian, and so many of these (guards). So often it looks before it goes down."""
SHARE = 0.4
"""Of an error that one look shows, so much is made good, near the hole. Choice: the rest may be noise."""
DOWN = 0.035
"""Of each step into the hole, in gripper lengths. Choice: short, as in `Insert`."""
DEEPEST = 0.27
"""So deep it goes, in gripper lengths. Choice: as `Insert`."""


@agent(
    "yoshimi_allen",
    "Finds the tool's axis by turning it, brings that over the hole, and inserts along it (1994).",
    tasks=("insert",),
)
class YoshimiAllen(ProcedureAgent):
    """Turns the tool, finds its axis, brings that over the hole by a 2 x 2 Jacobian, and inserts along it.

    Yoshimi & Allen use a single camera, and a robot that moves its tool in a known plane. Here two cameras
    stand beside the arm, and it is not known what words do. So, of theirs: points that turn with the tool
    trace ellipses, whose centre is on its axis; two small translations across that axis tell a 2 x 2
    Jacobian; by this the axis is brought through the hole; then the peg goes along it. The error is that of
    the hole and the axis's line, in each of two images. What replaces their robot's plane: three test
    motions, one a motor, tell which words move the peg across its axis, and which along it. Reconstructed
    from a summary of their procedure.

    It remembers nothing, and filters nothing but by looking again.

    Args:
        env, seed: See `Agent`.
    """

    kind = "yoshimi_allen"
    prior_knowledge = SERVO_KNOWLEDGE | {PriorKnowledge.MOTOR_ORDER}

    def observed(self, raw: RawObservation) -> InsertObservation:
        return InsertObservation.of(raw)

    def procedure(self, first: Any, findings: None) -> Generator[Array, Any, None]:
        tool = Tool(first)
        yield from tool.turn(TURN)
        for _ in range(ROUNDS):
            yield from tool.test_motors()
            yield from tool.rise(ABOVE)
            yield from tool.test_translations()
            yield from tool.servo(-ABOVE)
            if tool.off_px < FAR_PX:
                break
        yield from tool.turn(-TURN)
        yield from tool.test_motors()
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
        self._motors: Array | None = None
        self._ways = np.eye(ARM, 2)
        self._jacobian = np.eye(2)

    @property
    def errors(self) -> Array:
        """How far the hole is seen from the tool's axis (2,), left and right, in image units; signed."""
        way, axis = self.now.points[OBJECT] - self.now.points[TIP], self._axis
        sides = axis[:, 0] * way[:, 1] - axis[:, 1] * way[:, 0]
        return np.asarray(sides / np.maximum(np.linalg.norm(axis, axis=1), IMAGE_UNIT))

    @property
    def off_px(self) -> float:
        """The larger of both, in pixels."""
        return float(np.abs(self.errors).max() / IMAGE_UNIT)

    @property
    def _depth(self) -> float:
        """How deep the peg's end is, in gripper lengths, as both images tell."""
        axis, way = self._axis.ravel(), (self.now.points[TIP] - self.now.points[OBJECT]).ravel()
        return float(way @ axis / max(axis @ axis, IMAGE_UNIT**2))

    def _features(self) -> Array:
        return np.append(self.errors, self._depth)

    def _move(self, words: Array, turn: float = 0.0) -> Motions:
        registers = self.now.registers[:ARM]
        words = words / max(1.0, float(np.abs(words).max()) / LONGEST)
        self.now = yield np.append(words, turn)
        executed = self.now.registers[:ARM] - registers
        self._touched = met_something(words, words - executed)

    @property
    def _length(self) -> float:
        """Of the gripper, in image units: the mean of both images."""
        return float(np.linalg.norm(self._axis, axis=1).mean())

    def turn(self, word: float) -> Motions:
        """Turns the tool: its axis goes from the middle of the ellipses of its edges to the peg's end."""
        looks = []
        for _ in range(TURNS):
            yield from self._move(np.zeros(ARM), word)
            looks.append(self.now)
        self._axis = axis_of(looks)

    def test_motors(self) -> Motions:
        """Moves each motor of the arm: what it does across the tool's axis, and along it."""
        if self._motors is None:
            found, sizes = np.eye(3), np.full(ARM, TEST)
        else:
            found = self._motors.copy()
            px = np.append(np.ones(2), self._length)[:, None] * found
            sizes = np.minimum(TEST, TRANSLATION_PX * IMAGE_UNIT / np.linalg.norm(px, axis=0))
        for motor in range(ARM):
            before, words = self._features(), np.zeros(ARM)
            here = self.now.registers[motor]
            words[motor] = np.copysign(sizes[motor], -here)
            yield from self._move(words)
            executed = self.now.registers[motor] - here
            if executed:
                found[:, motor] = (self._features() - before) / executed
        self._motors = found

    def test_translations(self) -> Motions:
        """Two small translations across the axis tell the 2 x 2 Jacobian of the errors."""
        self._ways = TRANSLATION_PX * IMAGE_UNIT * self._inverse[:, :2]
        for i, way in enumerate(self._ways.T):
            back = self.errors[i] > 0
            before, registers = self.errors, self.now.registers[:ARM]
            yield from self._move(-way if back else way)
            along, square = (self.now.registers[:ARM] - registers) @ way, way @ way
            if abs(along) > 0.1 * square:
                self._jacobian[:, i] = (self.errors - before) / (along / square)

    def servo(self, depth: float) -> Motions:
        """Brings the axis over the hole, and the peg's end to a depth; ends where that makes it no better."""
        for _ in range(STEPS):
            off = self.off_px
            yield from self._move(self._over(1.0) + self._along * (depth - self._depth))
            near = abs(self._depth - depth) < NEAR
            if near and (self.off_px < OVER_PX or self.off_px > off / 2):
                return

    def across(self, share: float) -> Motions:
        """Makes good a share of the error that is seen."""
        yield from self._move(self._over(share))

    def rise(self, height: float) -> Motions:
        """Back along the axis, to a height above the hole, where it is lower."""
        if self._depth > -height:
            yield from self._move(-(self._depth + height) * self._along)

    def insert(self) -> Motions:
        """Along the axis into the hole; where it meets the plate, back up. The axis is kept over the hole."""
        for _ in range(round((NEAR + DEEPEST) / DOWN)):
            above = self._depth < -DOWN
            yield from self._move(DOWN * self._along + above * self._over(SHARE))
            if self._touched:
                break
        yield from self.rise(NEAR)

    @property
    def _inverse(self) -> Array:
        """Words (3, 3) that move the peg across the axis, in both images, and along it."""
        return np.asarray(np.linalg.pinv(np.eye(3) if self._motors is None else self._motors))

    @property
    def _along(self) -> Array:
        """Words (3,) that move the peg by a gripper length along its axis."""
        return self._inverse[:, 2]

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
