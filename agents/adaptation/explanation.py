"""What has changed? The change of cameras or arm by which what was known best predicts what is seen since.

Pure functions of the views before the change, the pairs seen since, and the cameras that show it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..base.observation import Array
from ..servo.smooth_function import SmoothFunction
from .arm_change import ArmChange, fit_arm
from .camera_change import CameraChange, fit_camera
from .home_view import Cameras
from .pairs import Pairs

DISCARD_PX = 40.0
"""Where the best explanation is off by more, it is better to start empty. Tuned (wild worlds 3000-)."""

Changes = Sequence[CameraChange] | Sequence[ArmChange]


@dataclass(frozen=True)
class Explanation:
    """What has changed, as far as it is understood.

    Attributes:
        changes: Of each camera that changed, or one of the arm.
        one_camera: Whether only one camera shows the change.
    """

    changes: Changes
    one_camera: bool

    @property
    def deviation_px(self) -> float:
        """How far off the changes are, in the worst camera, in pixels."""
        return _deviation_px(self.changes)

    @property
    def convinces(self) -> bool:
        """Whether what was known is better mapped by it than discarded."""
        return self.deviation_px <= DISCARD_PX

    def kind(self, discarded: bool) -> str:
        """What has been done: the kind of the first change; a camera that nothing explains was replaced."""
        return "replaced" if discarded and self.one_camera else self.changes[0].kind


def explain_jump(before: SmoothFunction, since: Pairs, cameras: Cameras) -> Explanation:
    """Explains a jump by a change of the cameras (2,) that show it or of the arm, whichever fits better.

    Two cameras rarely change at once: where both show it, the arm may be off by twice as much as they.
    """
    changed = _camera_changes(before, since, cameras)
    arm = [fit_arm(before, since)]
    arm_fits_better = _deviation_px(arm) < len(changed) * _deviation_px(changed)
    return Explanation(arm if arm_fits_better else changed, len(changed) == 1)


def explain_drift(before: SmoothFunction, recent: Pairs, cameras: Cameras) -> Explanation:
    """Explains a drift by a change of the cameras (2,) that show it."""
    return Explanation(_camera_changes(before, recent, cameras), int(cameras.sum()) == 1)


def as_seen_now(pairs: Pairs, cameras: Cameras, rate: Array, now: int) -> Pairs:
    """Pairs of the latest trials, moved to where a drift would show them now.

    Args:
        pairs: The pairs.
        cameras: The cameras (2,) that drift.
        rate: How far home moves per trial (4,), in image units.
        now: The number of the present trial.
    """
    moved = np.outer(now - pairs.trials, np.where(cameras.repeat(2), rate, 0.0))
    return replace(
        pairs, sensors=pairs.sensors + moved, objects=pairs.objects + moved, homes=pairs.homes + moved
    )


def _camera_changes(before: SmoothFunction, pairs: Pairs, cameras: Cameras) -> list[CameraChange]:
    return [fit_camera(before, int(camera), pairs) for camera in np.flatnonzero(cameras)]


def _deviation_px(changes: Changes) -> float:
    return max(float(change.deviation_px.max()) for change in changes)
