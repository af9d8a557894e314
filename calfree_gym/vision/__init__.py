"""The stereo cameras, the measurement of image points, and a tracker that finds them in images.

`StereoTracker`, `Marks` and `Mark` need OpenCV, which is loaded when they are asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from calfree_gym.vision.marks import Mark, Marks
    from calfree_gym.vision.tracking.tracker import StereoTracker

__all__ = ["Mark", "Marks", "StereoTracker"]

_HOMES = {
    "Mark": "calfree_gym.vision.marks",
    "Marks": "calfree_gym.vision.marks",
    "StereoTracker": "calfree_gym.vision.tracking.tracker",
}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
