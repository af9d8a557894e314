"""The paper's servo before a dock, for any number of points and motors; and one that also moves aside.

On omnidirectional wheels the first one docks. On two wheels it stops beside the dock: no word moves the robot
sideways. But a virtual motor does, the commutator of turning and going: turn, go back, turn back, go ahead,
and the robot stands as before, but aside.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import IMAGE_UNIT, rounded

from ..base.checks import checked_array
from ..base.observation import Array
from ..base.prior_knowledge import PriorKnowledge
from ..base.procedure import Procedure, ProcedureAgent
from ..base.registration import agent
from .observation import DockObservation

Motions = Generator[Array, DockObservation, None]


@dataclass
class Learned:
    """What a trial leaves to the next one.

    Attributes:
        words: Test words (m,), which move the images by about as much.
        turning: Words (m,) of length 1 that move the images most; zero before any are known.
        aside: What a commutator of size 1 does to the points (2p,); zero before it is known.
    """

    words: Array
    turning: Array
    aside: Array


class DockingServo(ProcedureAgent):
    """What both servos share."""

    prior_knowledge = frozenset({PriorKnowledge.IMAGE_SCALE, PriorKnowledge.NOISE, PriorKnowledge.WORD_LIMIT})
    FIRST_WORD = 0.05
    """Of test motions. Choice: a few pixels to a tenth of the image."""

    def __init__(self, env: gym.Env[Any, Any], seed: int = 0) -> None:
        super().__init__(env, seed)
        (size,) = env.observation_space["achieved_goal"].shape  # type: ignore[index]
        self.learned = Learned(np.full(self._motors, self.FIRST_WORD), np.zeros(self._motors), np.zeros(size))

    @property
    def kind(self) -> str:
        return f"{type(self).__name__}()"

    def observed(self, raw: Any) -> DockObservation:
        return DockObservation.of(raw)

    def new_findings(self) -> Learned:
        return Learned(**{name: each.copy() for name, each in self.arrays().items()})

    def learn_trial(self, findings: Learned, last: Any, ended: bool) -> None:
        self.learned = findings

    def arrays(self) -> dict[str, NDArray[Any]]:
        return dict(vars(self.learned))

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        shapes = {name: each.shape for name, each in self.arrays().items()}
        self.learned = Learned(**{name: checked_array(arrays, name, shape) for name, shape in shapes.items()})
        if not self.learned.words.all():
            raise ValueError("the saved words hold 0; allowed: others, for test motions are to move")


@agent("jacobian_servo", "Tests each motor, then corrects its Jacobian by every motion.", tasks=("dock",))
class DockingJacobianServo(DockingServo):
    """Solves -d = J c°, executes, corrects J by what was seen (Broyden 1965), repeats.

    Where a step came hardly nearer, motors are tested anew. Where it lost marks, it is undone, and halved.
    """

    NEARER = 0.8
    """A step came nearer that left less than this share of the image distance. Choice."""

    def procedure(self, first: Any, findings: Learned) -> Procedure:
        """See `ProcedureAgent`."""
        trial = DockingTrial(first, findings)
        jacobian = yield from trial.test()
        while True:
            before, words = trial.now, trial.shortened(jacobian, trial.solve(jacobian))
            if not (yield from trial.drive([words])):
                continue
            if trial.now.distance_px > self.NEARER * before.distance_px:
                jacobian = yield from trial.test()
            else:
                missed = trial.now.distance - before.distance - jacobian @ words
                jacobian = jacobian + np.outer(missed, words) / max(float(words @ words), IMAGE_UNIT**2)


@agent("commuting_servo", "Also moves aside, by turning and going in turns.", tasks=("dock",))
class CommutingServo(DockingServo):
    """Solves for words and for the size of a commutator: as if there were one motor more.

    The first singular direction of the Jacobian turns, the second one goes: back is where the dock is seen
    smaller.
    """

    prior_knowledge = DockingServo.prior_knowledge | {PriorKnowledge.CAMERA_MODEL, PriorKnowledge.FLOOR}
    FIRST = 8.0
    """Size of the first commutator, in pixels turned times words gone. Choice: about two test motions."""
    LONGEST_PX, LARGEST = 150.0, 90.0
    """No step is predicted to move points farther, and no commutator is larger. Choice."""
    LEAST = 0.3
    """Smaller ones are left out. Choice: they show less than noise."""
    BLEND = 0.5
    """So much is learned of what a commutator was expected to do and did not. Choice."""

    def procedure(self, first: Any, findings: Learned) -> Procedure:
        """See `ProcedureAgent`."""
        trial = DockingTrial(first, findings)
        while True:
            jacobian = yield from trial.test()
            trial.find_ways(jacobian)
            if not findings.aside.any():
                before = trial.now
                if (yield from trial.drive(trial.commutator(self.FIRST))):
                    findings.aside = (trial.now.points - before.points).reshape(-1) / self.FIRST
                continue
            columns = np.column_stack([jacobian, findings.aside])
            *words, aside = trial.solve(columns)
            longest = float(np.abs(jacobian @ words).max()) / (self.LONGEST_PX * IMAGE_UNIT)
            most = trial.share / max(1.0, longest, abs(aside) / self.LARGEST)
            words, aside = np.array(words) * most, aside * most
            way = [words / max(1.0, float(np.abs(words).max()))]
            if abs(aside) > self.LEAST:
                way += trial.commutator(aside)
            before = trial.now
            if not (yield from trial.drive(way)):
                continue
            if abs(aside) > self.LEAST:
                missed = trial.now.distance - before.distance - columns @ [*words, aside]
                findings.aside = findings.aside + self.BLEND * missed * aside / (aside**2 + 1)


class DockingTrial:
    """Motions of one trial.

    Attributes:
        now: What was seen last.
        learned: What is known, and becomes so.
        share: Of a step that is made.

    Args:
        first: What is seen where it begins.
        learned: By earlier trials.
    """

    TEST_PX, MOST = 30.0, 0.5
    """So far test motions are to move images, and no word of one is longer. Choice: as of other servos."""
    OTHER_WAY = -0.7
    """Where a test motion loses marks, the next one goes the other way by this share. Choice."""
    CUT, GROWTH = 0.5, 1.5
    """Steps are shorter where marks were lost, and longer again where they were not. Choice."""
    STEP_PX = 80.0
    """No step is predicted to move points farther. Choice: the Jacobian is another one there."""
    DAMPING = 0.03
    """Of least squares, as a share of each column. Choice: what noise leaves of a test motion."""
    TURN_PX = 10.0, 110.0, 200.0
    """A commutator turns by at least and at most so much; between, by as much as it goes when a word moves by
    the third. Choice: within the images."""

    def __init__(self, first: DockObservation, learned: Learned) -> None:
        self.now, self.learned, self.share = first, learned, 1.0
        self._turn = self._back = np.zeros_like(learned.words)

    def drive(self, way: Sequence[Array]) -> Generator[Array, DockObservation, bool]:
        """Executes words (n, m), and where marks are lost by then, goes back; whether they were seen."""
        for words in way:
            self.now = yield words
        seen = bool(self.now.visible.all())
        self.share = min(1.0, self.share * self.GROWTH) if seen else self.share * self.CUT
        for words in reversed(way):
            if self.now.visible.all():
                break
            self.now = yield -words
        return seen

    def test(self) -> Generator[Array, DockObservation, Array]:
        """Tests each motor: how points move by its words (2p, m), in image units."""
        columns = []
        for motor, unit in enumerate(np.eye(len(self.learned.words))):
            before, word = self.now, float(self.learned.words[motor])
            while not (yield from self.drive([word * unit])):
                before, word = self.now, self.OTHER_WAY * word
            moved = (self.now.points - before.points).reshape(-1)
            columns.append(moved / word)
            share = self.TEST_PX * IMAGE_UNIT / max(float(np.abs(moved).max()), IMAGE_UNIT)
            self.learned.words[motor] = np.clip(word * np.clip(share, 0.3, 3), -self.MOST, self.MOST)
        return np.stack(columns, 1)

    def solve(self, jacobian: Array) -> Array:
        """Words (n,) that are to leave no distance, by the Jacobian (2p, n): damped least squares."""
        sizes = np.linalg.norm(jacobian, axis=0) + IMAGE_UNIT
        a = jacobian / sizes
        damped = a.T @ a + self.DAMPING**2 * np.eye(len(sizes))
        return np.asarray(-np.linalg.solve(damped, a.T @ self.now.distance) / sizes)

    def shortened(self, jacobian: Array, words: Array) -> Array:
        """Words (m,), no longer than a step and a word can be."""
        moved = float(np.abs(jacobian @ words).max()) / (self.STEP_PX * IMAGE_UNIT)
        return self.share * words / max(1.0, moved, float(np.abs(words).max()))

    def find_ways(self, jacobian: Array) -> None:
        """Which words turn, and which ones go back, by the Jacobian (2p, m)."""
        turning, going = np.linalg.svd(jacobian)[2][:2]
        known = self.learned.turning
        if not known.any():
            known = np.eye(len(turning))[rounded(np.abs(turning)).argmax()]
        turning = turning if turning @ known > 0 else -turning
        self.learned.turning = turning
        self._turn = turning * IMAGE_UNIT / np.abs(jacobian @ turning).max()
        moved = (jacobian @ going).reshape(-1, 2)
        larger = ((self.now.points - self.now.points.mean(0)) * (moved - moved.mean(0))).sum() > 0
        self._back = (-going if larger else going) / np.abs(going).max()

    def commutator(self, size: float) -> list[Array]:
        """Words (n, m) that turn, go back, turn back and go ahead.

        Args:
            size: Pixels turned times words gone; negative, where it turns the other way.
        """
        least, most, ratio = self.TURN_PX
        turned = float(np.clip(np.sqrt(abs(size) * ratio), least, most))
        turn, back = self._turn * turned * np.sign(size), self._back * abs(size) / turned
        turns, backs = (_in_parts(each) for each in (turn, back))
        return [*turns, *backs, *(-each for each in turns), *(-each for each in backs)]


def _in_parts(words: Array) -> list[Array]:
    """Words (m,) as several that can be sent."""
    parts = max(1, int(np.ceil(np.abs(words).max())))
    return [words / parts] * parts
