"""The second implementation without test motions: what was seen in all motions tells the next one.

"It should be possible to have the robot learn the relationships ... by having it observe its own motions
during its ordinary operation" (section 2.3): the paper has not tested it.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from calfree_gym.image import IMAGE_UNIT, inner, lengths_px, rounded

from ..base.checks import check_number
from ..base.observation import POINTS, Array, Observation
from ..base.prior_knowledge import PriorKnowledge
from ..base.procedure import Procedure
from ..base.registers import Stops
from .image_model.least_distance import LEFT, Seeker
from .image_model.smooth_points import GRIPPER, SmoothPoints
from .jacobian import Estimator, TestMotions
from .paper import PaperServo
from .perception import Gating
from .servo_agent import SERVO_KNOWLEDGE, SMALLEST, servo
from .slopes import Slopes
from .trial import HARDLY_NEARER, Findings, Motions, Steps


@servo("unified_servo", "Makes no test motions: learns a smooth model of the images as it goes.")
@dataclass(frozen=True)
class UnifiedServo:
    """Goes where the image distance is expected to be least; where that is far off, it tries something new.

    Image points are smooth functions of the registers (`SmoothPoints`), and every look tells more of them. A
    motion is a step and a probe. The step goes to where the square of the image distance is expected to be
    least, and among equals to the nearest. Where it would leave too much of the distance, a probe is added:
    it moves the motors in a way of which least is known, several at once.

    So it does not matter how many motors there are, or whether some move nothing in the images. What a trial
    leaves to the next one are `Slopes`: the Jacobian where trials begin, and along which motors points are
    smooth over many registers. It remembers no place.

    Attributes:
        probe_px: How far a probe is to move the points in the images. Choice: as far as test motions of other
            servos.
        caution: How much the variance of the image distance counts, beside the square of its mean, in a trial
            that begins without looks of earlier ones. Choice: less than one, for what is unknown is learned
            on the way.
        border: Motions are expected to keep every point within this part of the images. Choice: as in other
            servos.
        sure_px: No motion leads where the gripper is less surely expected (standard deviation): for those who
            must not touch what they come near to.
    """

    probe_px: float = 16.0
    caution: float = 0.1
    border: float = 0.95
    sure_px: float = math.inf

    prior_knowledge = SERVO_KNOWLEDGE - {PriorKnowledge.WORD_LIMIT}

    PATIENCE: ClassVar[int] = 4
    """After so many motions in vain (`Reach.in_vain`) it leaves out what is remembered of earlier trials.
    Choice: two that were to come near."""
    BEGINNINGS: ClassVar[int] = 2
    """After as many motions in vain as so many beginnings take (test motions of all motors, and a step) it no
    longer trusts what has led it: after 8 with three motors, 16 with seven. Choice."""

    def __post_init__(self) -> None:
        for name in ("probe_px", "border"):
            check_number(name, getattr(self, name), least=SMALLEST)
        check_number("caution", self.caution, least=0)
        check_number("sure_px", self.sure_px, least=SMALLEST, finite=False)

    def new_estimator(self, motors: int, start: Slopes | None) -> SmoothPoints:
        return SmoothPoints(motors, start)

    def __call__(self, first: Observation, findings: Findings[SmoothPoints]) -> Procedure:
        """Seeks the rendezvous from the first observation on, until the trial ends."""
        reach = Reach(self, first, findings)
        yield from reach.begin()
        most_in_vain = self.BEGINNINGS * (len(first.registers) + 1)
        while not reach.now.last and reach.in_vain < most_in_vain:
            if reach.points.remembers and reach.in_vain >= self.PATIENCE:
                reach.forget_earlier_trials()
            yield from reach.move(reach.words())
            while reach.filter.needs_samples:
                yield from reach.move(np.zeros_like(first.registers))
        if not reach.now.last:
            yield from reach.forget_and_go_on()


class Reach:
    """One trial of the unified servo.

    Attributes:
        now: What is estimated after the last motion.
        points: What is known of the image points.
        filter: What is known of observations.
        stops: Where motors are known to stop.
        in_vain: How many motions came hardly nearer than one before, those that were to come near counting
            twice and probes less.

    Args:
        servo: Its settings.
        first: The first observation.
        findings: What to begin with.
    """

    NOISES = 8.0
    """A probe is to move the images by this many times the noise at least. Derived: then a slope is known to
    a sixth (√2 / 8)."""
    AS_UNKNOWN = 0.7
    """Directions whose variance is this share of the largest are as unknown. Choice."""
    HALVINGS = 5
    """How often a word is halved (a guard)."""
    SPACE = 3
    """Motors that it takes to bring the gripper anywhere; more may leave it there. Derived: space has so many
    dimensions."""
    ASIDE, OTHERS = 0.5, 100
    """Other ways to be there are at most so far aside (standard deviation, in registers); so many are tried.
    Choice."""
    SURELY = 0.5
    """They must have this share of the best one's margin (see `_in_view`), or more where motions have become
    shorter. Choice: with less, fewer reach where nearly all ways hide a point."""

    def __init__(self, servo: UnifiedServo, first: Observation, findings: Findings[SmoothPoints]) -> None:
        self.now = first
        self.points = findings.estimator
        self.filter = findings.filter
        self.stops = findings.stops or Stops(first.registers)
        self._servo = servo
        self._caution = 1.0 if self.points.remembers else servo.caution
        self._findings = findings
        self._trusted = findings.trusted
        self._seen = first.visible
        self._all_seen_at = [first.registers]
        self._returning = False
        self._share = 1.0
        self.in_vain = 0.0
        self._nearest_px = np.inf
        self._random = np.random.default_rng(0)

    @property
    def _noise(self) -> float:
        """Standard deviation of an image coordinate, in image units."""
        return self.filter.noise.px * IMAGE_UNIT

    def begin(self) -> Motions:
        """Observes until all points were seen."""
        self.now = yield from self.filter.first(self.now)
        self._seen = self.now.visible
        self.points.look(self.now, self.filter.noise.px)

    def move(self, words: Array) -> Motions:
        """Executes words (m,), and learns from what is then seen."""
        before, words = self.now, np.clip(words, -1.0, 1.0)
        observation = yield words
        self.stops.learn(words, words - (observation.registers - before.registers), observation.registers)
        expected = self.points.at(observation.registers).points
        left_px = float(lengths_px(expected[:2] - expected[2:]).max())
        deviations_px = np.sqrt(self.points.unsure(observation.registers)) / IMAGE_UNIT
        self.now = yield from self.filter.settle(observation, before, expected, deviations_px)
        self._trusted.append(self.now)
        if self.filter.inconsistent.any():
            if self.filter.inconsistent[GRIPPER].any() and not self._findings.jumped:
                self._findings.jumped = len(self._trusted) - 1
            self.points.look_anew(self.now, self.filter.noise.px)
            self._nearest_px = np.inf
        else:
            self.points.look(self.now, self.filter.noise.px)
        if self.filter.often_mistaken:
            self.points.leave_out_mistaken()
        self._note_seen()
        moved = (observation.registers != before.registers).any()
        led = self.points.remembers or not self._returning
        if observation.visible.all() and moved and led:
            self._judge(left_px)

    def forget_earlier_trials(self) -> None:
        """Goes by the looks of this trial alone, as if no place had been remembered."""
        self.points.forget_earlier_trials()
        self._caution = self._servo.caution
        self._findings.given_up = True

    def forget_and_go_on(self) -> Motions:
        """Goes on as the paper's servo, which forgets; what was seen before counts no more.

        For where points are no smooth functions of registers, as where small words do nothing.
        """
        self._findings.try_again(self.stops)
        estimator: Estimator = TestMotions(len(self.now.registers))
        edges = self._findings.edges
        findings = Findings(estimator, self.filter, self._trusted, self.stops, edges=edges)
        self._findings.given_up = True
        yield from PaperServo()(self.now, findings)

    def _judge(self, expected_px: float) -> None:
        """Counts motions that came hardly nearer than one before.

        Those that were to come near count twice; probes, which were not to come nearer, as one test motion
        does among those of all motors. Where places are remembered, which spare a trial its probes, as many
        as a beginning takes (test motions of all motors, and a step) count `PATIENCE`.
        """
        there_px = Gating.AGREE * np.sqrt(2) * self.filter.noise.px
        if self.now.distance_px < max(HARDLY_NEARER * self._nearest_px, there_px):
            self.in_vain, self._nearest_px = 0.0, max(self.now.distance_px, there_px)
        elif expected_px < HARDLY_NEARER * self._nearest_px:
            self.in_vain += 2 if expected_px < LEFT * self._nearest_px else 1
        else:
            motors = len(self.now.registers)
            remembers = self.points.remembers
            self.in_vain += self._servo.PATIENCE / (motors + 1) if remembers else 1 / motors

    def _note_seen(self) -> None:
        """Remembers where all points were seen that ever were in this trial."""
        visible = self.now.visible
        if (visible & ~self._seen).any():
            self._seen = self._seen | visible
            self._all_seen_at = []
        if visible[self._seen].all() or not self._all_seen_at:
            self._all_seen_at.append(self.now.registers)

    @property
    def _blind(self) -> bool:
        """Whether a point is hidden that was seen before, and is expected too unsurely to go on by that."""
        lost = self.filter.lost
        if not lost.any():
            return False
        here = self.points.at(self.now.registers)
        unsure = POINTS * float(here.variances[lost].max())
        return bool(unsure > LEFT**2 * here.distance @ here.distance)

    def _back(self) -> tuple[Array, bool]:
        """Words (m,) to where all points were seen last, and whether a probe is added to them.

        Where points stay hidden the probe gets shorter, and is at last left out. Where they are hidden even
        then, the next words lead to where all were seen before.
        """
        share = self._share if self._returning else 1.0
        probing = share > Steps.LEAST_SHARE
        self._share = max(Steps.SHORTER * share, Steps.LEAST_SHARE)
        words = self._all_seen_at[-1] - self.now.registers
        if not probing and len(self._all_seen_at) > 1:
            self._all_seen_at.pop()  # it is noted again where all are seen
        return words, probing or not words.any()

    def _in_view(self, registers: Array) -> Array:
        """These registers (m,); where they may hide a point, others that leave the distance as it is.

        They may, where they are nearer to where a point was hidden in this trial than to where all were seen.
        Of others that are far from the former and near the latter (the margin), those are taken where least
        of the distance is expected. No more motors than it takes leave no other ones.
        """
        shown = np.array([look.visible.all() for look in self._trusted])
        if len(registers) <= self.SPACE or shown.all() or not shown.any():
            return registers
        ways = np.linalg.svd(self.points.at(registers).distance_jacobian)[2][self.SPACE :]
        aside = self._random.normal(size=(self.OTHERS, len(registers))) @ ways.T @ ways
        aside *= self._random.uniform(0, self.ASIDE, (self.OTHERS, 1))
        places = np.clip(np.vstack([registers, registers + aside]), self.stops.lowest, self.stops.highest)
        been = np.array([look.registers for look in self._trusted])
        far = np.linalg.norm(places[:, None] - been, axis=2)
        margins = rounded(far[:, ~shown].min(1) - far[:, shown].min(1))
        if margins[0] >= 0:
            return registers
        apart = self.points.at(places).apart
        squares = np.square(apart.points).sum((1, 2)) + 2 * apart.variances.sum(1)
        least = max(1 - self._share, self.SURELY) * margins.max()
        surely = margins >= min(least, margins.max())
        return np.asarray(places[np.where(surely, rounded(squares), np.inf).argmin()])

    def words(self) -> Array:
        """The next words (m,): a step, and a probe where the step would leave too much of the distance.

        Both are shorter after a motion that hid a point.
        """
        here, stops = self.now.registers, self.stops
        found = Seeker(self.points, here, stops.lowest, stops.highest, self._caution).seek()
        blind = self._blind
        if blind:
            words, probing = self._back()
        else:
            self._share = min(1.0, Steps.LONGER * self._share)
            words, probing = self._share * (self._in_view(found.registers) - here), found.far
        self._returning = blind
        if probing:
            words = self._with_probe(words, found.length)
        self._findings.note_words(words, self.now, stops)
        return self._within_images(self._sure(words / max(1.0, float(np.abs(words).max()))))

    def _sure(self, words: Array) -> Array:
        """Words (m,), shorter where the gripper would be too unsurely expected."""
        if math.isinf(self._servo.sure_px):
            return words
        most = (self._servo.sure_px * IMAGE_UNIT) ** 2
        for _ in range(self.HALVINGS):
            if self.points.gripper.unsure(self.now.registers + words).max() <= most:
                break
            words = words / 2
        return words

    def _with_probe(self, words: Array, left: float) -> Array:
        """A step (m,), and a probe in a way of which least is known.

        A probe is no longer in the images than the distance that is left, and the step is so short that its
        own errors do not hide what the probe does.
        """
        here = self.points.at(self.now.registers)
        size = max(min(self._share * self._servo.probe_px * IMAGE_UNIT, left), self.NOISES * self._noise)
        unknown = here.slope_variances.mean(0)
        variances, ways = np.linalg.eigh(unknown)
        ways = ways[:, variances > self.AS_UNKNOWN * variances[-1]]
        probe = ways @ (ways.T @ self._random.normal(size=len(unknown)))
        moved = here.jacobian @ probe
        shown = np.sqrt(2 * probe @ unknown @ probe + moved @ moved / POINTS)
        probe *= size / max(float(shown), size)
        if inner(here.distance @ here.distance_jacobian, probe) > 0:
            probe = -probe
        for _ in range(self.HALVINGS):
            if 2 * self.points.at(self.now.registers + words).variances.mean() < size**2:
                break
            words = words / 2
        there = self.now.registers + words
        lowest, highest = self.stops.lowest, self.stops.highest
        beyond = (there + probe < lowest) | (there + probe > highest)
        if beyond.any() and inner(probe, words) <= 0:  # else it would undo the step
            probe = -probe
        return np.clip(there + probe, lowest, highest) - self.now.registers

    def _within_images(self, words: Array) -> Array:
        """Words (m,), shorter where they are expected to lead points out of the images."""
        farthest = np.abs(self.now.points).reshape(2, 2, 2).max(0)  # of gripper and object, in each image
        limits = np.maximum(self._servo.border * self._findings.edges, np.tile(farthest, (2, 1)))
        for _ in range(self.HALVINGS):
            if (np.abs(self.points.at(self.now.registers + words).points) <= limits).all():
                break
            words = words / 2
        return words
