"""A gripper that grasps, and an object of one colour, in two images."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from itertools import chain
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import CAMERAS
from calfree_gym.vision.marks import GraspMarks
from calfree_gym.vision.tracking.blobs import ColourTable, Image, find_blobs
from calfree_gym.vision.tracking.gripper_fit import GripperFit, GripperLayout, fit_gripper
from calfree_gym.vision.tracking.outlines import Array
from calfree_gym.vision.tracking.parts import MarkPart, completed, find_parts, whole
from calfree_gym.vision.tracking.stereo import FrozenCameras, Pair, check_images, proportions

POINTS = ("tip", "base", "jaw_1", "jaw_2", "edge_1", "edge_2", "object", "end_1", "end_2")
"""What is found, in the order of the points."""
LEAST_SEEN = 0.25
"""What shows less of a mark than this share of what was seen of it in any of the last looks is not taken for
it. Choice: seams where other marks meet have their hues, and are thin."""
LOOKS = 3
"""So many looks count: what goes on to show less is farther away now. Choice."""
LARGEST = 0.5
"""Width or height of an object as a share of the image's. Choice: it must be seen whole at first."""
REMEMBERED = 0.8
"""Of the evidence that both images show the same ends, so much counts in the next look. Choice."""
NEAR = 5
"""Width (px) of what is near a pixel. Choice: edges that are blurred, or of a mixed colour."""
ERROR, SIZE = 0.008, 0.4
"""Standard deviations of the image of an axis, in image units, and of its length, in gripper lengths. Choice:
2 px, and things that a gripper grasps."""
_TIP, _BASE, _JAW_1, _JAW_2, _EDGE_1, _EDGE_2, _OBJECT, _END_1, _END_2 = range(len(POINTS))
_GRIPPER = slice(_OBJECT)


class GraspTracker:
    """Finds the points of a gripper and an object in pairs of images.

    Args:
        marks: Colours of their parts.
        layout: Where they are on the gripper. The default suits the simulator's.
    """

    def __init__(self, marks: GraspMarks | None = None, layout: GripperLayout | None = None) -> None:
        if marks is not None and not isinstance(marks, GraspMarks):
            raise ValueError(f"marks must be GraspMarks; found {marks!r}")
        self.marks, self._layout = marks or GraspMarks(), layout or GripperLayout()
        self._table = ColourTable(self.marks)
        self._cameras = FrozenCameras()
        self.reset()

    def reset(self) -> None:
        """Forgets what was seen: what was never seen stands at the centre. A frozen camera stays frozen."""
        self._points, self._opposed = np.zeros((len(POINTS), 2, 2)), 0.0
        self._areas: list[dict[str, tuple[float, ...]]] = [{} for _ in CAMERAS]
        self._fits: list[GripperFit | None] = [None for _ in CAMERAS]
        self._objects: list[MarkPart | None] = [None for _ in CAMERAS]

    def copy(self) -> Self:
        """One that remembers the same, and goes on by itself."""
        other = copy.copy(self)
        other._cameras = copy.deepcopy(self._cameras)
        other._points, other._areas = self._points.copy(), [dict(areas) for areas in self._areas]
        other._fits, other._objects = list(self._fits), list(self._objects)
        return other

    def __call__(self, left: Image, right: Image, moved: bool = False) -> tuple[Array, NDArray[np.bool_]]:
        """The points in a pair of images, and which of them are seen.

        Args:
            left: RGB (h, w, 3), uint8, of any size. OpenCV gives BGR: turn its last axis round.
            right: As `left`; it may have another size.
            moved: As of `StereoTracker`.

        Returns:
            Image points (18, 2), left and right of each of `POINTS`, in units as of `StereoTracker`; and
            flags (18,). A point that is not seen stands where it was seen last, at first at the centre.

        Raises:
            ValueError: An image is no such array.
        """
        check_images(left, right)
        return self._track((left, right), self._cameras((left, right), moved))

    @staticmethod
    def track(trackers: Sequence[GraspTracker], pairs: Sequence[Pair]) -> tuple[Array, NDArray[np.bool_]]:
        """As `StereoTracker.track`: points (n, 18, 2) and flags (n, 18)."""
        found = [each._track(pair, (False, False)) for each, pair in zip(trackers, pairs, strict=True)]
        return np.array([points for points, _ in found]), np.array([seen for _, seen in found])

    def _track(self, pair: Pair, frozen: tuple[bool, ...]) -> tuple[Array, NDArray[np.bool_]]:
        visible = np.zeros((len(POINTS), 2), bool)
        axes = np.zeros((2, 2))
        for camera, image in enumerate(pair):
            if frozen[camera]:
                continue
            scale = np.array([image.shape[1], image.shape[0]]) / 2
            visible[:, camera], axes[camera] = self._look(image, camera, scale)
        self._place_ends(axes, visible)
        points = self._points * np.array([proportions(image) for image in pair])
        return points.reshape(-1, 2), visible.ravel()

    def _look(self, image: Image, camera: int, scale: Array) -> tuple[NDArray[np.bool_], Array]:
        """Updates what is seen in one camera's image: flags (9,), and the object's main axis (2,)."""
        points, seen = self._points[:, camera], np.zeros(len(POINTS), bool)
        parts = self._parts(image, camera)
        fit = fit_gripper(parts, scale, self._layout, self._fits[camera])
        if fit is not None:
            self._fits[camera] = fit
            points[_GRIPPER][fit.seen], seen[_GRIPPER] = fit.points[fit.seen], fit.seen
        shown = whole(parts.pop("object"))
        if shown is None:
            return seen, np.zeros(2)
        hiders = _covered(image.shape[:2], parts)
        object_ = self._objects[camera] = completed(shown, self._objects[camera], scale, hiders)
        points[_OBJECT], seen[_OBJECT] = object_.middle / scale - 1, True
        return seen, np.zeros(2) if object_.radius else object_.axis / scale

    def _parts(self, image: Image, camera: int) -> dict[str, list[MarkPart]]:
        """What is seen of the marks in one camera's image."""
        areas = self._areas[camera]
        parts = {}
        for name, blobs in find_blobs(image, self._table, self._table.names, LARGEST, filled=0.0).items():
            found = find_parts(blobs, getattr(self.marks, name))
            area, last = sum(part.area for part in found), areas.get(name, ())
            areas[name] = (*last[1 - LOOKS :], area)
            parts[name] = found if area >= LEAST_SEEN * max(last, default=0.0) else []
        return parts

    def _place_ends(self, axes: Array, visible: NDArray[np.bool_]) -> None:
        """Puts the ends of the object's axis, which are the same ends in both images.

        Args:
            axes: In each image (2, 2); of either sign.
            visible: Which points (9, 2) are seen; those of the ends are added.
        """
        gripper = [(_EDGE_1, _EDGE_2), (_JAW_1, _JAW_2), (_BASE, _TIP)]
        before = self._points[_END_1] - self._points[_END_2]
        axes *= np.where((axes * before).sum(1, keepdims=True) < 0, -1, 1)
        if visible[_OBJECT].all() and all(visible[list(pair)].all() for pair in gripper):
            directions = np.stack([(self._points[a] - self._points[b]).ravel() for a, b in gripper], 1)
            errors = [_unlikely(directions, np.concatenate([axes[0], sign * axes[1]])) for sign in (1, -1)]
            self._opposed = REMEMBERED * self._opposed + errors[0] - errors[1]
            if self._opposed > 0:
                axes[1], self._opposed = -axes[1], -self._opposed
        for camera in np.flatnonzero(visible[_OBJECT]):
            for end, sign in ((_END_1, 1), (_END_2, -1)):
                self._points[end, camera] = self._points[_OBJECT, camera] + sign * axes[camera]
                visible[end, camera] = True


def _covered(size: tuple[int, ...], parts: dict[str, list[MarkPart]]) -> Image:
    """1 where parts cover an image (h, w), and near them, and 0 elsewhere."""
    covered = np.zeros(size, np.uint8)
    for part in chain(*parts.values()):
        (x, y), (height, width) = part.corner.astype(int), part.shares.shape
        covered[y : y + height, x : x + width] |= part.shares > 0
    return np.asarray(cv2.dilate(covered, np.ones((NEAR, NEAR), np.uint8)))


def _unlikely(directions: Array, axis: Array) -> float:
    """How unlikely an axis (4,) in both images is, for a gripper whose directions are seen so (4, 3).

    No combination of them explains a wrong one, or only one of a thing that is far longer than a gripper.
    """
    covariance = ERROR**2 * np.eye(4) + SIZE**2 * directions @ directions.T
    return float(axis @ np.linalg.solve(covariance, axis))
