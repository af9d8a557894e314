"""A gripper in one image: base, axis, line of the jaws and edge, by least squares over what is seen of it."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import permutations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import RANK, rounded
from calfree_gym.vision.tracking.outlines import Array
from calfree_gym.vision.tracking.parts import MarkPart

BEFORE = 0.1
"""Weight of the directions that were seen before, relative to a part that is seen whole. Choice: they decide
what nothing else does."""
ERROR = 0.012
"""A part so far from where the others say is half hidden, or something else; in image units. Choice: 3 px."""
AFFINE = 0.016
"""Standard deviation, in image units, by which images of a gripper's directions differ from those under
parallel rays. Choice: 4 px, a tenth of a gripper that is ten times its length away."""
OPENED = 0.5
"""Standard deviation of the logarithm of the jaws' opening, from one look to the next. Choice: it lets jaws
close within a few looks."""
OPENINGS = (0.05, 1.2)
"""Between which the opening is (a guard)."""
AMBIGUOUS = 0.5
"""A fit that is not worse by more than this may be the true one. Choice."""
STEEPEST = 2.0
"""No gripper is taken to be seen more steeply from behind (a guard)."""
ROUNDS = 6
"""Of least squares, each with weights by the errors of the one before. Choice."""
SURE = 9.0
"""A point is seen where an error of the parts grows by no more than this on the way to it. Choice: of 433
pairs of looks at a grasping gripper 98 % tell the gripper point then, to 6 px in the 95th percentile."""


class GripperLayout(NamedTuple):
    """Where on the gripper's axis its marks are, from 0 at the base, between the edges, to 1 at its point.

    The defaults were measured in rendered images of the simulator's gripper.

    Attributes:
        lower: The jaws' lower ends.
        upper: Their upper ends.
        surface: From the middle of an end, across the axis, to what is seen of it.
        line: From the axis to a jaw, where they are open, relative to the axis.
        edge: From the base to an edge, relative to the axis.
    """

    lower: float = 0.854
    upper: float = 0.438
    surface: float = 0.075
    line: float = 0.538
    edge: float = 0.489


class GripperFit(NamedTuple):
    """What is seen of a gripper in an image, in image units.

    Attributes:
        points: Tip, base, jaws 1 and 2, edges 1 and 2 (6, 2).
        seen: Which of them (6,) follow from what is seen now.
        directions: Three (3, 2): from base to tip, and half of those from jaw 2 to 1 and from edge 2 to 1.
        opening: Of the jaws, relative to the open ones, where both were seen last.
        error: How badly it fits the parts.
    """

    points: Array
    seen: NDArray[np.bool_]
    directions: Array
    opening: float
    error: float


def fit_gripper(
    parts: Mapping[str, list[MarkPart]], scale: Array, layout: GripperLayout, before: GripperFit | None
) -> GripperFit | None:
    """The gripper by its parts: each is base + share * axis ± line of the jaws, or base ± edge.

    Depth changes little along a gripper: so its image is nearly an affine one, under parallel rays. As its
    directions are at right angles in the world, two equations hold between their images, whatever the camera
    (factorization, Tomasi & Kanade 1992): they tell what is hidden. The jaws' upper ends have one colour: of
    all ways to tell them apart the one counts that fits best.

    Args:
        parts: Seen in one image, by mark; the largest first.
        scale: Half of the image's width and height in px (2,).
        layout: Where the marks are on the gripper.
        before: The fit before, if it was ever seen.

    Returns:
        It, or None where nothing is seen of it.
    """
    rows, seen = [], []
    for pair, along, across in ((("jaw_1", "jaw_2"), layout.lower, 2), (("edge_1", "edge_2"), 0.0, 3)):
        largest = max((parts[name][0].area for name in pair if parts[name]), default=0.0)
        for name, side in zip(pair, (1, -1), strict=True):
            if parts[name]:
                rows.append(_row(along, across, side))
                seen.append((parts[name][0], largest))
    uppers = parts["fingers"][:2]
    if not rows and not uppers:
        return None
    seen += [(part, uppers[0].area) for part in uppers]
    places = np.array([part.middle / scale - 1 for part, _ in seen])
    whole = np.array([(part.area / largest) ** 2 for part, largest in seen])
    square = scale / scale.mean()
    fits = [
        _fit(
            np.array(rows + [_row(layout.upper, 2, side) for side in sides]),
            places,
            whole,
            square,
            layout,
            before,
        )
        for sides in permutations((1, -1), len(uppers))
    ]
    best = min(fits, key=lambda fit: rounded(1 + fit.error))
    for other in fits:
        if other.error < best.error + AMBIGUOUS:
            best.seen[np.abs(other.points - best.points).max(1) > SURE * ERROR] = False
    return best


def _row(along: float, across: int, side: int) -> list[float]:
    """A part's place by base, axis, line and edge (4,)."""
    row = [1.0, along, 0.0, 0.0]
    row[across] += side
    return row


def _fit(
    rows: Array, places: Array, whole: Array, square: Array, layout: GripperLayout, before: GripperFit | None
) -> GripperFit:
    """The fit of parts (k, 4) to their places (k, 2), by how much of them is seen (k,).

    Gauss-Newton steps of base, axis, line, edge, and the logarithm of the opening (9,). `square` (2,) makes
    image units of both axes alike.
    """
    directions, opening, weight = np.zeros((3, 2)), 1.0, 0.0
    if before is not None:
        directions, opening, weight = before.directions, before.opening, BEFORE
    known = np.concatenate([np.zeros(2), directions.ravel(), [np.log(opening)]])
    remembers = np.diag([0.0] * 2 + [np.sqrt(weight) / ERROR] * 6 + [1 / OPENED])
    ends, state, weights = rows[:, 1] > 0, known, whole
    for _ in range(ROUNDS):
        shares = rows[:, 1] + ends * layout.surface * _slant(state, square, layout)
        shown = np.column_stack([rows[:, 0], shares, rows[:, 2:]])
        parts = np.pad(np.kron(shown, np.eye(2)), ((0, 0), (0, 1)))
        trust = np.sqrt(weights).repeat(2)[:, None] / ERROR
        angles, slopes = _right_angles(state, square, layout)
        matrix = np.concatenate([trust * parts, slopes / AFFINE, remembers])
        left = np.concatenate(
            [trust[:, 0] * (places.ravel() - parts @ state), -angles / AFFINE, remembers @ (known - state)]
        )
        state = state + np.linalg.lstsq(matrix, left, rcond=RANK)[0]
        state[8] = np.clip(state[8], *np.log(OPENINGS))
        errors = np.square((parts @ state).reshape(-1, 2) - places).sum(1) / ERROR**2
        weights = whole / (1 + errors)
    found, pairs = state[:8].reshape(4, 2), ((layout.lower, 2), (0.0, 3))
    jaws, edges = ([_row(along, across, side) for side in (1, -1)] for along, across in pairs)
    points = np.array([_row(1.0, 0, 0), _row(0.0, 0, 0), *jaws, *edges])
    seen = matrix[: -len(remembers)] * ERROR
    covariance = np.linalg.inv(seen.T @ seen + 1e-6 * np.eye(9))[:8, :8].reshape(4, 2, 4, 2)
    growth = np.einsum("ij,jakb,ik->i", points, covariance, points) / 2
    turned = np.square(found[1:] - directions).sum() / ERROR**2
    angles, _ = _right_angles(state, square, layout)
    error = (
        (whole * np.log1p(errors)).sum() + weight * np.log1p(turned) + np.square(angles / AFFINE).sum() / 2
    )
    both = {1, -1} <= set(rows[rows[:, 1] == layout.lower, 2])
    opening = float(np.exp(state[8])) if both else opening
    return GripperFit(points @ found, np.asarray(growth <= SURE**2), found[1:], opening, float(error))


def _of_one_length(state: Array, square: Array, layout: GripperLayout) -> tuple[Array, Array]:
    """Axis, line and edge (3, 2), as if all three were as long as the axis; and how long they are (3,)."""
    lengths = np.array([1.0, layout.line * np.exp(state[8]), layout.edge])
    return state[2:8].reshape(3, 2) * square / lengths[:, None], lengths


def _slant(state: Array, square: Array, layout: GripperLayout) -> float:
    """The cotangent of the angle at which a camera sees the axis from behind.

    Cameras that see where it grasps see it from behind. What is seen of its ends is their surface, on the
    camera's side of the axis, which in the image thereby lies farther ahead.
    """
    directions, _ = _of_one_length(state, square, layout)
    across = float(np.square(directions[0]).sum())
    whole = float(np.square(directions).sum()) / 2
    return float(min(np.sqrt(max(whole / max(across, 1e-9) - 1, 0.0)), STEEPEST))


def _right_angles(state: Array, square: Array, layout: GripperLayout) -> tuple[Array, Array]:
    """By how much two equations of right angles fail (2,) in image units, and its slopes (2, 9).

    Under parallel rays unit vectors at right angles are seen as three vectors whose first components, taken
    together, are as long as the second ones, and at right angles to them.
    """
    directions, lengths = _of_one_length(state, square, layout)
    x, y = directions.T
    size = max(float(np.sqrt((x @ x + y @ y) / 2)), 1e-9)
    angles = np.array([(x @ x - y @ y) / 2, x @ y]) / size
    slopes = np.zeros((2, 9))
    slopes[:, 2:8] = np.stack([np.stack([x, -y], 1), np.stack([y, x], 1)]).reshape(2, 6)
    slopes[:, 2:8] *= np.tile(square, 3) / (lengths.repeat(2) * size)
    slopes[:, 8] = -np.array([x[1] ** 2 - y[1] ** 2, 2 * x[1] * y[1]]) / size
    return angles, slopes
