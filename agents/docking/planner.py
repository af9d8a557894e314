"""Which arcs bring marks to where they are to be seen, by a projective model: least squares."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calfree_gym.image import IMAGE_UNIT, RANK_OF_SQUARES, rounded

from ..base.observation import Array
from .least_squares import Quadratic, least
from .projective_model import FARTHEST, NEAREST, ProjectiveModel, homogeneous, projected


class Plan(NamedTuple):
    """Arcs, and where they lead.

    Attributes:
        words: Of each arc (a, m).
        left_px: How far the farthest mark is then expected from its goal, as wheels slip on the last arc.
    """

    words: Array
    left_px: float


class Planner:
    """Plans the fewest arcs that are expected to arrive.

    Only so a robot arrives that plans anew after each arc: with as many arcs as are allowed it would always
    put the last one off.

    Attributes:
        limits: Within these marks are to stay (p, 2), in image units.

    Args:
        edges: How far images reach (p, 2), in image units.
        rng: Draws what plans begin with.
    """

    STARTS = (3, 8, 14, 20)
    """With so many plans of one arc, two, three, four it begins. Choice."""
    ROUNDS = 10
    """Of Levenberg and Marquardt's method. Choice."""
    ENOUGH_PX = 2.0
    """So near a plan arrives. Choice: within the usual tolerance of 2.5 px."""
    NEARLY, WORTH = 3.0, 1.5
    """Within so many times that, a plan nearly arrives. Then arcs are worth it that leave less than fewer by
    this factor. Choice: else, by a model that is a little off, it would never make the last one."""
    SPREAD_PX = 100.0
    """So far, in each direction, arcs that plans begin with move images. Choice: a fifth of an image."""
    EFFORT_PX = 1.0
    """A word of 1 costs as much as a coordinate that is so far off. Choice: the shorter of equal plans."""
    INSIDE = 5.0
    """A coordinate outside the images counts as much as one so many times as far off its goal. Choice."""
    BORDER = 0.95
    """Marks are to stay within this part of the images on their way. Choice: as in other servos."""
    STEP = 1e-6
    """Of numerical derivatives (a guard)."""

    def __init__(self, edges: Array, rng: np.random.Generator) -> None:
        self.limits, self._rng = self.BORDER * edges, rng

    def plan(self, model: ProjectiveModel, points: Array, goal: Array, rest: Array | None) -> Plan:
        """The fewest arcs expected to bring image points (p, 2) to a goal (p, 2); at most four.

        Args:
            model: What words do.
            points: Where marks are seen now.
            goal: Where they are to be seen.
            rest: Words (a, m) that are left of an earlier plan.
        """
        motors = model.motors
        spread, plans = self._spread(model, points), list[Plan]()
        for arcs, starts in enumerate(self.STARTS, 1):
            words = self._rng.standard_normal((starts, arcs, motors)) @ spread
            if rest is not None and len(rest) == arcs:
                words[0] = rest
            if plans:
                words[-1] = _split(plans[-1].words)
            plans.append(self._refined(model, points, goal, np.clip(words, -1, 1)))
            if plans[-1].left_px < self.ENOUGH_PX:
                break
        least = min(plan.left_px for plan in plans)
        most = max(self.WORTH * least, self.ENOUGH_PX) if least < self.NEARLY * self.ENOUGH_PX else least
        return next(plan for plan in plans if plan.left_px <= most)

    def _spread(self, model: ProjectiveModel, points: Array) -> Array:
        """The square root (m, m) of the covariance of words that move images as far in all directions."""
        motors = model.motors
        ways = self.STEP * np.eye(motors)
        moved = projected(model.transforms(ways) @ homogeneous(points)) - points
        slopes = moved.reshape(motors, -1) / self.STEP
        squares, vectors = np.linalg.eigh(slopes @ slopes.T / len(points))
        squares = np.maximum(squares, RANK_OF_SQUARES * squares[-1])
        return np.asarray(vectors * (self.SPREAD_PX * IMAGE_UNIT / np.sqrt(squares)) @ vectors.T)

    def _refined(self, model: ProjectiveModel, points: Array, goal: Array, words: Array) -> Plan:
        starts, arcs, motors = words.shape

        def near(places: Array) -> Quadratic:
            values, slopes = self._values(model, points, goal, places.reshape(-1, arcs, motors))
            gradient = (slopes @ values[..., None])[..., 0]
            return Quadratic((values**2).sum(1), gradient, slopes @ slopes.swapaxes(1, 2))

        found = least(near, words.reshape(starts, -1), self.ROUNDS, self.ENOUGH_PX**2, 1.0)
        best = found.places[found.costs.argmin()].reshape(1, arcs, motors)
        values = self._values(model, points, goal, best)[0][0]
        off_and_slips = values[: (1 + motors) * goal.size].reshape(-1, *goal.shape)
        return Plan(best[0], float(np.sqrt((off_and_slips**2).sum((0, 2)).max())))

    def _values(
        self, model: ProjectiveModel, points: Array, goal: Array, words: Array
    ) -> tuple[Array, Array]:
        """What is to be least (s, n), in pixels, and its derivatives by words (s, a m, n).

        That is how far marks end off the goal, how far slip of each motor on the last arc shifts them, how
        far they are outside the limits on their way, and effort. Of slip the derivatives are those of the
        last arc alone, as if it moved marks in proportion.
        """
        starts, arcs, motors = words.shape
        size = arcs * motors
        varied = words[:, :, None] + np.concatenate([np.zeros((1, motors)), self.STEP * np.eye(motors)])
        transforms = model.transforms(varied)
        columns = np.broadcast_to(homogeneous(points), (starts, len(points), 3, 1))
        moved = np.zeros((starts, size, len(points), 3, 1))
        outside, outside_slopes = [], []
        for arc in range(arcs):
            here = transforms[:, arc, :1]
            own = slice(arc * motors, (arc + 1) * motors)
            moved[:, : own.start] = here @ moved[:, : own.start]
            moved[:, own] = (transforms[:, arc, 1:] - here) @ columns[:, None] / self.STEP
            columns = here[:, 0] @ columns
            depth = np.maximum(columns[..., 2:, 0], NEAREST)
            seen = columns[..., :2, 0] / depth
            deeper = moved[..., 2:, 0] * (columns[..., 2:, 0] > NEAREST)[:, None]
            slopes = (moved[..., :2, 0] - seen[:, None] * deeper) / depth[:, None]
            slopes = slopes * (np.abs(seen) < FARTHEST)[:, None]
            seen = np.clip(seen, -FARTHEST, FARTHEST)
            beyond = self.INSIDE * np.maximum(np.abs(seen) - self.limits, 0)
            outside.append(beyond)
            outside_slopes.append(self.INSIDE * (np.sign(seen) * (beyond > 0))[:, None] * slopes)
        by_last = model.SLIP * slopes[:, -motors:]
        slips = (words[:, -1, :, None, None] * by_last).reshape(starts, -1, 2)
        of_slips = np.zeros((starts, size, motors, *points.shape))
        of_slips[:, -motors:][:, range(motors), range(motors)] = by_last
        of_slips = of_slips.reshape(starts, size, -1, 2)
        values = np.concatenate([seen - goal, slips, *outside], 1).reshape(starts, -1) / IMAGE_UNIT
        derivatives = np.concatenate([slopes, of_slips, *outside_slopes], 2)
        derivatives = derivatives.reshape(starts, size, -1) / IMAGE_UNIT
        effort = self.EFFORT_PX * words.reshape(starts, size)
        of_effort = np.broadcast_to(self.EFFORT_PX * np.eye(size), (starts, size, size))
        return np.concatenate([values, effort], 1), np.concatenate([derivatives, of_effort], 2)


def _split(words: Array) -> Array:
    """The same way (a + 1, m), its longest arc in two halves."""
    longest = int(rounded(np.abs(words).max(1)).argmax())
    halves = np.insert(words, longest, words[longest], 0)
    halves[longest : longest + 2] /= 2
    return halves
