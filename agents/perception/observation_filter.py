"""Looks that can be trusted, from image points that may be noisy, mistaken, missing or late.

One mechanism for all servos. A look that comes out as expected is taken at once. Where a point is not seen,
or is not where it is expected, or where nothing moved at all, the robot looks again (zero words: a motion,
and counted) until looks agree. From looks at one place it also learns how noisy, how gappy and how late they
are; nobody tells it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Generator

import numpy as np

from agents.base.agent import Array, Look
from agents.jacobian import NOISE_PX, Flags, both_points
from calfree_gym.image import IMAGE_UNIT

Looking = Generator[Array, Look, Look]
"""Yields zero words, is sent what was seen, returns a look that can be trusted."""

NONE = np.zeros(4, bool)
SMALL_SHARE = 0.15
SMALL = 0.189
"""This share of normal deviates is smaller: so few that four in ten mistaken points hardly matter."""


class Senses:
    """What a robot has learned of its looks in a trial.

    Attributes:
        noise_px: Standard deviation of an image coordinate.
        late: By how many motions looks come late.
        surprising: Which points (4,) were last believed although they were not where they were expected.
    """

    GATE_PX, UNKNOWN_GATE_PX = 30.0, 50.0
    """So near a point must be to where it is expected: after a motion that J predicts, and after another."""
    WARY_GATE_PX = 15.0
    """The first where points are known to be mistaken at times: another look costs less than a mistake."""
    GATE_SHARE = 0.6
    """And within this share of the predicted displacement beside."""
    AGREE_PX = 6.0
    LOOKS = 8
    PATIENCE = 4
    """Where points are known to be missing at times, one that was not seen for more looks is lost."""
    NOISY_PX = 3.0
    """Noise that is worth knowing well: more looks are taken, up to `ENOUGH` differences."""
    ENOUGH = 24

    def __init__(self) -> None:
        self.noise_px = NOISE_PX
        self.late = 0
        self.surprising = NONE
        self._prompt = False
        self._gaps = False
        self._mistakes = False
        self._unseen = np.zeros(4, int)
        self._last: Look | None = None
        self._differences: deque[Array] = deque(maxlen=40)

    def first(self, look: Look) -> Looking:
        """Looks again until every point has been seen."""
        points, found = _points(look).copy(), look.visible
        self._note(look)
        for _ in range(self.LOOKS):
            if found.all():
                break
            look = yield np.zeros(len(look.registers))
            self._note(look)
            new = look.visible & ~found
            points[new] = _points(look)[new]
            found = found | new
        return look.believed(points.ravel(), found)

    def settle(self, look: Look, before: Look, moved: Array, known: Flags) -> Looking:
        """Looks again until the look after a motion can be trusted.

        Args:
            look: The look after the motion.
            before: The trusted look before it.
            moved: Displacement (8,) that is expected of the points.
            known: For which points (4,) that rests on motions like this one.

        Returns:
            A look whose points are those believed; not visible where there was nothing to believe.
        """
        self._note(look)
        start = _points(before)
        expected = start + moved.reshape(4, 2)
        far = _lengths_px(expected - start)
        narrow = self.WARY_GATE_PX if self._mistakes else self.GATE_PX
        gate = np.where(known, narrow, self.UNKNOWN_GATE_PX) + self.GATE_SHARE * far
        if self._as_expected(look, expected, far, gate):
            self.surprising = NONE
            return look
        looks = yield from self._in_time(look, start, np.where(known, far, np.nan))
        while True:
            points, found, self.surprising = self._believe(looks, expected, gate)
            if len(looks) == self.LOOKS or not self._worth_another(looks, found, known):
                return looks[-1].believed(points.ravel(), found)
            looks.append((yield np.zeros(len(look.registers))))
            self._note(looks[-1])

    def _as_expected(self, look: Look, expected: Array, far: Array, gate: Array) -> bool:
        """Whether a look came in time, and all is seen and near where it is expected."""
        if self.late or not self._prompt or not look.visible.all():
            return False
        off = _lengths_px(_points(look) - expected)
        farthest = far.argmax()
        in_time = far[farthest] < 6 + 8 * self.noise_px or off[farthest] < 0.8 * far[farthest]
        return bool(in_time and (off <= gate + 4 * self.noise_px).all())

    def _in_time(self, look: Look, start: Array, far: Array) -> Generator[Array, Look, list[Look]]:
        """The look, or one more where that only shows what was before the motion."""
        still = np.zeros(len(look.registers))
        for _ in range(self.late):
            look = yield still
        if self.noise_px > self.NOISY_PX or not look.visible.any():
            return [look]
        limit = 1.5 + 2 * self.noise_px
        moved = np.where(look.visible, _lengths_px(_points(look) - start), 0.0)
        if np.count_nonzero(moved > 1.8 * limit) > 1:
            self._prompt = True
        elif not self._prompt or moved.max() < limit < np.nanmax(far, initial=0.0) / 4:
            later = yield still
            more = (_lengths_px(_points(later) - _points(look)) > 1.5 * limit) | ~later.visible
            if np.count_nonzero(more & look.visible) > 1:
                self.late += 1
                return [later]
            self._prompt |= moved.max() > limit
            return [look, later]
        return [look]

    def _believe(self, looks: list[Look], expected: Array, gate: Array) -> tuple[Array, Flags, Flags]:
        """Points (4, 2) as believed, which of them (4,) there is reason to believe, and which surprise."""
        gate = gate + 4 * self.noise_px
        if len(looks) == 1:
            seen = _points(looks[0])
            found = looks[0].visible & (_lengths_px(seen - expected) <= gate)
            return np.where(found[:, None], seen, expected), found, np.zeros(4, bool)
        points, found, surprising = expected.copy(), np.zeros(4, bool), np.zeros(4, bool)
        agree = max(self.AGREE_PX, 4 * np.sqrt(2) * self.noise_px)
        for i in range(4):
            seen = np.array([_points(look)[i] for look in looks if look.visible[i]]).reshape(-1, 2)
            near = seen[_lengths_px(seen - expected[i]) <= gate[i]]
            if len(near):
                points[i], found[i] = np.median(near, 0), True
            elif len(seen) > 1:
                friends = _lengths_px(seen[:, None] - seen[None]) <= agree
                best = friends.sum(1).argmax()
                if friends[best].sum() > 1:
                    points[i], found[i], surprising[i] = seen[friends[best]].mean(0), True, True
            self._mistakes |= bool(found[i] and (_lengths_px(seen - points[i]) > 2 * agree).any())
        return points, found, surprising

    def _worth_another(self, looks: list[Look], found: Flags, known: Flags) -> bool:
        """Whether one more look at this place may show what is not yet believed."""
        seen = np.array([look.visible for look in looks]).any(0)
        return bool((~found & (seen | (~self.lost & ~(known & self._gaps)))).any())

    @property
    def lost(self) -> Flags:
        """Which points (4,) have not been seen for so long that they must be out of view."""
        return self._unseen > (self.PATIENCE if self._gaps else 1)

    @property
    def curious(self) -> bool:
        """Whether it is worth looking again only to learn how noisy looks are."""
        return self.noise_px > self.NOISY_PX and sum(map(len, self._differences)) < self.ENOUGH

    def _note(self, look: Look) -> None:
        """Learns how noisy looks are where this is one more at the place of the last."""
        last, self._last = self._last, look
        self._unseen = np.where(look.visible, 0, self._unseen + 1)
        if last is None or (look.registers != last.registers).any():
            return
        self._gaps |= bool((last.visible != look.visible).any())
        seen = last.visible & look.visible
        self._differences.append(np.abs(_points(look) - _points(last))[seen].ravel() / IMAGE_UNIT)
        pool = np.concatenate(self._differences) / np.sqrt(2)
        if len(pool) >= 24:
            noise = np.quantile(pool, SMALL_SHARE) / SMALL
            for _ in range(3):
                near = pool[pool <= 3 * noise]
                noise = np.sqrt(near @ near / len(near))
            self.noise_px = float(np.clip(noise, 0.5, 40.0))


def _points(look: Look) -> Array:
    return both_points(look).reshape(4, 2)


def _lengths_px(vectors: Array) -> Array:
    return np.hypot(vectors[..., 0], vectors[..., 1]) / IMAGE_UNIT
