"""A leash around where a robot has been: as long as the images have shown that it knows itself."""

from collections.abc import Generator
from dataclasses import replace

import numpy as np

from calfree_gym.image import IMAGE_UNIT, RANK, RANK_OF_SQUARES, lengths_px

from ...base.observation import POINTS, Array, Observation
from ...base.procedure import Procedure
from ...base.registers import Stops, met_something
from ..jacobian import distance_jacobian
from ..perception import ObservationFilter


class LinearView:
    """The Jacobian by all looks so far, by least squares; of motors that never moved its columns are zero.

    Attributes:
        jacobian: Gripper and object points by words (8, m), in image units.
        variances: Covariances of a row of it (m, m).

    Args:
        motors: m.
    """

    def __init__(self, motors: int) -> None:
        self.jacobian = np.zeros((2 * POINTS, motors))
        self.variances = np.zeros((motors, motors))
        self._looks: list[Observation] = []

    def look(self, observation: Observation, noise_px: float) -> None:
        """Takes in a look; points that it does not show are not counted."""
        self._looks.append(observation)
        registers = np.array([each.registers for each in self._looks])
        moved = np.flatnonzero(np.ptp(registers, axis=0))
        if not len(moved):
            return
        equations = np.column_stack([np.ones(len(registers)), registers[:, moved]])
        for point in range(POINTS):
            seen = np.array([each.visible[point] for each in self._looks])
            if seen.sum() > 1:
                points = np.array([each.points[point] for each in self._looks])[seen]
                found = np.linalg.lstsq(equations[seen], points, rcond=RANK)[0]
                self.jacobian[2 * point : 2 * point + 2, moved] = found[1:].T
        inverse = np.linalg.pinv(equations.T @ equations, hermitian=True, rcond=RANK_OF_SQUARES)
        self.variances[np.ix_(moved, moved)] = (noise_px * IMAGE_UNIT) ** 2 * inverse[1:, 1:]

    def correct(self, words: Array, before: Observation, after: Observation, noise_px: float) -> None:
        """Changes the Jacobian by the least that explains a motion of words (m,), motors alike (Broyden).

        The less the motion should show above noise, the less it changes: as a Kalman filter does for which
        each column is unsure by its own length.
        """
        scaled = words * np.square(self.jacobian).sum(0)
        of_noise = 2 * len(self.jacobian) * (noise_px * IMAGE_UNIT) ** 2
        seen = np.repeat(before.visible & after.visible, 2)
        moved = (after.points - before.points).reshape(-1)
        error = np.where(seen, moved - self.jacobian @ words, 0.0)
        self.jacobian = self.jacobian + np.outer(error, scaled) / (scaled @ words + of_noise)

    def moved_px(self, words: Array) -> float:
        """How far words (m,) should move the image point that goes farthest, in pixels."""
        return float(lengths_px((self.jacobian @ words).reshape(POINTS, 2)).max())

    def each_px(self, words: Array) -> float:
        """How far one motor by its word alone should move an image point at most, in pixels."""
        alone = (self.jacobian * words).reshape(POINTS, 2, -1).swapaxes(1, 2)
        return float(lengths_px(alone).max())

    def error_px(self, words: Array, before: Observation, after: Observation) -> float:
        """By how much words (m,) moved an image point otherwise than they should have, at most, in pixels."""
        otherwise = after.points - before.points - (self.jacobian @ words).reshape(POINTS, 2)
        seen = before.visible & after.visible
        return float(lengths_px(otherwise)[seen].max(initial=0.0))


SPAN_PX = 600.0
"""How far a servo's word of 1 moves the images. Choice: about what a word of the built robot's motors does,
so that servos find motors as they know them, however weak or strong each is."""


def equal_units(jacobian: Array) -> Array:
    """Words (m,), each moving the images by `SPAN_PX`, at most 1; of motors that move none, the usual one."""
    moved = lengths_px(jacobian.reshape(POINTS, 2, -1).swapaxes(1, 2)).max(0)
    units = np.minimum(SPAN_PX / np.maximum(moved, 1.0), 1.0)
    return np.where(moved > 0, units, np.median(units[moved > 0]))


def in_units(observation: Observation, units: Array) -> Observation:
    """An observation with its registers in these units (m,)."""
    return replace(observation, registers=observation.registers / units)


class Leash:
    """Lets through as much of a servo's words as stays near registers where the robot has been.

    It is as long as the images may move by one motion, as expected, and by each motor's word alone: what
    motors do to images may cancel, what they do to the arm does not. It grows where they did as expected,
    and shrinks where not, or where a point was lost or the arm met something. Near the object, where there
    may be less room than on the way, motions are short, and so they are slow. It does not hold back what
    leads to where the last motion began.

    Attributes:
        length_px: How far a motion may move the images, far from the object.
        now: The last look.
        contacts: How often the arm has met something.
        stops: Where motors are known to stop.

    Args:
        now: The last look.
        view: What is known of the Jacobian.
        tested: How far each motor (m,) has been; grows.
        filter_: What is known of observations.
        units: What the servo takes for a word of 1, of each motor (m,).
    """

    FIRST_PX = 32.0
    """At first. Choice: a little more than first motions did, and 2 cm at the gripper."""
    OF_DISTANCE, NEAR_PX = 0.5, 12.0
    """No motion is longer than this share of the image distance, or where that is shorter, than this. Choice:
    on worlds 1000 to 1299, of the pairs (0.35, 8), (0.5, 12) and none, this was safest."""
    LEAST_PX = 2.0
    """At least. Choice: with 9, as noise still lets it judge, more trials end at the object, but a UR5e was
    harmed in 2 of 60 worlds."""
    MOST_PX = 40.0
    """At most. Choice: of 24 to 64, on worlds 1000 to 1299 nothing is better."""
    GROWTH = 2.0
    """By this factor it grows, and shrinks. Choice: as first motions do."""
    AS_EXPECTED = 0.35
    """The images did as expected where they are off by no more than this share of the motion. Choice."""
    NOISES = 6.0
    """Or by no more than so many standard deviations of their noise. Derived: 4 √2, and a margin."""
    FARTHER = 4.0
    """No motor goes farther than this times where it has been, whatever the images are expected to do.
    Choice: a motor whose motions are not seen may not run away."""
    MOST_SHARE = 0.9
    """Words that are shortened are shortened at least to this share. Choice: so servos tell it from a motor's
    stop."""
    DONE = 0.1
    """A word is executed of which no more than this share is left. Choice: motors may fall short of words."""
    PARTS = 8
    """In so many motions at most a single motor's words are executed (a guard)."""
    MOST_CONTACTS = 6
    """The robot gives up where it has met something so often. Choice."""

    def __init__(
        self,
        now: Observation,
        view: LinearView,
        tested: Array,
        filter_: ObservationFilter,
        units: Array,
    ) -> None:
        self._units = units
        self.now, self.length_px = now, self.FIRST_PX
        self._came_from = now.registers
        self.contacts, self.stops = 0, Stops(now.registers)
        self._view, self._tested, self._filter = view, tested, filter_

    def allowed(self, words: Array, registers: Array) -> Array:
        """As much of words (m,), from registers (m,) on, as the leash lets through, in the same direction."""
        if np.abs(registers + words - self._came_from).max() < NEITHER:
            return words
        share = 1.0 / max(1.0, float(np.abs(words).max()))
        far = max(self._view.moved_px(words), self._view.each_px(words))
        length_px = min(self.length_px, max(self.OF_DISTANCE * self.now.distance_px, self.NEAR_PX))
        if far > length_px:
            share = min(share, length_px / far)
        beyond = np.abs(registers + words) > self.FARTHER * self._tested
        for motor in np.flatnonzero(beyond & (words != 0)):
            room = self.FARTHER * self._tested[motor] - np.sign(words[motor]) * registers[motor]
            share = min(share, max(float(room / abs(words[motor])), 0.0))
        return words if share == 1 else min(share, self.MOST_SHARE) * words

    def learn(self, words: Array, before: Observation, after: Observation) -> bool:
        """Takes in what words (m,) did; whether all went as expected."""
        executed = after.registers - before.registers
        met = self.stops.learn(words, words - executed, after.registers)
        self.contacts += met
        expected_px = self._view.moved_px(executed)
        off_px = self._view.error_px(executed, before, after)
        lost = bool((before.visible & ~after.visible).any())
        most = max(self.NOISES * self._filter.noise.px, self.AS_EXPECTED * expected_px)
        well = off_px <= most and not lost and not met
        if not well:
            self.length_px = max(self.length_px / self.GROWTH, self.LEAST_PX)
        elif expected_px > self.length_px / self.GROWTH:
            self.length_px = min(self.length_px * self.GROWTH, self.MOST_PX)
        self._view.correct(executed, before, after, self._filter.noise.px)
        self.now, self._came_from = after, before.registers
        np.maximum(self._tested, np.abs(after.registers), out=self._tested)
        return well

    def hold(self, servo: Procedure, whole: bool = True) -> Generator[Array, Observation, str]:
        """Lets a servo go on from here until it ends; why it was given up, or nothing.

        A servo that moves several motors goes on from where the leash has stopped it. Words of a single
        motor, and those that lead a motor to its stop, are executed in parts: a servo would take any motor
        whose words were cut short by itself for one at its stop.

        Args:
            servo: In units.
            whole: Whether those are executed in parts; else the servo goes on after each motion.
        """
        words = next(servo, None)
        while words is not None:
            words = words * self._units
            there = self.now.registers + words
            target = np.clip(there, self.stops.lowest, self.stops.highest)
            left = target - self.now.registers
            in_parts = whole and (np.count_nonzero(words) == 1 or bool((target != there).any()))
            stood = np.zeros(len(words), bool)
            for _ in range(self.PARTS):
                before = self.now
                part = self.allowed(left, before.registers)
                now = yield part
                self.learn(part, before, now)
                if self.contacts >= self.MOST_CONTACTS:
                    return f"the arm met something {self.contacts} times on its way"
                short = part - (now.registers - before.registers)
                if met_something(part, short):
                    break
                stood |= (part != 0) & (short == part)
                in_parts |= whole and bool(stood.any())
                left = np.where(stood, 0.0, target - now.registers)
                done = not in_parts or bool((np.abs(left) <= self.DONE * np.abs(words)).all())
                if now.last or done or (before.visible & ~now.visible).any():
                    break
            try:
                words = servo.send(in_units(self.now, self._units))
            except StopIteration:
                words = None
        return ""


NEITHER = 1e-4
"""A word, or a part of one, that is no motion (a guard above rounding)."""


class StraightWay:
    """Goes to the object straight in registers, look by look, until it is near or comes no nearer.

    Images show some ways of the gripper ten times less than others, such as away from the cameras. A servo
    that is cautious by how far images may curve on its whole way puts those off: it goes where images change
    most, and beside the straight way. Motions on a leash are too short for such curves to matter, so here
    only the noise of the measured Jacobian counts: a motion goes where the square of the image distance is
    then expected to be least.

    Where the arm meets something, it goes back to where it came from, and from then on nowhere in that
    direction: it slides along what it has met, as far as the direction tells how that lies.

    Words and registers are in units.

    Args:
        view: What is known of the Jacobian; others correct it.
        leash: The leash that it is on.
        units: Words of 1, of each motor (m,), see `Leash`.
    """

    NEAR_PX = 8.0
    """Nearer than this the servo goes on. Choice: twice the usual tolerance of a rendezvous."""
    NEARER = 0.2
    """A motion came nearer that brought this share of what was expected of it. Choice."""
    FAILURES = 2
    """So many motions may lose a point, or come no nearer, before the servo goes on. Choice."""
    MOTIONS = 20
    """At most (a guard)."""

    def __init__(self, view: LinearView, leash: Leash, units: Array) -> None:
        self._view, self._leash, self._units = view, leash, units
        self._met: list[Array] = []

    def go(self, now: Observation) -> Procedure:
        """Goes from `now` on; back, where a point is lost.

        Also where it met something: to the last place on its way; if it meets something from there too, to
        the place before that.
        """
        seen_at, failures, trail = now.registers, 0, [now.registers]
        for _ in range(self.MOTIONS):
            words = seen_at - now.registers
            if now.visible.all():
                if now.distance_px < self.NEAR_PX or failures >= self.FAILURES:
                    break
                words, seen_at = self.words(now), now.registers
            if now.last or np.abs(words).max() < NEITHER:
                break
            before, jacobian = now, distance_jacobian(self._view.jacobian) * self._units
            contacts = self._leash.contacts
            now = yield words
            executed = now.registers - before.registers
            if self._leash.contacts > contacts and not now.last:
                self._met.append(words / np.linalg.norm(words))
                now = yield trail[-1] - now.registers
                trail = trail[:-1] or trail
                continue
            trail.append(now.registers)
            if before.visible.all():
                far, left = np.linalg.norm(before.distance), np.linalg.norm(now.distance)
                expected = far - np.linalg.norm(before.distance + jacobian @ executed)
                failures += not now.visible.all() or bool(far - left < self.NEARER * expected)

    def words(self, now: Observation) -> Array:
        """All of the way (m,), by words that press against no stop and in no direction that met something."""
        units, motors = self._units, len(self._units)
        jacobian = distance_jacobian(self._view.jacobian) * units
        unsure = 2 * len(now.distance) * self._view.variances * np.outer(units, units)
        square, slope = jacobian.T @ jacobian + unsure, jacobian.T @ now.distance
        stops = self._leash.stops.of(units)
        unit = np.eye(motors)
        at_stops = [*unit[now.registers >= stops.highest], *-unit[now.registers <= stops.lowest]]
        closed = np.array([*self._met, *at_stops]).reshape(-1, motors)
        pressed = np.zeros(len(closed), bool)
        while True:
            free = unit - np.linalg.pinv(closed[pressed], rcond=RANK) @ closed[pressed]
            inverse = np.linalg.pinv(free @ square @ free, hermitian=True, rcond=RANK_OF_SQUARES)
            words = -free @ inverse @ free @ slope
            presses = closed @ words > NEITHER
            if not (presses & ~pressed).any():
                return np.clip(now.registers + words, stops.lowest, stops.highest) - now.registers
            pressed |= presses
