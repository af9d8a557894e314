"""Finds the gripper and the object in stereo images, by coloured balls."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import CAMERAS
from calfree_gym.vision.marks import MARK_NAMES, Marks
from calfree_gym.vision.tracking.balls import Ball, measure_balls
from calfree_gym.vision.tracking.blobs import ColourTable, Image, find_blobs
from calfree_gym.vision.tracking.outlines import Array
from calfree_gym.vision.tracking.stereo import Found, Pair, PointTracker

LARGEST_RATIO = 2.0
"""Of the two gripper balls' radii. Choice: they are 100 mm apart, and cameras at least 200 mm away."""

SHARES = (1.0, 0.5)
"""Of the differences from a mark's colour that are allowed: at first, and where no ball is found. Measured on
photographs with drawn balls: 97.9 % are found, by the first alone 96.7 %, and no more false ones; from 0.4 to
0.6 it is alike."""

Balls = dict[str, list[Ball]]
"""What may be each mark, by its name."""


class BallFinder:
    """Finds the three balls in the images of one camera, and remembers how large they were."""

    def __init__(self, marks: Marks) -> None:
        self._marks = marks
        self._tables = [ColourTable(marks, share) for share in SHARES]
        self._last: dict[str, Ball] = {}

    def reset(self) -> None:
        """Forgets."""
        self._last = {}

    def copy(self) -> BallFinder:
        """One that remembers the same, and goes on by itself."""
        other = copy.copy(self)
        other._last = dict(self._last)
        return other

    def __call__(self, image: Image) -> dict[str, Ball]:
        """The balls that are seen in an image (h, w, 3), by the names of their marks."""
        (balls,) = self.candidates([image])
        return self.choose(balls, max(image.shape[:2]))

    def choose(self, balls: Balls, longer: int) -> dict[str, Ball]:
        """Those balls that are the marks, in an image whose longer side has so many pixels."""
        found = {name: [(self._merit(name, ball, longer), ball) for ball in balls[name]] for name in balls}
        best = {name: max(each, key=lambda b: b[0])[1] for name, each in found.items() if each}
        pairs = [
            (merit_1 * merit_2, first, second)
            for merit_1, first in found["gripper_1"]
            for merit_2, second in found["gripper_2"]
            if 1 / LARGEST_RATIO**2 <= first.area / second.area <= LARGEST_RATIO**2
        ]
        if pairs:
            _, best["gripper_1"], best["gripper_2"] = max(pairs, key=lambda pair: pair[0])
        elif "gripper_1" in best and "gripper_2" in best:
            del best[min(("gripper_1", "gripper_2"), key=lambda name: best[name].roundness)]
        self._last.update(best)
        return best

    def candidates(self, images: Sequence[Image]) -> list[Balls]:
        """The balls of each mark's colour in each image (h, w, 3).

        A mark that stands before a large thing of a colour like its own makes one blob with it: where no ball
        is found, only colours are looked at that are nearer to the mark's, and only sure balls count.
        """
        found: list[Balls] = [{name: [] for name in self._marks.names()} for _ in images]
        for table in self._tables:
            sought = [
                (balls, name, blob)
                for image, balls in zip(images, found, strict=True)
                if (missing := [name for name in balls if not balls[name]])
                for name, blobs in find_blobs(image, table, missing).items()
                for blob in blobs
            ]
            marks = [getattr(self._marks, name) for _, name, _ in sought]
            measured = measure_balls([blob for *_, blob in sought], marks)
            for (balls, name, _), ball in zip(sought, measured, strict=True):
                if ball and (ball.is_sure or table is self._tables[0]):
                    balls[name].append(ball)
        return found

    def _merit(self, name: str, ball: Ball, longer: int) -> float:
        """How likely a ball is the mark: by its roundness, and by what was seen before.

        What was seen before counts by half: the mark may have jumped, or have been something else.
        """
        merit = ball.roundness * np.sqrt(ball.seen)
        if name not in self._last:
            return float(merit * ball.area**0.25)
        last = self._last[name]
        growth = np.log(ball.area / last.area)
        way = np.hypot(*(ball.centre - last.centre)) / longer
        return float(merit * (0.5 + 0.4 * np.exp(-(growth**2)) + 0.1 * np.exp(-way / 0.1)))


class StereoTracker(PointTracker):
    """Finds the gripper point and the object point in pairs of images, by coloured balls.

    Args:
        marks: Colours of the balls.
    """

    def __init__(self, marks: Marks | None = None) -> None:
        if marks is not None and not isinstance(marks, Marks):
            raise ValueError(f"marks must be Marks; found {marks!r}")
        self.marks = marks or Marks()
        finder = BallFinder(self.marks)
        self._finders = [finder.copy() for _ in CAMERAS]
        super().__init__()

    def reset(self) -> None:
        """See `PointTracker`."""
        super().reset()
        for finder in self._finders:
            finder.reset()

    def copy(self) -> StereoTracker:
        """See `PointTracker`."""
        other = super().copy()
        other._finders = [finder.copy() for finder in self._finders]
        return other

    def _find(self, camera: int, image: Image) -> Found:
        return _points_of(self._finders[camera](image))

    @staticmethod
    def track(trackers: Sequence[StereoTracker], pairs: Sequence[Pair]) -> tuple[Array, NDArray[np.bool_]]:
        """What each tracker finds in its own pair of images, all together, which takes less time.

        Args:
            trackers: That have the same marks (n,).
            pairs: Images of live cameras (n,).

        Returns:
            Points (n, 4, 2) and flags (n, 4).
        """
        balls = iter(trackers[0]._finders[0].candidates([image for pair in pairs for image in pair]))
        placed = [
            tracker._placed(
                pair,
                [
                    _points_of(finder.choose(next(balls), max(image.shape[:2])))
                    for finder, image in zip(tracker._finders, pair, strict=True)
                ],
            )
            for tracker, pair in zip(trackers, pairs, strict=True)
        ]
        return np.array([points for points, _ in placed]), np.array([seen for _, seen in placed])


def _points_of(balls: dict[str, Ball]) -> Found:
    return gripper_point(balls), object_point(balls)


def gripper_point(balls: dict[str, Ball]) -> Array | None:
    """Image in px (2,) of the midpoint in space between the gripper's balls, if both are seen.

    Depth goes as 1/√area: (z1 p1 + z2 p2) / (z1 + z2), exact for a pinhole and balls of equal size.
    """
    pair = [balls[name] for name in MARK_NAMES[:2] if name in balls]
    if len(pair) < 2:
        return None
    z1, z2 = (ball.area**-0.5 for ball in pair)
    return (z1 * pair[0].centre + z2 * pair[1].centre) / (z1 + z2)


def object_point(balls: dict[str, Ball]) -> Array | None:
    """Image in px (2,) of the object's ball, if it is seen."""
    return balls["object"].centre if "object" in balls else None
