"""`safe_start`: first motions, then any servo on a leash."""

from collections.abc import Generator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import RANK, lengths_px

from ...base.checks import checked_array
from ...base.observation import POINTS, Array, Observation
from ...base.prior_knowledge import PriorKnowledge
from ...base.procedure import Procedure, RunningTrial
from ...base.registration import agent
from ..jacobian import distance_jacobian
from ..perception import ObservationFilter
from ..servo_agent import SERVO_KNOWLEDGE, Servo, ServoAgent
from ..slopes import Slopes
from ..trial import Findings
from .leash import Leash, LinearView, StraightWay, equal_units, in_units

Motions = Generator[Array, Observation, None]
DIRECTIONS = 3
"""In which a gripper can move."""


class FirstMotions:
    """Stands still to learn how noisy images are, then moves motor after motor, there and back and farther.

    A motor goes to one side of where it began, then farther to the other side, and so on: as long as the
    images answer in proportion, and until they have moved clearly. Where words are executed in part, a point
    is lost, or the images answer otherwise, it goes back, and on by half as much, the other way; where a
    register shows nothing of a word, on by twice as much, the other way: it may be coarse.

    Attributes:
        now: The last look.
        view: What was learned of the Jacobian.
        tested: How far each motor (m,) has been from where it began; 0 where it was left alone.
        blocked: Motors (m,) that executed their smallest words neither way.
        unseen: Motors (m,) whose motions are not seen.

    Args:
        first: The first look, at home.
        filter_: What is known of observations.
    """

    LOOKS = 2
    """So often it looks again before anything moves. Derived: 16 differences of coordinates, by which noise
    is known to a fifth."""
    FIRST_WORD = 1 / 512
    """Of the first motion. Choice: a motor of which register 1 means fourteen turns then turns by 10
    degrees."""
    CLEAR = 10.0
    """The images have moved clearly by so many standard deviations of their noise (METHODS: 10 σ)."""
    DOUBLE, MOST_GROWTH = 2.0, 8.0
    """Words at least double, and grow to what is expected to be clear, by at most this factor. Choice."""
    WANTED = 2.5
    """A word is to move the images by so many times what is clear. Choice: the second word mostly does, and
    by one centimetre at the gripper."""
    OF_NOISE = 2.0
    """So many standard deviations images may have moved more than they seem to: words grow as if they had.
    Choice: 95 %."""
    IN_PROPORTION = 0.5
    """Images answer in proportion that are off by no more than this share. Choice: 2 c then moves them by Δs
    to 3 Δs."""
    UNSURE = 4.0
    """What a look tells of the images farther off is unsure by so many standard deviations. Derived: three,
    each of a difference of two looks (√2)."""
    LARGEST_UNSEEN = 0.125
    """A word so large that moves no image is the last. Choice: words of the weakest motors of wild worlds
    show."""
    ALIKE = 0.2
    """Motors move the gripper in three directions where the third singular value of their columns, each of
    length 1, is this share of the first. Choice."""
    LEFT = 0.2
    """And they bring it to the object where they leave no more than this share of the image distance.
    Choice."""
    ROOM = 0.5
    """And no motor has to go farther than this. Choice: half of its registers is left for what is not
    straight."""
    TRIES = 12
    """Motions of a motor at most (a guard)."""
    EXECUTED = 0.5
    """Words of which a smaller share was executed met something. Choice: registers may be coarse."""
    UNSHOWN = 16.0
    """A motor whose register shows nothing of words so many times the first, either way, is blocked. Choice:
    no encoder is coarser than a thirtieth of its motor's way."""

    def __init__(self, first: Observation, filter_: ObservationFilter) -> None:
        motors = len(first.registers)
        self.now = first
        self.view = LinearView(motors)
        self.tested = np.zeros(motors)
        self.blocked, self.unseen = np.zeros(motors, bool), np.zeros(motors, bool)
        self._filter = filter_

    @property
    def noise_px(self) -> float:
        """Standard deviation of an image coordinate."""
        return self._filter.noise.px

    def run(self) -> Motions:
        """Makes all of them."""
        self.view.look(self.now, self.noise_px)
        for _ in range(self.LOOKS):
            before = self.now
            yield from self._look(np.zeros_like(self.tested))
            seen = before.visible & self.now.visible
            self._filter.noise.add((self.now.points - before.points)[seen])
        for motor in range(len(self.tested)):
            yield from self._test(motor)
            if self.now.last or self._enough:
                break

    @property
    def _enough(self) -> bool:
        """Whether known motors can bring the gripper to the object, so that the others may rest."""
        distances = distance_jacobian(self.view.jacobian)
        lengths = np.sqrt(np.square(distances).sum(0))
        known = lengths > 0
        columns = distances[:, known] / lengths[known]
        if columns.shape[1] < DIRECTIONS:
            return False
        sizes = np.linalg.svd(columns, compute_uv=False)
        words = -np.linalg.lstsq(columns, self.now.distance, rcond=RANK)[0]
        near = np.linalg.norm(self.now.distance + columns @ words) <= self.LEFT * np.linalg.norm(
            self.now.distance
        )
        there = np.abs(self.now.registers[known] + words / lengths[known]).max() <= self.ROOM
        return bool(sizes[DIRECTIONS - 1] >= self.ALIKE * sizes[0] and near and there)

    def _look(self, words: Array) -> Motions:
        self.now = yield words
        self.view.look(self.now, self.noise_px)

    def _test(self, motor: int) -> Motions:
        began = self.now
        unit = np.eye(len(self.tested))[motor]
        size, side, refused = self.FIRST_WORD, 1.0, set[float]()
        for _ in range(self.TRIES):
            before, offset = self.now, self.now.registers[motor] - began.registers[motor]
            words = (side * size - offset) * unit
            column = self.view.jacobian[:, motor].copy()
            yield from self._look(words)
            at = float(self.now.registers[motor] - began.registers[motor])
            if self.now.last:
                return
            short = abs(self.now.registers[motor] - before.registers[motor]) < self.EXECUTED * abs(
                words[motor]
            )
            lost = bool((began.visible & ~self.now.visible).any())
            moved = (self.now.points - began.points)[began.visible & self.now.visible]
            moved_px = float(lengths_px(moved).max(initial=0.0))
            if at == offset and not lost:
                refused.add(side)
                if len(refused) == 2 and size > self.UNSHOWN * self.FIRST_WORD:
                    self.blocked[motor] = not self.tested[motor]
                    return
                size, side = self.DOUBLE * size, -side
                continue
            if short or lost:
                refused.add(side)
                if lost:
                    yield from self._look(before.registers - self.now.registers)
                elif moved_px >= self._clear_px:
                    break
                size, side = size / 2, -side
                if len(refused) == 2 and size < self.FIRST_WORD / 2:
                    self.blocked[motor] = not self.tested[motor]
                    return
                continue
            otherwise, before_that = self._error_px(column * at, began), self.tested[motor]
            self.tested[motor] = max(before_that, abs(at))
            blur_px = self.UNSURE * self.noise_px * abs(at) / max(before_that, self.FIRST_WORD)
            if column.any() and otherwise > blur_px + max(self._clear_px, self.IN_PROPORTION * moved_px):
                refused.add(side)
                size, side = size / 2, -side
                continue
            if moved_px >= self._clear_px or refused:
                break
            if size >= self.LARGEST_UNSEEN:
                self.unseen[motor] = True
                return
            likely = self.WANTED * self._clear_px / (moved_px + self.OF_NOISE * self.noise_px)
            size = min(size * float(np.clip(likely, self.DOUBLE, self.MOST_GROWTH)), self.LARGEST_UNSEEN)
            side = -side

    def _error_px(self, expected: Array, began: Observation) -> float:
        """By how much (px) points are not where they should be, `expected` (8,) away from `began`."""
        seen = began.visible & self.now.visible
        return float(
            lengths_px(self.now.points - began.points - expected.reshape(-1, 2))[seen].max(initial=0.0)
        )

    @property
    def _clear_px(self) -> float:
        return self.CLEAR * self.noise_px


@dataclass
class SafeFindings(Findings[Any]):
    """What it finds out in a trial.

    Attributes:
        units: What the servo takes for a word of 1, of each motor (m,), see `Leash`.
        tested: How far each motor (m,) has been.
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
    it sends zero words, and `gave_up` says why. In a later trial the servo goes on at once, with what it
    has learned, on a leash as short as at first; one whose Jacobian does not last (`paper_servo`,
    `work_plane_servo`) after first motions again.

    Args:
        env, seed: See `Agent`.
        servo: The servo.
    """

    def __init__(self, env: Any, servo: Servo, seed: int = 0) -> None:
        super().__init__(env, servo, seed)
        self.units = self.tested = np.ones(self.motors)
        self.prior_knowledge = (servo.prior_knowledge | SERVO_KNOWLEDGE) - {PriorKnowledge.WORD_LIMIT}

    def new_findings(self) -> SafeFindings:
        findings = super().new_findings()
        known = findings.estimator, findings.filter
        return SafeFindings(*known, edges=findings.edges, units=self.units, tested=self.tested.copy())

    def procedure(self, first: Observation, findings: Any) -> Procedure:
        now = yield from findings.filter.first(first)
        if self.slopes is None:
            leash = yield from self._begin(now, findings)
            if leash is None:
                return
        else:
            view = LinearView(self.motors)
            view.jacobian = self.slopes.jacobian / findings.units
            leash = Leash(now, view, findings.tested, findings.filter, findings.units)
            findings.handed_over = True
        now = in_units(leash.now, findings.units)
        findings.stops = leash.stops.of(findings.units)
        findings.gave_up = yield from leash.hold(self.servo(now, findings))

    def _begin(self, now: Observation, findings: Any) -> Generator[Array, Observation, Leash | None]:
        """First motions, then straight to the object; the leash for its servo, unless it ends before that."""
        motions = FirstMotions(now, findings.filter)
        yield from motions.run()
        now, view = motions.now, motions.view
        findings.tested = np.maximum(motions.tested, FirstMotions.FIRST_WORD)
        if now.last:
            return None
        findings.gave_up = _hopeless(motions)
        if findings.gave_up:
            return None
        findings.units = equal_units(view.jacobian)
        leash = Leash(now, view, findings.tested, findings.filter, findings.units)
        way = StraightWay(view, leash, findings.units)
        findings.gave_up = yield from leash.hold(way.go(in_units(now, findings.units)), whole=False)
        findings.estimator = self.servo.new_estimator(self.motors, _slopes(view, findings, leash.now))
        findings.handed_over = True
        return None if findings.gave_up or leash.now.last else leash

    def learn_trial(self, findings: Any, last: Observation, ended: bool) -> None:
        """See `ProcedureAgent`. A trial that ended before the servo went on teaches nothing but noise."""
        if not findings.handed_over:
            self.filter = findings.filter
            return
        super().learn_trial(findings, last, ended)
        self.units, self.tested = findings.units, findings.tested

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        return super().arrays() | {"units": self.units, "tested": self.tested}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
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
