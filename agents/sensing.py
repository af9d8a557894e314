"""Looks that can be trusted, from image points that may be noisy, mistaken, missing or late.

One mechanism for all servos. A look that comes out as expected is taken at once. Where a point is not seen, or
not where the Jacobian expects it, or where nothing moved at all, the robot looks again (zero words: a motion,
and counted) until looks agree. From looks at one place it also learns how noisy, how gappy and how late they
are; nobody tells it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from agents.agent import Array, Look
from agents.jacobian import both_points
from calfree_gym.world import IMAGE_UNIT

QUARTER = 0.3186
"""A quarter of all normal deviates are smaller than this."""


class Senses:
    """What a servo believes of its four image points during a trial.

    Attributes:
        noise_px: Standard deviation of an image coordinate, as estimated.
        late: Motions by which looks are known to come late.
        jumped: Which points (4,) stood, at the last motion, where nothing that is known explains.
    """

    GATE_PX = 30.0
    UNKNOWN_GATE_PX = 50.0
    AGREE_PX = 6.0
    LOOKS = 8

    def __init__(self, look: Look) -> None:
        self.noise_px = 0.7
        self.late = 0
        self.gaps = False
        self.mistakes = 0
        self.prompt = False
        self.jumped = np.zeros(4, bool)
        self._variance = np.full(4, 1.0)
        self._differences: list[Array] = []
        self._history = [(look.registers, both_points(look), np.repeat(look.visible, 2))]
        self.stats = {"looks": 0, "why": []}

    def first(self, look: Look):
        """Looks again until every point was seen."""
        still = np.zeros(len(look.registers))
        points, found = both_points(look).reshape(4, 2).copy(), look.visible.copy()
        for _ in range(self.LOOKS):
            if found.all():
                break
            again = yield still
            new = again.visible & ~found
            self.gaps |= bool(new.any())
            points[new] = both_points(again).reshape(4, 2)[new]
            found |= new
        return replace(look, gripper=points[:2].ravel(), object=points[2:].ravel(), visible=found)

    def settle(self, look: Look, before: Look, moved: Array, known: bool):
        """Looks again until the look after a motion can be trusted.

        Args:
            look: The look after the motion.
            before: The trusted look before it.
            moved: Displacement (8,) that is expected of the points.
            known: Whether that rests on a Jacobian, or on nothing.

        Returns:
            A look whose points are the ones believed; not visible where there was nothing to believe.
        """
        expected = (both_points(before) + moved).reshape(4, 2)
        far = np.sqrt((moved.reshape(4, 2) ** 2).sum(1)) / IMAGE_UNIT
        gate = (self.GATE_PX if known else self.UNKNOWN_GATE_PX) + 0.6 * far + 4 * self.noise_px
        was_known = known
        still = np.zeros(len(look.registers))
        looks = [look]
        for _ in range(self.late):
            looks = [(yield still)]
        while True:
            points, found, plausible = self._believe(looks, expected, gate, known)
            again = ~found & self._worth_waiting(looks, expected)
            if self._nothing_moved(looks, before, look, far, known):
                latest = yield still
                if (self._moved_px(latest, looks[-1]) > 2 + 4 * self.noise_px).sum() > 1:
                    self.late += len(looks)
                    looks = [latest]
                    continue
                looks.append(latest)
                known = True
                continue
            unsure = self.noise_px > 3 and sum(map(len, self._differences)) < 64
            if not (again.any() or unsure) or len(looks) >= self.LOOKS:
                break
            self.stats["looks"] += 1
            looks.append((yield still))
            self._learn(looks)
        self.jumped = found & ~plausible & was_known
        stack = np.stack([both_points(one).reshape(4, 2) for one in looks])
        seen = np.stack([one.visible for one in looks])
        off = np.sqrt(((stack - points) ** 2).sum(2)) / IMAGE_UNIT
        self.mistakes += int((seen & found & (off > 20 + 5 * self.noise_px)).sum())
        self.prompt |= (
            bool((self._moved_px(looks[0], before) > 4 + 4 * self.noise_px).sum() > 1) and len(looks) == 1
        )
        for one in looks[self.late and -1 :] if self.late else looks:
            self._history.append((one.registers, both_points(one), np.repeat(one.visible, 2)))
        # filter
        spread = np.where(plausible & was_known, 1.0 + 0.3 * far, 1e3)
        predicted = self._variance + spread**2
        measured = self.noise_px**2 / np.maximum(self._counts, 1)
        gain = np.where(found, predicted / (predicted + measured), 0.0)
        believed = expected + gain[:, None] * (points - expected)
        self._variance = np.where(found, (1 - gain) * predicted, predicted)
        believed = np.where(found[:, None], believed, both_points(before).reshape(4, 2))
        return replace(
            looks[-1],
            gripper=believed[:2].ravel(),
            object=believed[2:].ravel(),
            visible=found,
        )

    NOISY_PX = 3.0
    CURVE = 0.3

    @property
    def noisy(self):
        return self.noise_px > self.NOISY_PX

    def fit(self, registers: Array, jacobian: Array):
        """Points (8,) and Jacobian (8, m) fitted together to all looks of the trial, near ones counting more."""
        sent = np.array([r for r, _, _ in self._history]) - registers
        seen = np.array([s for _, _, s in self._history]).astype(float)
        stack = np.array([p for _, p, _ in self._history])
        off = np.abs(sent @ jacobian.T).max(1) / IMAGE_UNIT
        near = 1 / (self.noise_px**2 + (self.CURVE * off) ** 2)
        features = np.concatenate([np.ones((len(sent), 1)), sent], 1)
        prior = np.diag([0.0, *np.full(len(registers), 1.0 / (self.noise_px / self.PRIOR_WORD) ** 2)])
        points, fitted = np.empty(8), np.empty_like(jacobian)
        guess = np.concatenate([np.zeros((8, 1)), jacobian], 1)
        for i in range(8):
            weights = near * seen[:, i]
            normal = (features.T * weights) @ features + prior
            solved = np.linalg.solve(
                normal + 1e-12 * np.eye(len(normal)), (features.T * weights) @ stack[:, i] + prior @ guess[i]
            )
            points[i], fitted[i] = solved[0], solved[1:]
        return points, fitted

    PRIOR_WORD = 0.02

    def _believe(self, looks, expected, gate, known):
        stack = np.stack([both_points(one).reshape(4, 2) for one in looks])
        seen = np.stack([one.visible for one in looks])
        off = np.sqrt(((stack - expected) ** 2).sum(2)) / IMAGE_UNIT
        good = seen & (off <= gate)
        if self.mistakes > 1 and not known:
            good &= False
        plausible = good.any(0)
        agree = max(self.AGREE_PX, 4 * np.sqrt(2) * self.noise_px)
        points, found = expected.copy(), plausible.copy()
        self._counts = good.sum(0)
        for i in range(4):
            mine = stack[seen[:, i] & (good[:, i] if plausible[i] else True), i]
            if plausible[i]:
                points[i] = np.median(mine, 0) if len(mine) > 2 else mine.mean(0)
            elif len(mine) > 1:
                apart = np.sqrt(((mine[:, None] - mine[None]) ** 2).sum(2)) / IMAGE_UNIT
                friends = (apart <= agree).sum(1)
                best = friends.argmax()
                if friends[best] > 1:
                    points[i], found[i] = mine[apart[best] <= agree].mean(0), True
                    self._counts[i] = friends[best]
        return points, found, plausible

    def _worth_waiting(self, looks, expected):
        """Which points (4,) another look may show."""
        seen = np.stack([one.visible for one in looks])
        ever = seen.any(0)
        inside = np.abs(expected).max(1) < 0.9
        if (ever & ~seen.all(0)).any():
            self.gaps = True
        patience = 5 if self.gaps else 2
        return ever | ((len(looks) <= patience) & (inside | self.gaps))

    def _nothing_moved(self, looks, before, first, far, known):
        if len(looks) > 2 or not (looks[-1].registers != before.registers).any():
            return False
        moved = self._moved_px(looks[-1], before)
        if self.noise_px > 3:
            return False
        limit = 1.5 + 2 * self.noise_px
        wanted = far.max() > 4 * limit if known else not self.prompt
        return bool(wanted and looks[-1].visible.all() and moved.max() < limit)

    def _moved_px(self, look, before):
        d = (both_points(look) - both_points(before)).reshape(4, 2)
        seen = look.visible & before.visible
        return np.where(seen, np.sqrt((d * d).sum(1)), 0.0) / IMAGE_UNIT

    def _learn(self, looks):
        last, previous = looks[-1], looks[-2]
        seen = np.repeat(last.visible & previous.visible, 2)
        difference = np.abs(both_points(last) - both_points(previous))[seen] / IMAGE_UNIT
        if len(difference):
            self._differences.append(difference)
            pool = np.concatenate(self._differences[-16:])
            if len(pool) >= 24:
                self.noise_px = min(40.0, max(0.5, float(np.quantile(pool, 0.15)) / 0.189 / np.sqrt(2)))
