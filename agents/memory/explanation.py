"""What has changed? The change of cameras or arm by which what was known explains best what is seen since.

Pure functions of the views before the change, the pairs seen since, and the cameras that show it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calfree_gym.image import IMAGE_UNIT, rounded

from ..base.observation import Array
from ..base.weights import huber_weights
from .camera_change import HUBER, CameraChange, coordinate_variance, fit_camera
from .pairs import Cameras, Pairs
from .remembered import PRIOR_STD, ArmChange, Remembered

Changes = Sequence[CameraChange] | Sequence[ArmChange]

ITERATIONS = 8
"""Gauss-Newton steps (a guard: more change nothing)."""
LEAST_SCALE = 0.1
"""Guard: a motor's scale is no smaller, so that it can be undone."""


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


def fit_arm(before: Remembered, since: Pairs) -> ArmChange:
    """Fits what has become of the arm; no motor has changed its sign, or one has.

    Args:
        before: What was known before the change.
        since: What was seen since.
    """
    motors = before.motors
    signs = [np.ones(motors), *(np.ones(motors) - 2 * np.eye(motors))]
    fits = [_fit(before, since, each) for each in signs]
    scale, offset, _ = min(fits, key=lambda fit: rounded(fit[2]))
    errors, *_ = _errors(before, since, scale, offset)
    correction = len(errors) / max(len(errors) - motors, 1)
    deviation_px = np.sqrt([coordinate_variance(camera) * correction for camera in errors.swapaxes(0, 1)])
    return ArmChange(scale, offset, deviation_px / IMAGE_UNIT)


def _fit(before: Remembered, since: Pairs, signs: Array) -> tuple[Array, Array, float]:
    """Scales (m,) of these signs, offsets (m,), and how badly they fit: robust Gauss-Newton steps."""
    motors, prior = len(signs), np.concatenate([signs, np.zeros(len(signs))])
    parameters, best = prior, (signs, np.zeros(len(signs)), np.inf)
    for _ in range(ITERATIONS):
        scale, offset = parameters[:motors], parameters[motors:]
        scale = signs * np.maximum(signs * scale, LEAST_SCALE)
        errors, variances, slopes = _errors(before, since, scale, offset)
        sizes = np.hypot(errors[..., 0], errors[..., 1]) / np.sqrt(variances)
        weights = huber_weights(sizes, HUBER) / variances
        apart = parameters - prior
        misfit = (np.minimum(sizes, HUBER) * sizes + np.log(variances)).sum()
        badness = float(misfit + apart @ apart / PRIOR_STD**2)
        if badness < best[2]:
            best = scale, offset, badness
        weighed = slopes * weights[..., None, None]
        normal = np.einsum("kpci,kpcj->ij", weighed, slopes) + np.eye(2 * motors) / PRIOR_STD**2
        step = np.linalg.solve(normal, np.einsum("kpci,kpc->i", weighed, errors) - apart / PRIOR_STD**2)
        parameters = np.concatenate([scale, offset]) + step
    return best


def _errors(before: Remembered, since: Pairs, scale: Array, offset: Array) -> tuple[Array, Array, Array]:
    """How far gripper and object are seen from where they should be (k, 2, 2).

    The object's home view was another one from where home was before.

    Returns:
        Those errors, their variances (k, 2), and how points change with scales and offsets (k, 2, 2, 2 m).
    """
    old, home = (since.registers - offset) / scale, -offset / scale
    errors, variances, slopes = before.gripper_errors(since, old)
    moved = _by_parameters(slopes, old, scale)
    shown = since.with_object
    seen, at_home = since.only(shown), replace(since.only(shown), objects=since.homes[shown])
    off, off_variances, slopes = before.object_errors(seen, old[shown])
    homes, _, home_slopes = before.object_errors(at_home, np.tile(home, (len(seen), 1)))
    off_moved = _by_parameters(slopes, old[shown], scale) - _by_parameters(home_slopes, home, scale)
    return (
        np.concatenate([errors, off - homes]),
        np.concatenate([variances, off_variances]),
        np.concatenate([moved, off_moved]),
    )


def _by_parameters(slopes: Array, old: Array, scale: Array) -> Array:
    """Derivatives by scales and offsets (k, 2, 2, 2 m), from those by the old registers (k, 2, 2, m)."""
    return np.concatenate([slopes * -(np.atleast_2d(old) / scale)[:, None, None], slopes * -(1 / scale)], 3)
