"""One trial of grasping: what is known in it, and the motions that the procedure is made of."""

from collections.abc import Generator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from calfree_gym.image import IMAGE_UNIT, lengths_px

from ..base.observation import Array, Observation
from ..base.registers import Stops, met_something
from ..servo.image_model.gaussian_process import GaussianProcess
from ..servo.image_model.least_distance import Seeker
from ..servo.image_model.smooth_points import SmoothPoints
from ..servo.servo_agent import ServoAgent
from .observation import ARM, OBJECT, TIP, GraspObservation
from .seen import MOVED_PX, Lying, Target, Tip, known_before, target
from .turning import Turning, turn_needed


@dataclass
class GraspFindings:
    """What is found out in a trial.

    Attributes:
        reach: What the servo of the approach finds out.
        turning: By what angle the jaws must turn, and what turns them.
        descent: Tip and object over registers, with all that is remembered of other trials; None where that
            is nothing.
        looks: All that was seen on the way to the intermediate position, as its target.
        untouched: All that was seen before the object may have moved, as who goes to it sees it.
        approached: Whether the gripper came to the intermediate position.
        key: The object's sensor vector and the `direction_key`, as seen from home (6,).
        above: Registers (k + 1,) of arm and turn from which the gripper descended, its jaws as they closed.
    """

    reach: Any
    turning: Turning
    descent: SmoothPoints | None = None
    looks: list[Observation] = field(default_factory=list)
    untouched: list[Observation] = field(default_factory=list)
    approached: bool = False
    key: Array | None = None
    above: Array | None = None

    @property
    def noise_px(self) -> float:
        """Standard deviation of an image coordinate."""
        return float(self.reach.filter.noise.px)


LOST = 2
"""A tip that was not seen in so many looks is out of view. Choice: in one it may be hidden."""


class InView:
    """What is known of where the tip is in view.

    Attributes:
        registers: Where (5,) it was seen last.
        shorter: Share of which words are sent: less where it got lost.

    Args:
        first: The first observation.
    """

    def __init__(self, first: GraspObservation) -> None:
        self.registers, self.shorter = first.registers, 1.0
        self._unseen = 0

    def look(self, now: GraspObservation, was_seen: bool) -> None:
        """Takes in a look; where the tip gets lost, the next words are half as long."""
        self._unseen += 1
        if now.visible[TIP].all():
            self.registers, self._unseen = now.registers, 0
            self.shorter = min(1.0, 2 * self.shorter) if was_seen else self.shorter
        elif self._unseen == LOST:
            self.shorter /= 2

    @property
    def lost(self) -> bool:
        """Whether the tip is out of view."""
        return self._unseen >= LOST


Motions = Generator[Array, GraspObservation, Any]
"""Yields control words (5,) or (6,), is sent what is observed after them."""

OPEN = 0.95
"""Jaws that are more open than this share have not closed. Choice: things are at most 0.9 as wide."""
SURE_PX, SURE_ABOVE_PX = 6.0, 20.0
"""No motion leads where the tip is less surely expected (standard deviation): as long as the table or the
object may be met, and with the object lifted. Choice: a tenth and a third of the gripper's length."""


class GraspTrial:
    """What is known in a trial, and its motions, of an arm of k motors, one that turns the gripper, and jaws.

    Attributes:
        now: What was seen last.
        touched: Whether the arm met something in the last motion.

    Args:
        reacher: Goes to the intermediate position.
        intermediate: One of `INTERMEDIATE`.
        orientation: One of `ORIENTATION`.
        first: The first observation.
        findings: What to begin with.
    """

    NEAR = 0.25
    """The intermediate position is reached within so many gripper lengths. Choice: what is left is made good
    while the gripper descends."""
    BORDER = 0.95
    """Motions are expected to keep the tip within this part of the images. Choice: as in servos."""
    ARRIVED = 0.01
    """Of a register: nearer it need not come (a guard)."""
    HALVINGS = 5
    """How often a word is halved (a guard)."""
    TEST_TURN = 0.15
    """Of the first turn, whose sign and size are unknown. Choice: it turns by 15 to 60 degrees."""
    TURNED, TOLERATED = np.radians(2.0), np.radians(10.0)
    """The jaws need not turn by less (rad), and need no further motion to turn by less than the second.
    Choice: they grasp at four times that."""
    SHOWN = np.pi / 4
    """By so much (rad) jaws turn that hide what they hold. Choice: they hide it from a quarter of sides."""
    SHOWN_BY = 0.25
    """So much of the way back shows whether the object comes along. Choice: it is seen to move."""
    MET = 3
    """A servo that met something so often, or pushed the object, is misled by that. Choice."""
    GOES_ON = 8
    """So often the gripper is then brought nearer to the intermediate position without it (a guard)."""

    def __init__(
        self,
        reacher: ServoAgent,
        intermediate: str,
        orientation: str,
        first: GraspObservation,
        findings: GraspFindings,
    ) -> None:
        self.now, self._arm = first, first.turning
        self._reacher, self._intermediate, self._orientation = reacher, intermediate, orientation
        self._findings = findings
        self.touched = False
        self._seen, self._lying = [first], Lying(first)
        self._from = first.arm
        self._tip = Tip.of(GaussianProcess.unknown(self._arm, self._arm), self._seen, findings.noise_px)
        self._untouched, self._stops = True, Stops(first.registers[: self._arm + 1])
        self._hangs: Array | None = None
        self._shows = self.TEST_TURN
        self._look_at_angle(np.zeros(self._arm + 1))
        self._in_view = InView(first)
        self._note()

    def move(self, words: Array | None = None, turn: float = 0.0, jaws: float = 0.0) -> Motions:
        """Executes words (k,) of the arm, one of the wrist's turn, and one of the jaws."""
        before = self.now
        self.touched = False
        arm = np.zeros(self._arm) if words is None else words
        now = yield np.concatenate([arm, [turn, jaws]])
        self.now = now = now if self._hangs is None else now.with_hidden_tip(self._hangs)
        self._seen.append(now)
        self._tip = self._tip.with_look(now)
        executed = now.arm - before.arm
        self.touched = met_something(arm, arm - executed)
        if not self.touched:
            words, here = np.append(arm, turn), now.registers[: self._arm + 1]
            self._stops.learn(words, words - here + before.registers[: self._arm + 1], here)
        self._untouched &= not (self.touched or jaws)
        if now.opening > OPEN:
            self._lying.look(now, self._tip.explained[1], self._untouched)
        self._in_view.look(now, bool(before.visible[TIP].all()))
        self._note()
        self._look_at_angle((now.registers - before.registers)[: self._arm + 1])

    def _look_at_angle(self, words: Array) -> None:
        """Takes in by what angle the jaws must turn, after words (k + 1,)."""
        self._findings.turning = self._findings.turning.moved(words)
        angle = turn_needed(self._orientation, self.now)
        if angle is not None and self.now.opening > OPEN:
            self._findings.turning = self._findings.turning.seen(angle)

    def _note(self) -> None:
        """Takes in what is seen of an object that lies still, or has been pushed."""
        findings, points, view = self._findings, self._findings.descent, self._view(0.0)
        if self._untouched:
            findings.untouched.append(view)
        if points is None or self.now.opening < OPEN:
            return
        moved = self.now.at("object") - points.at(view.registers).object.points
        if view.shows_object and lengths_px(moved).max() > MOVED_PX:
            points.object_moved(moved)
        points.look(view, findings.noise_px)

    def approach(self) -> Motions:
        """To the intermediate position by the servo (3.4); on by all looks where it meets things again."""
        findings, home, met, disturbed = self._findings.reach, self._seen[0].arm, 0, False
        procedure = self._reacher.procedure(self._view(1.0), findings)
        words = next(procedure, None)
        while words is not None and not self.now.last:
            tested = self.knows_turns or len(self._seen) > self._arm
            yield from self.move(words, turn=self._turn(words) if tested else 0.0)
            try:
                words = procedure.send(self._view(1.0))
            except StopIteration:
                break
            met += self.touched
            disturbed = met >= self.MET or (self._untouched and bool(self._lying.moved.any()))
            if self.touched:
                yield from self._aside(home)
                procedure = self._reacher.servo(self._view(1.0), findings)
                words = next(procedure, None)
            if tested and (disturbed or self.left(1.0) <= self.NEAR):
                self._findings.approached = not disturbed
                break
        self._findings.looks = [self._view(1.0, each) for each in self._seen]
        known = known_before(self._findings.reach.estimator, self.now.arm)
        self._tip = Tip.of(known, self._seen, self._findings.noise_px)
        for _ in range(self.GOES_ON if disturbed else 0):
            if self.left(1.0) <= self.NEAR:
                break
            words = self._words(self._toward(1.0))
            yield from self.move(words, turn=self._turn(words))
            if self.touched:
                yield from self._aside(home)
        self._from = self.now.arm

    def jump(self, registers: Array) -> Motions:
        """Moves at once to registers (k + 1,) of arm and turn that are recalled."""
        words = registers - self.now.registers[: self._arm + 1]
        yield from self.move(words[:-1], turn=float(words[-1]))

    def _aside(self, home: Array) -> Motions:
        """Half of the way to registers (k,) where nothing is in the way."""
        yield from self.move((home - self.now.arm) / 2)

    def _view(self, share: float, now: GraspObservation | None = None) -> Observation:
        """What a servo sees that goes to where a share of the way is left to the object."""
        now = self.now if now is None else now
        return now.toward(*target(self._intermediate, now, share * self._far))

    @property
    def _far(self) -> float:
        """Where the intermediate position is, in gripper lengths before the object.

        One, of a gripper that stays vertical; one before the nearer end, of one that may meet things end-on.
        """
        axis = None if self._arm == ARM else self.now.in_gripper_lengths(self.now.between("end_2", "end_1"))
        return 1.0 if axis is None else 1.0 + float(min(abs(axis[2]), 2.0)) / 2

    def _turn(self, words: Array) -> float:
        """The word that turns the jaws along the object, while words (k,) move the arm, and thereby the jaws.

        A test word, as long as it is not known what words do (3.5). Back, where the tip got lost.
        """
        if self._in_view.lost:
            return float((self._in_view.registers - self.now.registers)[self._arm])
        turning, left = self._findings.turning, self._findings.turning.moved(np.append(words, 0.0)).angle
        if left is None or abs(left) < self.TURNED:
            return 0.0
        there = self.now.registers[self._arm]
        lowest, highest = self._stops.lowest[-1], self._stops.highest[-1]
        if not turning.known:
            test = self.TEST_TURN if there + self.TEST_TURN < highest else -self.TEST_TURN
            return 0.0 if turning.moved(np.append(words, test)).angle is None else test
        turns = there + (left + np.pi * np.arange(-1, 2)) / turning.rates[-1]
        possible = turns[(turns > lowest) & (turns < highest)]
        if not len(possible):
            possible = turns[1:2]
        word = possible[np.abs(possible - there).round(6).argmin()] - there
        return float(np.clip(word, -turning.longest, turning.longest))

    def toward(self, share: float) -> Motions:
        """To where this share of the way is left to the object, the jaws turning as needed meanwhile."""
        points = self._findings.descent
        if points is None:
            words = self._words(self._toward(share))
        else:
            words = self._words(points)
            words += share * (self._from - self.now.arm - words)
        yield from self.move(words, turn=self._turn(words))

    def turn(self) -> Motions:
        """Turns the jaws along the object, with the arm where it is."""
        yield from self.move(turn=self._turn(np.zeros(self._arm)))

    @property
    def foreseen_px(self) -> float:
        """How surely it is known where the tip meets the object, before it comes near it: a deviation."""
        points = self._findings.descent
        if points is None:
            return np.inf
        there = self.now.arm + self._words(points)
        return float(np.sqrt(points.at(there).variances.max())) / IMAGE_UNIT

    def _toward(self, share: float) -> SmoothPoints:
        """Tip and where it is to be, over registers, by what was seen in this trial."""
        far = self._far
        return self._points(lambda each: target(self._intermediate, each, share * far))

    def left(self, share: float) -> float:
        """How far the tip is from there, as seen, or as expected, in gripper lengths."""
        view = self._view(share)
        seen = view if view.visible.all() else self._toward(share).at(self.now.arm)
        return self.now.length(seen.distance)

    @property
    def turned(self) -> bool:
        """Whether the jaws lie along the object, nearly."""
        angle = self._findings.turning.angle
        return angle is None or abs(angle) < self.TOLERATED

    @property
    def knows_turns(self) -> bool:
        """Whether it is known which way the jaws turn, and how far."""
        return self._findings.turning.known

    def close(self) -> Motions:
        """Closes the jaws; then reads how far they are open, and sees how what they hold hangs."""
        self._findings.above = np.append(self._from, self.now.registers[self._arm])
        yield from self.move(jaws=1.0)
        function, _ = self._tip.explained
        expected = function.at(self.now.arm).points
        tip = np.where(self.now.visible[TIP][:, None], self.now.at("tip"), expected)
        self._hangs = self.now.at("object") - tip

    def open(self) -> Motions:
        """Opens the jaws."""
        self._hangs = None
        yield from self.move(jaws=-1.0)

    def back(self) -> Motions:
        """Back to the intermediate position: so nothing is dragged along the table."""
        yield from self.move(self._from - self.now.arm)

    def lift(self) -> Motions:
        """To where the object is to be lifted, as it is seen to hang between the jaws.

        Where the tip is not seen it goes on by what is expected; not seen again, back to where it was seen,
        and on by half as long words.
        """
        here = self.now.arm
        back = self._in_view.registers[: self._arm] - here
        if self._seems_left:
            words = self.SHOWN_BY * (self._from - here)
        elif self._in_view.lost and np.abs(back).max() > self.ARRIVED:
            words = back
        else:
            words = self._words(self._lifting(), SURE_ABOVE_PX)
        yield from self.move(words, turn=0.0 if self.now.visible[OBJECT].all() else self._showing())

    @property
    def _seems_left(self) -> bool:
        """Whether the object is where it is to be, and was not seen to come along: jaws hid it on the way."""
        there = lengths_px(self.now.at("object") - self.now.goal).max() < MOVED_PX
        return bool(there and self.now.visible[OBJECT].all() and not self.now.held)

    def _showing(self) -> float:
        """The word that turns the jaws, which hide what they hold: on and on, at a stop the other way."""
        if self.knows_turns:
            self._shows = np.copysign(self.SHOWN / self._findings.turning.rates[-1], self._shows)
        there = self.now.registers[self._arm] + self._shows
        if not self._stops.lowest[-1] < there < self._stops.highest[-1]:
            self._shows = -self._shows
        return float(self._shows)

    @property
    def lift_foreseen(self) -> bool:
        """Whether it is known surely enough how the arm gets there in one motion."""
        points, here = self._lifting(), self.now.arm
        words = self._words(points, np.inf)
        return bool(points.gripper.unsure(here + words).max() <= (SURE_PX * IMAGE_UNIT) ** 2)

    def _lifting(self) -> SmoothPoints:
        """Tip and where it is to be, over registers, for the object to be where it is to be lifted."""
        seen = (self.now.visible[OBJECT] & self.now.visible[TIP])[:, None]
        hangs = np.where(
            seen, self.now.at("object") - self.now.at("tip"), 0.0 if self._hangs is None else self._hangs
        )
        way = self.now.goal - hangs
        return self._points(lambda each: (way, np.ones(2, bool)))

    def _words(self, points: SmoothPoints, sure_px: float = SURE_PX) -> Array:
        """Words (k,) to where the tip is expected to be seen at its target, or as far as that is sure.

        They keep the tip in both images. The wrist stays tilted as the approach has left it: what moves less
        is known sooner.
        """
        here = self.now.arm
        lowest, highest = self._stops.lowest[:-1], self._stops.highest[:-1]
        lowest[ARM:] = highest[ARM:] = here[ARM:]
        found = Seeker(points, here, lowest, highest, caution=0.0).seek()
        words = self._in_view.shorter * (found.registers - here)
        words /= max(1.0, float(np.abs(words).max()))
        limits = np.maximum(self.BORDER, np.abs(self.now.at("tip")))
        for _ in range(self.HALVINGS):
            there = here + words
            sure = points.gripper.unsure(there).max() <= (sure_px * IMAGE_UNIT) ** 2
            if sure and (np.abs(points.at(there).gripper.points) <= limits).all():
                break
            words /= 2
        return words

    def _points(self, target_of: Target) -> SmoothPoints:
        """Tip and target over registers, by what was seen in this trial; of the object as it lay."""
        gripper, variance = self._tip.explained
        points = self._lying.points(target_of, variance)
        points.gripper = gripper
        return points
