"""How marks move in the images of a robot on wheels, whatever its cameras are: projective geometry.

A camera is fixed to a robot on a flat floor. A mark is at height h above it, and its image is x = (x, y,
1). Let T x = (X / h, Y / h, 1), but for a factor, be what a camera that looks straight along the vertical
would see: T is a projectivity, the same for all marks. As the robot drives, T x turns and shifts as the
floor does, the shift divided by h. So x moves by the homography G = T^-1 M T, M = (R, t / h; 0, 1), and the
third coordinate of G x is the mark's depth after the motion over that before it. Marks with h > 0 are on
one side of a line in the image, the horizon; those with h < 0 are on the other.

As long as wheels turn in constant ratios, the robot drives along an arc, and what motors do adds up:
twists, each times how far its motor turns. A last motor, which has no word, leads to the dock: some motion
on the floor must bring marks to where the robot's own are seen.

Nothing of this asks for a metre, an angle, a focal length or a track. T, twists and 1 / h are learned from
image points, all but for their scales, and so are how a lens bends lines and how motors depart from
proportion.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import IMAGE_UNIT, lengths_px

from ..base.checks import checked_array
from ..base.observation import Array, Flags
from ..base.weights import cauchy_weights
from .least_squares import Least, Quadratic, least

NEAREST = 0.05
"""No mark is taken to come nearer than this share of its depth (a guard: one behind a camera would be seen in
its image again)."""
KNOTS = np.array([0.25, 0.5, 1.0])
"""Between these words, and 0, curves of motors are straight. Choice."""
WIDTHS = np.diff(KNOTS, prepend=0), np.diff(KNOTS, append=2.0)
FARTHEST = 8.0
"""No image point is predicted farther out than so many image units (a guard)."""


class DrivenArc(NamedTuple):
    """What a motion did.

    Attributes:
        before: Image points (p, 2) before it.
        words: Its control words (m,).
        after: Image points (p, 2) after it.
        seen: Which of them were seen before and after (p,).
    """

    before: Array
    words: Array
    after: Array
    seen: Flags


def homogeneous(points: Array) -> Array:
    """Image points (..., 2) as columns (..., 3, 1) whose third coordinate is 1."""
    return np.concatenate([points, np.ones_like(points[..., :1])], -1)[..., None]


def projected(columns: Array) -> Array:
    """Image points (..., 2) of such columns (..., 3, 1), see `NEAREST` and `FARTHEST`."""
    flat = columns[..., :2, 0] / np.maximum(columns[..., 2:, 0], NEAREST)
    return np.clip(flat, -FARTHEST, FARTHEST)


def homography(before: Array, after: Array) -> Array:
    """The projectivity G (3, 3) of determinant 1 that takes image points (p, 2), four at least, to others.

    Least squares of linear equations (Hartley & Zisserman 2004, section 4.1).
    """
    x, zero = homogeneous(before)[..., 0], np.zeros((len(before), 3))
    of_x = np.concatenate([x, zero, -after[:, :1] * x], 1)
    of_y = np.concatenate([zero, x, -after[:, 1:] * x], 1)
    found = np.linalg.svd(np.concatenate([of_x, of_y]))[2][-1].reshape(3, 3)
    return np.asarray(found / np.cbrt(np.linalg.det(found)))


class LearnedCamera(NamedTuple):
    """What is learned of a camera; every array may have more dimensions in front.

    Attributes:
        frame: T (3, 3).
        twists: Shift and turn (m, 3) that motors add at a word of 1.
        nearness: 1 / h of each mark (k,).
        curves: By how much more than in proportion each motor acts at the words `KNOTS` (m, 3).
        bend: b of the lens (): x / (1 + b r²) is straight (Fitzgibbon 2001).
    """

    frame: Array
    twists: Array
    nearness: Array
    curves: Array
    bend: Array

    @classmethod
    def of(cls, numbers: Array, motors: int) -> LearnedCamera:
        """From all as one array (..., 10 + 6 m + k)."""
        parts = np.split(numbers, [9, 9 + 3 * motors, -1 - 3 * motors, -1], axis=-1)
        frame, twists, nearness, curves, bend = parts
        before = numbers.shape[:-1]
        frame, twists, curves = (each.reshape(*before, -1, 3) for each in (frame, twists, curves))
        return cls(frame, twists, nearness, curves, bend[..., 0])

    def homographies(self, words: Array) -> Array:
        """What words (..., m) do to each mark: G (..., k, 3, 3)."""
        size = np.abs(words)[..., None]
        hats = np.maximum(1 - np.abs(size - KNOTS) / np.where(size < KNOTS, *WIDTHS), 0)
        effect = words * (1 + (self.curves * hats).sum(-1))
        x, y, turn = np.moveaxis((effect[..., None] * self.twists).sum(-2), -1, 0)
        straight, aside = np.sinc(turn / np.pi), turn / 2 * np.sinc(turn / (2 * np.pi)) ** 2
        moves = np.zeros((*turn.shape, self.nearness.shape[-1], 3, 3))
        moves[..., 0, 0] = moves[..., 1, 1] = np.cos(turn)[..., None]
        moves[..., 1, 0] = np.sin(turn)[..., None]
        moves[..., 0, 1] = -moves[..., 1, 0]
        moves[..., 0, 2] = (straight * x - aside * y)[..., None] * self.nearness
        moves[..., 1, 2] = (aside * x + straight * y)[..., None] * self.nearness
        moves[..., 2, 2] = 1
        frame = self.frame[..., None, :, :]
        return np.asarray(np.linalg.inv(frame) @ moves @ frame)

    def straight(self, points: Array) -> Array:
        """Image points (..., k, 2) as they would be without a lens that bends lines."""
        bend = self.bend[..., None, None]
        return np.asarray(points / (1 + bend * (points**2).sum(-1, keepdims=True)))

    def bent(self, points: Array) -> Array:
        """The inverse of `straight`."""
        bend = self.bend[..., None, None]
        left = 1 - 4 * bend * (points**2).sum(-1, keepdims=True)
        return np.asarray(2 * points / (1 + np.sqrt(np.maximum(left, NEAREST))))

    def predict(self, points: Array, words: Array) -> Array:
        """Where points (..., k, 2) are seen after words (..., m)."""
        return self.bent(projected(self.homographies(words) @ homogeneous(self.straight(points))))


class ProjectiveModel:
    """What words do to marks in images, learned from motions.

    Attributes:
        motors: m.
        numbers: All that is learned, of each camera (c, n), see `LearnedCamera`.
        motions: What it learns from.

    Args:
        points: p = k c: all marks in all cameras, each mark in all cameras in turn.
        motors: m; arrays of what is learned also have the one that leads to the dock.
        cameras: c.
    """

    KEPT = 60
    """So many motions are remembered. Choice."""
    FRAME, TWIST, NEARNESS, CURVE, BEND = 0.5, 10.0, 1.0, 0.3, 0.1
    """Standard deviations before anything is known. Choice: T is that of a level camera, rolled by any angle,
    of an image as wide as it is far; a word of 1 may move the robot by some heights of marks, and turn it by
    some radians."""
    CARRIED = 1 / 3
    """So many of those deviations where a camera was displaced or wheels were replaced. Choice."""
    LOOKS_PX, SLIP = 1.5, 0.02
    """Standard deviations of a predicted image coordinate, and of what a motor does as a share of it. Choice:
    twice what two looks of 0.5 px have; wheels slip."""
    LEEWAY, CORRECTIONS = 0.1, 2
    """What words do may be off by such a share where marks are hidden; so many steps of Gauss and Newton's
    method find it. Choice."""
    MISTAKEN = 5.0
    """A point that is so many deviations off counts half (a guard)."""
    ROLLS = 6
    """So many rolls, within half a turn, are tried first. Choice."""
    ALL, BEST = 10, 4
    """After so many rounds from all starts so many go on, twice as long. Choice."""
    UNDOUBTED = 1e4
    """Far from what is right no point is mistaken: `MISTAKEN` of the first rounds."""
    OFF_PX = 4.0
    """It tries all starts anew where no motion leads nearer to the dock. Choice: within 2.5 px it docks."""
    LEAST, PATIENCE = 4.0, 0.5
    """For that it needs so many motions, and such a share more before it tries again. Choice."""
    STEP = 1e-6
    """Of numerical derivatives (a guard)."""

    def __init__(self, points: int, motors: int, cameras: int = 1) -> None:
        self.motors, self._cameras, self._marks = motors, cameras, points // cameras
        motors += 1  # the last one leads to the dock
        still = np.concatenate([np.eye(3).ravel(), np.zeros(1 + 6 * motors + self._marks)])
        self.numbers = np.tile(still, (cameras, 1))
        self.motions: list[DrivenArc] = []
        self._to_dock: DrivenArc | None = None
        self._wait = 0.0
        sizes = 9, 3 * motors, self._marks, 3 * motors, 1
        spreads = self.FRAME, self.TWIST, self.NEARNESS, self.CURVE, self.BEND
        self._unknown = np.repeat(spreads, sizes)
        self._prior, self._deviations = self.numbers, self._unknown

    @property
    def learned(self) -> LearnedCamera:
        """Of each camera (c, ...)."""
        return self._parts(self.numbers)

    @property
    def knows(self) -> bool:
        """Whether it knows what words do."""
        return bool(self.learned.twists[:, : self.motors].any())

    def transforms(self, words: Array) -> Array:
        """What words (..., m) do to marks in straight images: G (..., p, 3, 3)."""
        words = _of_motors(words)
        own = [self._parts(numbers).homographies(words) for numbers in self.numbers]
        of_points = np.stack(own, -3)
        return of_points.reshape(*words.shape[:-1], -1, 3, 3)

    def straight(self, points: Array) -> Array:
        """Image points (p, 2) as they would be without lenses that bend lines."""
        return self._joined(self.learned.straight(self._by_camera(points)))

    def predict(self, points: Array, words: Array) -> Array:
        """Where points (p, 2) are seen after words (m,)."""
        return self._joined(self.learned.predict(self._by_camera(points), _of_motors(words)))

    def doubt_px(self, points: Array, words: Array) -> Array:
        """Standard deviations (p,) of where points (p, 2) are seen after words (m,), in pixels."""
        of_cameras = self._doubts_px(self.learned, self._by_camera(points), _of_motors(words))
        return self._joined(of_cameras[..., None])[..., 0]

    def _doubts_px(self, learned: LearnedCamera, points: Array, words: Array) -> Array:
        """As `doubt_px`, for points (..., k, 2) as each `learned` has them: looks, and what wheels slip."""
        there = learned.predict(points, words)
        slipped = [
            learned.predict(points, words * (1 + self.SLIP * way)) for way in _of_motors(np.eye(self.motors))
        ]
        variance = sum(lengths_px(each - there) ** 2 for each in slipped)
        return np.asarray(np.sqrt(self.LOOKS_PX**2 + variance))

    def corrected(self, expected: Array, words: Array, found: Array, visible: Flags) -> Array:
        """Where marks (p, 2) are after words (m,), expected at (p, 2): hidden ones move with the others.

        Words do not do quite what is expected of them. What is off is a small motion on the floor, the most
        probable one that brings the visible marks (p,) to where they are found (p, 2).
        """
        if visible.all():
            return found
        learned = self.learned
        floor = learned._replace(twists=np.eye(3), curves=np.zeros((3, len(KNOTS))))
        leeway = self.LEEWAY * np.abs(_of_motors(words)[:, None] * learned.twists).sum(1) + 1e-12
        before, seen = self._by_camera(expected), self._by_camera(found)
        units = self._by_camera(visible[:, None] / (self.LOOKS_PX * IMAGE_UNIT))
        motion = np.zeros_like(leeway)
        varied = self.STEP * np.concatenate([np.zeros((1, 3)), np.eye(3)])[:, None]
        for _ in range(self.CORRECTIONS):
            there = floor.predict(before, (motion + varied) * leeway)
            off = ((seen - there[0]) * units).reshape(len(motion), -1, 1)
            slopes = (there[1:] - there[0]) / self.STEP * units
            slopes = slopes.reshape(3, len(motion), -1).swapaxes(0, 1)
            normal = slopes @ slopes.swapaxes(1, 2) + np.eye(3)
            motion = motion + np.linalg.solve(normal, slopes @ off - motion[..., None])[..., 0]
        moved = self._joined(floor.predict(before, motion * leeway))
        return np.where(visible[:, None], found, moved)

    def learn(self, motion: DrivenArc) -> None:
        """Remembers a motion; `fit` learns from it."""
        self.motions = [*self.motions, motion][-self.KEPT :]
        self._wait -= 1

    def aim(self, points: Array, goal: Array) -> None:
        """Some motion on the floor brings marks from image points (p, 2) to a goal (p, 2)."""
        way = np.append(np.zeros(self.motors), 1.0)
        self._to_dock = DrivenArc(points, way, goal, np.ones(len(points), bool))

    def forget(self, kept: int) -> None:
        """Wheels are others than before: of motors only the latest motions tell."""
        self.motions, self._prior, self._wait = self.motions[-kept:], self.numbers, self.LEAST - kept
        of_wheels = self._parts(np.zeros_like(self._unknown))
        of_wheels.twists[...] = of_wheels.curves[...] = 1
        self._deviations = self._unknown * np.maximum(self._flat(of_wheels), self.CARRIED)

    def carry_over(self, homographies: Array) -> None:
        """Cameras were knocked: what was seen at x is now seen at G x, but for how far they were displaced.

        Args:
            homographies: G of each camera (c, 3, 3), of straight images.
        """
        learned = self.learned
        carried = learned._replace(frame=learned.frame @ np.linalg.inv(homographies))
        self.numbers = self._prior = np.stack(
            [self._flat(LearnedCamera(*each)) for each in zip(*carried, strict=True)]
        )
        self._deviations, self.motions = self.CARRIED * self._unknown, []
        self._to_dock, self._wait = None, self.LEAST

    def fit(self, rounds: int) -> None:
        """Goes to what is most probable by at most so many rounds of Levenberg and Marquardt's method.

        First it begins with many horizons, and again where what it knows cannot be right, see `OFF_PX`.
        """
        if not self.motions:
            return
        if self.knows:
            self._go_on(rounds)
            if self._leads_to_the_dock() or self._wait > 0:
                return
        if self._begin_anew():
            self._go_on(rounds)

    def _go_on(self, rounds: int) -> float:
        """From what it knows; returns the cost."""
        found = self._least(self.numbers[:, None], self._prior[:, None], rounds, self.MISTAKEN)
        self.numbers = found.places[:, 0]
        return float(found.costs.sum())

    def _begin_anew(self) -> bool:
        """From many horizons; whether that led to what is more probable than what it knew."""
        self._wait = self.PATIENCE * len(self.motions)
        deviations, self._deviations = self._deviations, self._unknown
        known_cost = self._go_on(0) if self.knows else np.inf
        starts = self._horizons()
        some = self._least(starts, starts, self.ALL, self.UNDOUBTED)
        best = np.argsort(some.costs, 1, kind="stable")[:, : self.BEST, None]
        starts, firsts = (np.take_along_axis(each, best, 1) for each in (starts, some.places))
        found = self._least(firsts, starts, 2 * self.ALL, self.MISTAKEN)
        if found.costs.min(1).sum() > known_cost:
            self._deviations = deviations
            return False
        best = found.costs.argmin(1)[:, None, None]
        self.numbers = np.take_along_axis(found.places, best, 1)[:, 0]
        self._prior = np.take_along_axis(starts, best, 1)[:, 0]
        return self.knows

    def _leads_to_the_dock(self) -> bool:
        """Whether some motion on the floor brings marks to where they are to be seen, as it must."""
        if self._to_dock is None:
            return True
        before, way, goal, _ = self._to_dock
        expected = self._joined(self.learned.predict(self._by_camera(before), way))
        return bool(lengths_px(expected - goal).max() < self.OFF_PX)

    def _horizons(self) -> Array:
        """What to begin with (c, s, n): a level camera at each roll, its horizon between each two marks."""
        whole = [motion for motion in self.motions if motion.seen.all()] or self.motions
        first = self._by_camera(whole[0].before)
        found = []
        for roll in np.pi * np.arange(self.ROLLS) / self.ROLLS:
            c, s = np.cos(roll), np.sin(roll)
            up = np.sort(first @ [s, -c], 1)
            cuts = np.concatenate([up[:, :1] - 1, (up[:, 1:] + up[:, :-1]) / 2, up[:, -1:] + 1], 1)
            for cut in cuts.T:
                for marks, level in zip(first, cut, strict=True):
                    frame = np.array([[c, s, 0], [0, 0, 1], [s, -c, -level]])
                    above = np.sign(marks @ [s, -c] - level)
                    still = np.zeros((self.motors + 1, 3))
                    found.append(self._flat(LearnedCamera(frame, still, above, still, np.zeros(()))))
        return np.reshape(found, (-1, self._cameras, len(self._unknown))).swapaxes(0, 1)

    def _least(self, starts: Array, priors: Array, rounds: int, mistaken: float) -> Least:
        """From starts (c, s, n), each with a prior of its own."""
        cameras, many, size = starts.shape
        motions = [motion._replace(words=_of_motors(motion.words)) for motion in self.motions]
        motions += [self._to_dock] if self._to_dock else []
        before, words, after, seen = (np.stack(each) for each in zip(*motions, strict=True))
        before, after, seen = (self._by_camera(each) for each in (before, after, seen[..., None]))
        slip = self._parts(self.numbers[:, None])
        units = seen / (self._doubts_px(slip, before, words)[..., None] * IMAGE_UNIT)
        before, after = (np.repeat(each, many, 0)[:, None] for each in (before, after))
        units = np.repeat(units, many, 0)[:, None]
        means: Array = priors.reshape(-1, size)
        varied = np.concatenate([np.zeros((1, size)), self.STEP * np.eye(size)])

        def near(places: Array) -> Quadratic:
            learned = self._parts((places[:, None] + varied)[:, :, None])
            off = (learned.predict(before, words) - after) * units
            slopes = ((off[:, 1:] - off[:, :1]) / self.STEP).reshape(len(places), size, -1)
            off = off[:, 0].reshape(len(places), -1, 2)
            sizes = (off**2).sum(-1) / mistaken**2
            weighted = slopes * np.repeat(cauchy_weights(np.sqrt(sizes)), 2, -1)[:, None]
            prior = (places - means) / self._deviations
            return Quadratic(
                mistaken**2 * np.log1p(sizes).sum(-1) + (prior**2).sum(-1),
                (weighted @ off.reshape(len(places), -1, 1))[..., 0] + prior / self._deviations,
                weighted @ slopes.swapaxes(1, 2) + np.diag(self._deviations**-2),
            )

        found = least(near, starts.reshape(-1, size), rounds)
        return Least(found.places.reshape(starts.shape), found.costs.reshape(cameras, many))

    def _by_camera(self, points: Array) -> Array:
        """Of points (..., p, d), those of each camera (c, ..., k, d)."""
        own = points.reshape(*points.shape[:-2], self._marks, self._cameras, points.shape[-1])
        return np.moveaxis(own, -2, 0)

    def _joined(self, points: Array) -> Array:
        """The inverse of `_by_camera`."""
        return np.moveaxis(points, 0, -2).reshape(*points.shape[1:-2], -1, points.shape[-1])

    def _parts(self, numbers: Array) -> LearnedCamera:
        return LearnedCamera.of(numbers, self.motors + 1)

    @staticmethod
    def _flat(learned: LearnedCamera) -> Array:
        return np.concatenate([np.ravel(each) for each in learned])

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """All that is known, as named arrays."""
        known = {"numbers": self.numbers, "prior": self._prior, "deviations": self._deviations}
        known["wait"] = np.array([self._wait])
        if self.motions:
            stacked = (np.stack(each).astype(float) for each in zip(*self.motions, strict=True))
            known |= dict(zip(DrivenArc._fields, stacked, strict=True))
        return known

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Takes over what `arrays` returned."""
        shape, points = self.numbers.shape, self._marks * self._cameras
        self.numbers, self._prior = (checked_array(arrays, name, shape) for name in ("numbers", "prior"))
        self._deviations = checked_array(arrays, "deviations", shape[1:])
        (self._wait,) = checked_array(arrays, "wait", (1,)).tolist()
        if not ((self._deviations > 0).all() and np.linalg.det(self.learned.frame).all()):
            raise ValueError("deviations must be above 0, and frames have inverses")
        self.motions = []
        if "words" in arrays:
            shapes = ((None, points, 2), (None, self.motors), (None, points, 2), (None, points))
            read = [checked_array(arrays, *each) for each in zip(DrivenArc._fields, shapes, strict=True)]
            for before, words, after, seen in zip(*read, strict=True):
                self.motions.append(DrivenArc(before, words, after, seen > 0))


def _of_motors(words: Array) -> Array:
    """Words (..., m + 1) that also tell the motor to the dock: nothing."""
    return np.concatenate([words, np.zeros_like(words[..., :1])], -1)
