"""The stereo cameras, the measurement of image points, and trackers that find them in images.

`StereoTracker` with its `Marks`, `TagTracker`, and `GraspTracker` with its `GraspMarks` need OpenCV, which is
loaded when they are asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from calfree_gym.vision.marks import GraspMarks, Mark, Marks
    from calfree_gym.vision.tracking.grasp_tracker import GraspTracker
    from calfree_gym.vision.tracking.tag_tracker import TagTracker
    from calfree_gym.vision.tracking.tracker import StereoTracker

__all__ = ["GraspMarks", "GraspTracker", "Mark", "Marks", "StereoTracker", "TagTracker"]

_HOMES = {
    "GraspMarks": "calfree_gym.vision.marks",
    "GraspTracker": "calfree_gym.vision.tracking.grasp_tracker",
    "Mark": "calfree_gym.vision.marks",
    "Marks": "calfree_gym.vision.marks",
    "StereoTracker": "calfree_gym.vision.tracking.tracker",
    "TagTracker": "calfree_gym.vision.tracking.tag_tracker",
}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
