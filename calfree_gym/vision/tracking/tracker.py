"""Finds the gripper and the object in stereo images, by coloured balls."""

from __future__ import annotations

import copy
import warnings
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import CAMERAS
from calfree_gym.vision.marks import MARK_NAMES, Marks
from calfree_gym.vision.tracking.balls import Ball, measure_balls
from calfree_gym.vision.tracking.blobs import ColourTable, Image, find_blobs
from calfree_gym.vision.tracking.outlines import Array


class FrozenCameras:
    """Tells which cameras have frozen, and warns once when one does.

    A live camera has noise. So one has frozen whose image is the last one, to the byte, although motors have
    moved; and it has until another image comes.
    """

    def __init__(self) -> None:
        self._last: list[int | None] = [None for _ in CAMERAS]
        self._frozen = [False for _ in CAMERAS]

    def __call__(self, images: tuple[Image, ...], moved: bool) -> tuple[bool, ...]:
        """Whether each camera has frozen.

        Args:
            images: One a camera.
            moved: Whether motors have moved since the last ones.
        """
        for camera, image in enumerate(images):
            last, self._last[camera] = self._last[camera], zlib.crc32(image.tobytes())
            before, again = self._frozen[camera], last == self._last[camera]
            self._frozen[camera] = again and (before or bool(moved))
            if self._frozen[camera] and not before:
                warnings.warn(
                    f"the {CAMERAS[camera]} camera has frozen: motors have moved, and its image is the last "
                    "one to the byte. Its points count as not seen until another image comes",
                    stacklevel=3,
                )
        return tuple(self._frozen)


LEAST_SIZE = 16
"""Width and height of an image in px. Choice: a ball of the least radius is a tenth of it."""
LARGEST_RATIO = 2.0
"""Of the two gripper balls' radii. Choice: they are 100 mm apart, and cameras at least 200 mm away."""

SHARES = (1.0, 0.5)
"""Of the differences from a mark's colour that are allowed: at first, and where no ball is found. Measured on
photographs with drawn balls: 97.9 % are found, by the first alone 96.7 %, and no more false ones; from 0.4 to
0.6 it is alike."""


Pair = tuple[Image, Image]
"""What the left and the right camera see."""
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


class StereoTracker:
    """Finds the gripper point and the object point in pairs of images.

    Args:
        marks: Colours of the balls.
    """

    def __init__(self, marks: Marks | None = None) -> None:
        if marks is not None and not isinstance(marks, Marks):
            raise ValueError(f"marks must be Marks; found {marks!r}")
        self.marks = marks or Marks()
        finder = BallFinder(self.marks)
        self._finders = [finder.copy() for _ in CAMERAS]
        self._cameras = FrozenCameras()
        self.reset()

    def reset(self) -> None:
        """Forgets what was seen: what was never seen stands at the centre. A frozen camera stays frozen."""
        for finder in self._finders:
            finder.reset()
        self._points = np.zeros((4, 2))

    def copy(self) -> StereoTracker:
        """One that remembers the same, and goes on by itself."""
        other = copy.copy(self)
        other._finders = [finder.copy() for finder in self._finders]
        other._cameras = copy.deepcopy(self._cameras)
        other._points = self._points.copy()
        return other

    def __call__(self, left: Image, right: Image, moved: bool = False) -> tuple[Array, NDArray[np.bool_]]:
        """The points in a pair of images, and which of them are seen.

        Args:
            left: RGB (h, w, 3), uint8, of any size. OpenCV gives BGR: turn its last axis round.
            right: As `left`; it may have another size.
            moved: Whether motors have moved since the last images. A live camera has noise: one whose image
                is the last one, to the byte, has frozen then: its points are not seen, and a warning says so.

        Returns:
            Image points (4, 2): gripper left and right, object left and right; and flags (4,). They are
            (x, y) from the middle, x right and y down, in halves of the image's longer side. A point that is
            not seen stands where it was seen last, at first at the centre.

        Raises:
            ValueError: An image is no such array.
        """
        check_images(left, right)
        frozen = self._cameras((left, right), moved)
        live = [image for image, gone in zip((left, right), frozen, strict=True) if not gone]
        found = iter(self._finders[0].candidates(live))
        return self._place((left, right), [None if gone else next(found) for gone in frozen])

    @staticmethod
    def track(trackers: Sequence[StereoTracker], pairs: Sequence[Pair]) -> tuple[Array, NDArray[np.bool_]]:
        """What each tracker finds in its own pair of images, all together, which takes less time.

        Args:
            trackers: That have the same marks (n,).
            pairs: Images of live cameras (n,).

        Returns:
            Points (n, 4, 2) and flags (n, 4).
        """
        found = trackers[0]._finders[0].candidates([image for pair in pairs for image in pair])
        placed = [
            tracker._place(pair, found[2 * i : 2 * i + 2])
            for i, (tracker, pair) in enumerate(zip(trackers, pairs, strict=True))
        ]
        return np.array([points for points, _ in placed]), np.array([seen for _, seen in placed])

    def _place(self, pair: Pair, found: Sequence[Balls | None]) -> tuple[Array, NDArray[np.bool_]]:
        """The points, and which of them are seen, by the balls that were found; None where a camera froze."""
        visible = np.zeros(4, bool)
        for camera, (image, candidates) in enumerate(zip(pair, found, strict=True)):
            if candidates is None:
                continue
            balls = self._finders[camera].choose(candidates, max(image.shape[:2]))
            for row, point in ((camera, gripper_point(balls)), (2 + camera, object_point(balls))):
                if point is not None:
                    height, width = image.shape[:2]
                    self._points[row] = (2 * point / [width, height] - 1) * proportions(image)
                    visible[row] = True
        return self._points.copy(), visible


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


def proportions(image: Image) -> Array:
    """Width and height (2,) of an image, by the longer of both: so lengths are alike along both axes."""
    height, width = image.shape[:2]
    return np.array([width, height]) / max(width, height)


def check_images(left: Any, right: Any) -> None:
    """Raises ValueError where an image is no uint8 array (h, w, 3), or too small."""
    for name, image in zip(CAMERAS, (left, right), strict=True):
        _check_image(name, image)


def _check_image(name: str, image: Any) -> None:
    if not isinstance(image, np.ndarray):
        raise ValueError(f"the {name} image is a {type(image).__name__}; it must be a uint8 array (h, w, 3)")
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
        raise ValueError(
            f"the {name} image has shape {image.shape} and type {image.dtype}; it must be (h, w, 3), uint8"
        )
    if min(image.shape[:2]) < LEAST_SIZE:
        raise ValueError(
            f"the {name} image is {image.shape[1]} × {image.shape[0]} px; it must be {LEAST_SIZE} × "
            f"{LEAST_SIZE} or more"
        )
