"""What has changed? The change of cameras or arm by which what was known explains best what is seen since.

Pure functions of the views before the change, the pairs seen since, and the cameras that show it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calfree_gym.image import rounded

from ..base.observation import Array
from .arm_change import ArmChange, fit_arm
from .camera_change import CameraChange, fit_camera
from .pairs import Cameras, Pairs
from .remembered import Remembered

Changes = Sequence[CameraChange] | Sequence[ArmChange]


@dataclass(frozen=True)
class Explanation:
    """What has changed, as far as it is understood.

    Attributes:
        kind: What has been done.
        changes: Of each camera that changed, or one of the arm; none where nothing explains what is seen.
        known: What is then known of the present world, without what was seen since.
    """

    kind: str
    changes: Changes
    known: Remembered

    @classmethod
    def by(cls, before: Remembered, changes: Changes, since: Pairs) -> Explanation:
        """That by changes, at least one; what was seen of the object tells how well they hold for it."""
        known = before.copy()
        known.map(changes)
        away = since.registers.any(1)
        errors, variances, _ = known.object_errors(since.only(since.with_object & away))
        if len(errors):
            off = np.square(errors).mean((0, 2)) - variances.mean(0)
            known.object.doubt(np.sqrt(np.maximum(off, 0.0)))
        return cls(changes[0].kind, changes, known)

    def odds(self, since: Pairs) -> float:
        """The logarithm of how probable what was seen since is, less for each parameter (Schwarz 1978)."""
        parameters = sum(change.parameters for change in self.changes)
        prior = sum(change.log_prior for change in self.changes)
        return self.known.evidence(since) + prior - parameters / 2 * float(np.log(since.sensors.size))


def explain_jump(before: Remembered, since: Pairs, cameras: Cameras, may_discard: bool) -> Explanation:
    """Explains a jump by a change of the cameras (2,) that show it, of the arm, or by nothing known before.

    Args:
        before: What was known before.
        since: What was seen since.
        cameras: Those that show it.
        may_discard: Whether it may be that nothing explains it.
    """
    explanations = [
        Explanation.by(before, _camera_changes(before, since, cameras), since),
        Explanation.by(before, [fit_arm(before, since)], since),
    ]
    if may_discard:
        kind = "replaced" if cameras.sum() == 1 else "unknown"
        explanations.append(Explanation(kind, (), before.nothing()))
    return max(explanations, key=lambda each: rounded(each.odds(since)))


def since_mid_trial(before: Remembered, pairs: Pairs, first: int, cameras: Cameras) -> Pairs | None:
    """The pairs since a change in mid-trial; None where those before `first` are rather no older than it.

    The gripper tells: where home would show the object after the change nobody knows.

    Args:
        before: What was known before the change.
        pairs: Of one trial, in which home was seen as ever.
        first: The first of them that shows the change.
        cameras: Those (2,) that show it.
    """
    if not first:
        return None
    seen, later = pairs.without_objects(), np.arange(len(pairs)) >= first
    earlier, since = seen.only(~later), seen.only(later)
    apart = before.evidence(earlier) + explain_jump(before, since, cameras, True).odds(since)
    return since if apart > explain_jump(before, seen, cameras, True).odds(seen) else None


def explain_drift(before: Remembered, recent: Pairs, cameras: Cameras) -> Explanation:
    """Explains a drift by a change of the cameras (2,) that show it."""
    return Explanation.by(before, _camera_changes(before, recent, cameras), recent)


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


def _camera_changes(before: Remembered, pairs: Pairs, cameras: Cameras) -> list[CameraChange]:
    function = before.gripper.function
    return [fit_camera(function, int(camera), pairs) for camera in np.flatnonzero(cameras)]
