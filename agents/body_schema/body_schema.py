"""Learns what its body is, over any servo: robotics calls that a body schema (Hoffmann et al. 2010)."""

from collections.abc import Generator, Mapping, Sequence
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import IMAGE_UNIT, rounded

from ..base.observation import POINTS, Array, Observation, RawObservation, camera_lengths_px
from ..base.prior_knowledge import PriorKnowledge
from ..base.procedure import Procedure
from ..base.registers import Stops, at_home
from ..base.registration import agent
from ..memory.pairs import Pairs
from ..servo.servo_agent import Servo, ServoAgent
from ..servo.slopes import Slopes
from ..servo.trial import Findings, back
from .body import Body, BodyEvent
from .chain import Views
from .fitting import Known

NEAREST = 1e-5
"""Weight of a register's square, in square image units (a guard: it decides among equals)."""
SEEN, DRAWN, PLACES = 3, 10, 40
"""It seeks from so many places where the gripper was seen, and drawn ones; each tries so many (guards)."""
NOISES = 4.0
"""What is seen otherwise than expected counts as noise up to so many times that. Choice."""
LONGEST = 0.2
"""Of such a step, in registers: so it finds what is near. Choice."""
NEAR_PX, SURE_PX = 1.0, 4.0
"""It ends at a place that leaves no more than this by what is known, and is so sure. Choice: noise, and a
rendezvous."""
ENOUGH = 0.99
"""And where a step leaves more than this share of the square (a guard)."""
_DAMPING, _LESS, _MORE, _LEAST, _MOST = 1e-3, 0.2, 5.0, 1e-7, 1e3
"""Damping at first, its factors after a step that helps and one that does not, and its ends (guards)."""


class Meeting(NamedTuple):
    """A place where gripper and object are expected to meet.

    Attributes:
        registers: There (m,).
        left_px: How far from each other they are then, root mean square of both images, in pixels.
        deviation_px: Standard deviation of that, what is not known included.
    """

    registers: Array
    left_px: float
    deviation_px: float

    @property
    def near(self) -> bool:
        """Whether it does."""
        return self.left_px < NEAR_PX and self.deviation_px < SURE_PX


class MeetingSeeker:
    """Seeks it by Levenberg-Marquardt between the stops, from several places.

    Args:
        known: What is known of the robot.
        home: The object's sensor vector at home (4,).
        now: What is observed now: it tells by how much what is known is wrong.
        noise_px: Standard deviation of an image coordinate.
        stops: Where motors are known to stop.
    """

    def __init__(self, known: Known, home: Array, now: Observation, noise_px: float, stops: Stops) -> None:
        self._known, self._home, self._now, self._stops = known, home, now.registers, stops
        self._offset = np.zeros(POINTS)
        if now.registers.any():
            offset = now.distance - self._distances(self._views(now.registers[None]))[0]
            if camera_lengths_px(offset).max() > NOISES * noise_px:
                self._offset = offset

    def seek(self) -> Meeting:
        """From here; else from where the gripper was seen near and from drawn places: the first near end."""
        (found,) = self._ends(self._now[None])
        if found.near:
            return found
        lowest, highest = self._stops.lowest, self._stops.highest
        seen = self._known.seen
        near = rounded(np.square(seen.sensors - self._home).sum(1)).argsort(kind="stable")[:SEEN]
        drawn = np.random.default_rng(0).uniform(lowest, highest, (DRAWN, len(lowest)))
        ends = [found, *self._ends(np.concatenate([seen.registers[near], drawn]))]
        return next(
            (each for each in ends if each.near), min(ends, key=lambda each: rounded(each.deviation_px))
        )

    def _views(self, registers: Array) -> Views:
        return self._known.views_at(registers, self._home)

    def _distances(self, views: Views) -> Array:
        """Image distances (k, 4)."""
        return (views.points[:, :2] - views.points[:, 2:]).reshape(-1, POINTS) + self._offset

    def _ends(self, registers: Array) -> list[Meeting]:
        """Where steps end that begin at registers (k, m), all at the same time."""
        lowest, highest, unit = self._stops.lowest, self._stops.highest, np.eye(registers.shape[1])
        registers = np.clip(registers, lowest, highest)
        ends = registers, *self._there(registers)
        dampings, going = np.full(len(registers), _DAMPING), np.ones(len(registers), bool)
        for _ in range(PLACES):
            rows = np.flatnonzero(going)
            if not len(rows):
                break
            here, squares, slopes, curved = (each[rows] for each in ends)
            free = np.where(slopes > 0, here > lowest, here < highest)
            damped = curved + dampings[rows, None, None] * unit
            damped = np.where(free[:, :, None] & free[:, None], damped, unit)
            inverses = np.linalg.pinv(damped, hermitian=True)  # also where rounding hides the damping
            steps = -(inverses @ (slopes * free)[..., None])[..., 0]
            steps *= LONGEST / np.maximum(np.abs(steps).max(1, keepdims=True), LONGEST)
            nearer = np.clip(here + steps, lowest, highest)
            there = nearer, *self._there(nearer)
            better = there[1] < squares
            less, more = np.maximum(dampings[rows] * _LESS, _LEAST), dampings[rows] * _MORE
            dampings[rows] = np.where(better, less, more)
            going[rows] = np.where(better, there[1] <= ENOUGH * squares, more < _MOST)
            for kept, new in zip(ends, there, strict=True):
                kept[rows[better]] = new[better]
        return self._meetings(ends[0])

    def _there(self, registers: Array) -> tuple[Array, Array, Array]:
        """What is to be least at registers (k, m): squares (k,), half their slopes (k, m) and (k, m, m)."""
        views = self._views(registers)
        apart, by = self._distances(views), views.by_registers()
        jacobians = (by[:, :2] - by[:, 2:]).reshape(len(registers), POINTS, -1)
        squares = np.square(apart).sum(1) + NEAREST * np.square(registers).sum(1)
        slopes = (apart[:, None] @ jacobians)[:, 0] + NEAREST * registers
        return squares, slopes, jacobians.swapaxes(1, 2) @ jacobians + NEAREST * np.eye(registers.shape[1])

    def _meetings(self, registers: Array) -> list[Meeting]:
        """What is expected at registers (k, m)."""
        views = self._views(registers)
        apart, by = self._distances(views), views.by_numbers()
        by = (by[:, :2] - by[:, 2:]).reshape(len(registers), POINTS, -1)
        squares = np.square(apart).sum(1)
        unsure = np.einsum("kcx,kcx->k", by @ self._known.covariance, by)
        left, deviations = (np.sqrt(each / 2) / IMAGE_UNIT for each in (squares, squares + unsure))
        return [Meeting(*each) for each in zip(registers, left.tolist(), deviations.tolist(), strict=True)]


Going = Generator[Array, Observation, tuple[Observation, bool]]


@agent(
    "body_schema",
    "[Learns the arm as a chain of joints](experience.md#body_schema), and what has changed.",
)
class BodySchema(ServoAgent):
    """Takes its arm for a chain of joints before two cameras, and learns which one it is.

    Nothing was measured: no length, no axis, no motor's gain or sign, no camera's place or focal length.
    It takes for granted that each motor moves one joint, in order from the base, by a smooth curve, and that
    cameras are pinholes with a lens. All that is open are numbers, and these are fitted to what is seen in
    motions made anyway (Hersch, Sauser & Billard 2008 learn the axes of joints so; here motors and cameras
    are unknown, too). So each look tells of all places, and after a change, of what has changed.

    Where it knows too little, or is wrong, the servo goes on, with the Jacobian that follows from it.

    Attributes:
        body: What it takes its arm and cameras for.

    Args:
        servo: Reaches what its own knowledge does not.
    """

    LEFT = 0.5
    """It moves where it expects to leave no more than this share of the distance. Choice."""
    NOISES = 6.0
    """A distance is none that is within so many times the noise. Choice."""
    THERE = 0.1
    """It is there where no more than this share of its way is left. Choice: motors may fall short."""
    MISSES = 1
    """After more motions that left too much, the servo goes on alone. Choice."""

    def __init__(self, env: gym.Env[Any, Any], servo: Servo, seed: int = 0) -> None:
        super().__init__(env, servo, seed)
        self.prior_knowledge |= {
            PriorKnowledge.IMAGE_SCALE,
            PriorKnowledge.NOISE,
            PriorKnowledge.CAMERA_MODEL,
            PriorKnowledge.CHAIN,
            PriorKnowledge.MOTOR_ORDER,
            PriorKnowledge.WORD_LIMIT,
        }
        self.body = Body(self.motors, seed)

    def new_findings(self) -> Findings[Any]:
        findings = super().new_findings()
        findings.stops = Stops(np.zeros(self.motors))
        return findings

    def procedure(self, first: Observation, findings: Findings[Any]) -> Procedure:
        """See `ProcedureAgent`. Goes to where they should meet, learns from what is seen there, goes on."""
        now = yield from findings.filter.first(first)
        findings.trusted.append(now)
        home, known, misses = now, self.body.known, 0
        while known is not None and now.visible.all() and not now.last:
            noise_px = findings.filter.noise.px
            place = MeetingSeeker(known, home.object, now, noise_px, _stops(findings)).seek()
            enough_px = max(self.LEFT * now.distance_px, self.NOISES * noise_px)
            near = self._off_px(place, known) <= enough_px
            if near or known.fits:
                begins = place.registers if near else now.registers
                slopes = Slopes.of(known.jacobian(begins, home.object), begins)
                findings.estimator = self.servo.new_estimator(self.motors, slopes)
            if not near:
                break
            now, arrived = yield from self._go(place.registers, now, home, known, findings)
            surprised = bool(findings.filter.inconsistent.any())
            if surprised:
                findings.stops = Stops(now.registers)  # a motor may have changed
            misses += surprised or (now.distance_px > enough_px and arrived)
            if misses > self.MISSES:
                break
            known = self.body.with_looks(self._pairs(findings), sure=surprised)
        findings.stops = Stops(now.registers)  # a stop may have been where other motors were
        yield from self.servo(now, findings)

    def _go(
        self, registers: Array, now: Observation, home: Observation, known: Known, findings: Findings[Any]
    ) -> Going:
        """Moves to registers (m,), and back where that loses a point from view.

        Returns:
            What is then observed, and whether it got there: words are no longer than one, and motors stop.
        """
        way = registers - now.registers
        words = way / max(1.0, float(np.abs(way).max()))
        after = yield words
        short = words - (after.registers - now.registers)
        _stops(findings).learn(words, short, after.registers)
        expected, deviations_px = known.expected(after.registers, home.object)
        settled = yield from findings.filter.settle(after, now, expected, deviations_px)
        findings.trusted.append(settled)
        if findings.filter.lost.any():
            settled = yield from back(now, settled, findings)
        arrived = np.abs(registers - after.registers).max() <= self.THERE * np.abs(way).max()
        return settled, bool(arrived or (short == words).all())

    def _pairs(self, findings: Findings[Any]) -> Pairs:
        return Pairs.of_trial(findings.trusted, findings.filter.noise.px, self.body.trials)

    def expected_px(self, first: RawObservation) -> float | None:
        """How far off it expects to be after its first motion, told before that motion is made.

        Args:
            first: What a trial begins with.

        Returns:
            The distance in an image, root mean square, in pixels; None where it knows nothing, or does not
            see the object.
        """
        home, known, noise_px = at_home(Observation.of(first)), self.body.known, self.filter.noise.px
        if known is None or not home.visible.all():
            return None
        seeker = MeetingSeeker(known, home.object, home, noise_px, Stops(home.registers))
        return self._off_px(seeker.seek(), known)

    def _off_px(self, place: Meeting, known: Known) -> float:
        """How far off it will be there: where the chain does not fit, as far as in earlier trials or more."""
        return float(np.hypot(place.deviation_px, 0.0 if known.fits else self.body.off_px))

    def learn_trial(self, findings: Findings[Any], last: Observation, ended: bool) -> None:
        """See `ProcedureAgent`. Every look teaches, however the trial ends."""
        super().learn_trial(findings, last, ended)
        if findings.trusted:
            self.body.learn(self._pairs(findings))

    @property
    def events(self) -> Sequence[BodyEvent]:
        """The changes of the world that it has recognised, the latest last."""
        return self.body.events

    @property
    def kind(self) -> str:
        return f"BodySchema over {self.servo!r}"

    def arrays(self) -> dict[str, NDArray[Any]]:
        return super().arrays() | self.body.arrays()

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        super().restore(arrays)
        self.body.restore(arrays)


def _stops(findings: Findings[Any]) -> Stops:
    assert findings.stops is not None
    return findings.stops
