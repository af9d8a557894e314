"""One trial as a servo lives through it: its motions, and what they tell of motors and Jacobian."""

from collections.abc import Generator, Iterator
from dataclasses import dataclass, field
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

from calfree_gym.image import inner, lengths_px

from ..base.observation import POINTS, Array, Flags, Observation
from ..base.registers import Stops
from .jacobian import SIGN_CHANGE, Estimator, JacobianEstimate, distance_jacobian, linear_deviations_px
from .perception import Gating, ObservationFilter, Observing
from .redundancy import REDUNDANCIES, solve_within

Motions = Generator[Array, Observation, Any]
"""Yields control words, is sent what is observed after them."""


E = TypeVar("E", bound=JacobianEstimate)


@dataclass
class Findings(Generic[E]):
    """What a servo finds out in a trial.

    Attributes:
        estimator: What is known of the Jacobian.
        filter: What is known of observations.
        trusted: The observations that passed the filter, none of their points merely predicted.
        stops: Where motors are known to stop, if that is known beforehand.
        gave_up: Why no further motion is known, or nothing.
        given_up: Whether what was known at the trial's beginning has been given up.
        tried_again: Whether stops were forgotten, to see if motors still stop there.
        edges: Where images end (4, 2), in image units, for each point.
        jumped: Since this one of `trusted` the gripper is seen, more than once, elsewhere than expected: the
            world has changed in mid-trial. 0: it has not.
    """

    estimator: E
    filter: ObservationFilter = field(default_factory=ObservationFilter)
    trusted: list[Observation] = field(default_factory=list)
    stops: Stops | None = None
    gave_up: str = ""
    given_up: bool = False
    tried_again: bool = False
    edges: Array = field(default_factory=lambda: np.ones((POINTS, 2)))
    jumped: int = 0

    AT_STOPS: ClassVar[str] = "no motor that would bring the gripper nearer moves any farther"

    def note_words(self, words: Array, now: Observation, stops: Stops) -> None:
        """Notes where words (m,) do nothing though the object is not reached; first stops are tried again."""
        far = now.visible.all() and now.distance_px > Gating.AGREE * np.sqrt(2) * self.filter.noise.px
        if far and np.abs(words).max() < Stops.NOTHING:
            self.gave_up = self.AT_STOPS if self.tried_again else ""
            self.try_again(stops)

    def try_again(self, stops: Stops) -> None:
        """Forgets stops, once in a trial, to see if motors still stop there."""
        if not self.tried_again:
            stops.forget()
        self.tried_again = True


class ServoTrial:
    """What a servo knows in a trial, and the motions that all servos are made of.

    Attributes:
        now: What is estimated after the last motion.
        findings: What has been found out.
        filter: What is known of observations.
        known: For which points and motors (4, m) J was learned from motions.
        test_words: The next test word of each motor (m,).
        still: Motors (m,) that moved nothing in the images: they are not tested again in this trial.
        object_jumped: Whether the object was last seen where J cannot have brought it.
        stops: Where motors are known to stop.

    Args:
        first: The first observation.
        findings: What to begin with.
        first_word: Size of the very first test words.
        test_px: Image displacement wanted of a test motion; its word adapts to that.
    """

    TRIES = 6
    """A test motion is repeated at most this often (a guard: words double at least every other time)."""
    SMALLER, GROWTH = 0.5, 2.0
    """A test word shrinks by this where a point got lost, and grows by this where a motor moved neither way.
    Choice: halves and doubles."""
    SMALLEST_TEST, LARGEST_TEST = 0.01, 0.5
    """Sizes of test words: tuned likewise."""
    MOST_GROWTH = 4.0
    """A test word grows or shrinks by this factor at most: tuned likewise."""
    LEAST_PX = 0.1
    """No motion moved the images by less (a guard: it is divided by)."""
    NOISES = 8.0
    """A test motion is to move the images by this many times the noise. Derived: then a column is known to a
    sixth (√2 / 8)."""
    CLEAR, HIDDEN = 4.0, 3.0
    """A column is measured until it is this many times longer than its standard deviation; and anew below:
    tuned likewise."""

    def __init__(
        self, first: Observation, findings: Findings[Estimator], first_word: float, test_px: float
    ) -> None:
        motors = len(first.registers)
        self.now = first
        self.findings = findings
        self.filter = findings.filter
        self.known = np.tile(self.estimator.jacobian.any(0), (POINTS, 1))
        self.test_words = np.full(motors, first_word)
        self.still = np.zeros(motors, bool)
        self.stops = findings.stops or Stops(first.registers)
        self.object_jumped = False
        self._seen_at = np.tile(first.registers, (POINTS, 1))
        self._tested = np.zeros(motors)
        self._confirmed = np.zeros(POINTS, bool)
        self._test_px = test_px

    @property
    def estimator(self) -> Estimator:
        """What is known of the Jacobian."""
        return self.findings.estimator

    @property
    def jacobian(self) -> Array:
        """The Jacobian of the image distance (4, m), as far as it is known."""
        return distance_jacobian(self.estimator.jacobian)

    @property
    def word_bounds(self) -> tuple[Array, Array]:
        """The lowest and the highest words (m,) that bring motors to their stops."""
        return self.stops.lowest - self.now.registers, self.stops.highest - self.now.registers

    def begin(self) -> Motions:
        """Observes until all points were seen."""
        self.now = yield from self.filter.first(self.now)

    def move(self, words: Array) -> Motions:
        """Executes words (m,), and learns; returns executed words (m,) and the points' displacement (4, 2).

        Where observations are noisy, and it is not known how noisy, it then observes until it is.
        """
        executed, moved = yield from self._move(words)
        while self.filter.needs_samples:
            yield from self._move(np.zeros_like(words))
        return executed, moved

    def _move(self, words: Array) -> Motions:
        before, words = self.now, np.clip(words, -1.0, 1.0)
        observation = yield words
        executed = observation.registers - before.registers
        moving = executed != 0
        known = np.asarray(self.known[:, moving].all(1))
        predicted = self.estimator.predict(executed)
        deviations_px = linear_deviations_px(predicted, known)
        expected = before.points + predicted
        observation = yield from self.filter.settle(observation, before, expected, deviations_px)
        self.stops.learn(words, words - executed, observation.registers)
        moved, usable = self._learn_motion(executed, before, observation, known)
        if np.count_nonzero(moving) == 1:
            self.known[usable, moving.argmax()] = True
        return executed, moved

    def _learn_motion(
        self, executed: Array, before: Observation, after: Observation, known: Flags
    ) -> tuple[Array, Flags]:
        """Learns from a motion what J is and where the points are.

        Returns:
            The points' displacement (4, 2), and from which of them (4,) J was learned.
        """
        inconsistent = self.filter.inconsistent
        self.object_jumped = bool((inconsistent & known)[2:].any())
        doubtful = inconsistent & (~self._confirmed | self.object_jumped)
        usable = after.visible & (before.visible | self.estimator.bridging) & ~doubtful
        seen = after.points - before.points
        self.estimator.noise_px = self.filter.noise.px
        moved = self.estimator.learn(executed, seen, usable)
        moved = np.where((after.visible & ~usable)[:, None], seen, moved)
        self.now = after.estimated(before.points + moved, after.visible)
        self.findings.trusted.append(after.estimated(after.points, after.visible & ~doubtful))
        self._confirmed |= after.visible
        self._seen_at[after.visible] = after.registers
        return moved, usable

    def go_back(self) -> Motions:
        """Returns to where a point that is not seen any more was seen last."""
        lost = int(self.filter.lost.argmax())
        yield from self.move(self._seen_at[lost] - self.now.registers)

    def move_in_view(self, words: Array) -> Motions:
        """Executes words (m,), and where that loses a point from view, goes half of the way back."""
        before = self.now
        yield from self.move(words)
        while self.filter.lost.any():
            yield from self.move(half_way_back(before, self.now))

    def test(self, motor: int) -> Motions:
        """Measures one motor's column of the Jacobian by a test motion, towards the object as last known.

        Where the motor does not move or gives way at a stop, or a point gets lost, it tries the other way;
        where too little moves in the images to stand out from noise it tries a larger word, back and forth,
        and motors that were never tested begin with that.
        """
        slope = inner(self.jacobian[:, motor], self.now.distance)
        if slope:
            self.test_words[motor] = -np.sign(slope) * abs(self.test_words[motor])
        lowest, highest = (bound[motor] for bound in self.word_bounds)
        if not lowest <= self.test_words[motor] <= highest:
            self.test_words[motor] *= -1
        stood = 0
        for _ in range(self.TRIES):
            words = np.zeros_like(self.test_words)
            words[motor] = self.test_words[motor]
            executed, moved = yield from self.move(words)
            if self.filter.lost.any():
                self.test_words[motor] *= -self.SMALLER
                yield from self.go_back()
            elif not executed[motor]:
                stood += 1
                self.test_words[motor] *= -1 if stood % 2 else -self.GROWTH
            else:
                self._tested[motor] = executed[motor]
                measured = self._measured(self.CLEAR)[motor]
                stopped = not measured and 2 * abs(executed[motor]) < abs(words[motor])
                if not stopped:
                    self._adapt(motor, float(executed[motor]), float(lengths_px(moved).max()))
                if measured:
                    return
                if not stopped and abs(words[motor]) >= self.LARGEST_TEST:
                    self.still[motor] = True
                    return
                self.test_words[motor] *= -1
                never = self._tested == 0
                self.test_words[never] = np.maximum(self.test_words[never], abs(self.test_words[motor]))

    def unmeasured(self) -> Iterator[int]:
        """The motors of whose columns nothing is known now, or no more than noise."""
        return (int(motor) for motor in np.flatnonzero(~self._measured(self.HIDDEN) & ~self.still))

    def _measured(self, times: float) -> Flags:
        """Which columns (m,) were learned, and are this many times longer than their standard deviation."""
        columns = self.estimator.jacobian
        lengths = np.hypot(columns[::2], columns[1::2]).max(0)
        clear = lengths > times * self.estimator.deviations(self._tested)
        return np.asarray(self.known.all(0) & (clear | (self._tested == 0)))

    def forget(self, deviation: float = SIGN_CHANGE) -> None:
        """Trusts J no more than a guess, see `Estimator.forget`; test words get their size by it."""
        self.estimator.forget(deviation)
        self.known[:] = False
        for motor, column in enumerate(self.estimator.jacobian.T):
            if column.any():
                moved = (column * self.test_words[motor]).reshape(POINTS, 2)
                self._adapt(motor, self.test_words[motor], float(lengths_px(moved).max()))

    def _adapt(self, motor: int, word: float, pixels: float) -> None:
        """Sizes the next test word of a motor by how far one of this size moved the images."""
        wanted = max(self._test_px, self.NOISES * self.filter.noise.px)
        size = word * np.clip(wanted / max(pixels, self.LEAST_PX), 1 / self.MOST_GROWTH, self.MOST_GROWTH)
        size = np.sign(size) * max(abs(size), self.SMALLEST_TEST)
        self.test_words[motor] = np.clip(size, -self.LARGEST_TEST, self.LARGEST_TEST)


def half_way_back(before: Observation, now: Observation) -> Array:
    """Control words (m,) half of the way back to where a motion began that lost a point from view."""
    return (before.registers - now.registers) / 2


def jump(registers: Array, home: Observation, findings: Findings[Any]) -> Observing:
    """Moves at once to registers (m,) that are recalled; back where that loses a point from view."""
    after = yield registers - home.registers
    after = yield from findings.filter.settle(after, home, after.points, np.zeros(POINTS))
    findings.trusted.append(after)
    return after if after.visible.all() else (yield from back(home, after, findings))


def back(before: Observation, now: Observation, findings: Findings[Any]) -> Observing:
    """Returns to where a motion began that lost a point from view: there all is seen as before."""
    after = yield before.registers - now.registers
    after = yield from findings.filter.settle(after, now, before.points, np.zeros(POINTS))
    findings.trusted.append(after)
    return after


HARDLY_NEARER = 0.7
"""A motion came hardly nearer that left more than this share of the distance. Choice."""


def solve_distance(trial: ServoTrial, redundancy: str, damping: float) -> Array:
    """Control words c (m,) that solve -d = J c between the motors' stops (equation 1 of the paper).

    Args:
        trial: Knows d and J.
        redundancy: What is done with four equations for three words, of `REDUNDANCIES`.
        damping: See `redundancy.solve`.
    """
    equations = REDUNDANCIES[redundancy](trial.jacobian, trial.now.distance, trial.estimator.noise_px)
    return solve_within(*equations, damping, *trial.word_bounds)


class Steps:
    """The steps of one trial.

    Args:
        trial: The trial.
        step_px: No step is predicted to move a point further than this in an image.
        step_word: No word of a step is larger.
        border: Steps are predicted to keep every point within this part of the images.
        doubting: Where steps come hardly nearer, points may be noisy and gears may have play: then it looks
            again, and goes beyond and back.
    """

    SHORTER, LONGER = 0.4, 1.5
    """Steps get shorter by this where one lost a point from view, and longer again with each that did not:
    tuned on wild worlds 3000 and up."""
    UNFINISHED = 0.1
    """A motor has not finished its word of which more than this share is left. Choice."""
    LOOKS = 6
    """So often it looks again. Choice: about as many motions as a step and its test motions take."""
    LEAST_SHARE = 0.1
    """A step that leads out of the images keeps this share at least: else nothing would move (a guard)."""

    def __init__(
        self, trial: ServoTrial, step_px: float, step_word: float, border: float, doubting: bool = False
    ) -> None:
        self.trial = trial
        self.confidence = 1.0
        self._hardly_nearer = False
        self._last_px = np.inf
        self._step_px = step_px
        self._step_word = step_word
        self._border = border * trial.findings.edges
        self._doubting = doubting

    def make(self, words: Array) -> Motions:
        """Executes words (m,) as far as they may go; where a point got lost, goes back, and then shorter.

        After a step that came hardly nearer it may go a test word beyond, and back: small words may do
        nothing, and gears have play.
        """
        before = self.trial.now
        words = self.confidence * self.bounded(words)
        self.trial.findings.note_words(words, self.trial.now, self.trial.stops)
        goal = self.trial.now.registers + words
        if self._doubting and self._hardly_nearer:
            yield from self._go(goal + np.copysign(self.trial.test_words, words))
        if not self.trial.filter.lost.any():
            yield from self._go(goal)
            if self.trial.now is before:  # no motor goes further
                yield from self.trial.move(np.zeros_like(words))
        yield from self._look()
        self._last_px = self.trial.now.distance_px
        self._hardly_nearer = self.trial.now.distance_px > HARDLY_NEARER * before.distance_px
        if not self.trial.filter.lost.any():
            self.confidence = min(1.0, self.LONGER * self.confidence)
        else:
            self.confidence *= self.SHORTER
            yield from self.trial.go_back()

    def _look(self) -> Motions:
        """Looks again where all that is left of the distance may be noise.

        It may be where a step ends hardly nearer than the one before and nobody knows how noisy points are.
        """
        noise = self.trial.filter.noise
        stalled = self._doubting and self.trial.now.distance_px > HARDLY_NEARER * self._last_px
        for _ in range(self.LOOKS):
            unknown = stalled and not noise.measured
            if not unknown and self.trial.now.distance_px > Gating.AGREE * noise.px:
                break
            yield from self.trial.move(np.zeros_like(self.trial.test_words))

    def _go(self, goal: Array) -> Motions:
        """Moves until motors stand at registers (m,), or no farther: a motion may have a greatest length."""
        words = goal - self.trial.now.registers
        left, going = np.ones_like(words), words != 0
        while going.any() and not self.trial.filter.lost.any():
            before = left
            yield from self.trial.move(np.where(going, goal - self.trial.now.registers, 0.0))
            left = (goal - self.trial.now.registers) / np.where(going, words, 1.0)
            going &= (left > self.UNFINISHED) & (left < before)

    def bounded(self, words: Array) -> Array:
        """The same direction (m,), as far as the predicted image motion allows."""
        moved = self.trial.estimator.predict(words)
        reach = min(self._step_px, self.trial.estimator.reach_px)
        shares = [
            1.0,
            reach / max(float(lengths_px(moved).max()), 1e-9),
            self._step_word / max(np.abs(words).max(), 1e-9),
        ]
        points = self.trial.now.points
        leaving = np.abs(points + moved) > np.maximum(self._border, np.abs(points))
        if leaving.any():
            room = np.maximum(self._border - np.sign(moved) * points, 0.0)[leaving]
            shares.append(max(self.LEAST_SHARE, float((room / np.abs(moved[leaving])).min())))
        return words * min(shares)
