"""A gripper in one image: base, axis, line of the jaws and edge, by least squares over what is seen of it."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import permutations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from calfree_gym.vision.tracking.outline import Array
from calfree_gym.vision.tracking.parts import Part

BEFORE = 0.1
"""Weight of the directions that were seen before, relative to a part that is seen whole. Choice: they decide
what nothing else does."""
ERROR = 0.012
"""A part so far from where the others say is half hidden, or something else; in image units. Choice: 3 px."""
ROUNDS = 4
"""Of least squares, each with weights by the errors of the one before. Choice."""
SURE = 6.0
"""A point is seen where an error of the parts grows by no more than this on the way to it. Choice: of 380
looks at a grasping gripper 98 % tell all points then, the gripper point to 5 px in the 95th percentile."""
_DIRECTIONS = np.diag([0.0, 1.0, 1.0, 1.0])


class GripperLayout(NamedTuple):
    """Where on the gripper's axis its marks are, from 0 at the base, between the edges, to 1 at its point.

    The defaults were measured in rendered images of the simulator's gripper: what is seen of the ends lies
    nearer to the tip than their middles do.

    Attributes:
        lower: The jaws' lower ends.
        upper: Their upper ends.
    """

    lower: float = 0.912
    upper: float = 0.486


class GripperFit(NamedTuple):
    """What is seen of a gripper in an image, in image units.

    Attributes:
        points: Tip, base, jaws 1 and 2, edges 1 and 2 (6, 2).
        seen: Which of them (6,) follow from what is seen now.
        directions: Three (3, 2): from base to tip, and half of those from jaw 2 to 1 and from edge 2 to 1.
        error: How badly it fits the parts.
    """

    points: Array
    seen: NDArray[np.bool_]
    directions: Array
    error: float


def fit_gripper(
    parts: Mapping[str, list[Part]], scale: Array, layout: GripperLayout, before: Array | None
) -> GripperFit | None:
    """The gripper by its parts: each is base + share * axis ± line of the jaws, or base ± edge.

    Depth changes little along a gripper: so its image is nearly an affine one. The jaws' upper ends have one
    colour: of all ways to tell them apart the one counts that fits best.

    Args:
        parts: Seen in one image, by mark; the largest first.
        scale: Half of the image's width and height in px (2,).
        layout: Where the marks are on the gripper.
        before: Its directions before (3, 2), if it was ever seen.

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
    fits = (
        _fit(np.array(rows + [_row(layout.upper, 2, side) for side in sides]), places, whole, layout, before)
        for sides in permutations((1, -1), len(uppers))
    )
    return min(fits, key=lambda fit: fit.error)


def _row(along: float, across: int, side: int) -> list[float]:
    """A part's place by base, axis, line and edge (4,)."""
    row = [1.0, along, 0.0, 0.0]
    row[across] += side
    return row


def _fit(rows: Array, places: Array, whole: Array, layout: GripperLayout, before: Array | None) -> GripperFit:
    """The fit of parts (k, 4) to their places (k, 2), by how much of them is seen (k,)."""
    known = np.zeros((4, 2)) if before is None else np.vstack([np.zeros(2), before])
    remembered = _DIRECTIONS * (1e-6 if before is None else BEFORE)
    weights = whole
    for _ in range(ROUNDS):
        weighted = rows.T * weights
        normal, wanted = weighted @ rows + remembered, weighted @ places + remembered @ known
        found = np.asarray(np.linalg.lstsq(normal, wanted, rcond=None)[0])
        errors = np.square(rows @ found - places).sum(1) / ERROR**2
        weights = whole / (1 + errors)
    turned = 0.0 if before is None else float(np.square(found[1:] - before).sum() / ERROR**2)
    pairs = ((layout.lower, 2), (0.0, 3))
    jaws, edges = ([_row(along, across, side) for side in (1, -1)] for along, across in pairs)
    points = np.array([_row(1.0, 0, 0), _row(0.0, 0, 0), *jaws, *edges])
    information = (rows.T * weights) @ rows + 1e-6 * np.eye(4)
    growth = np.einsum("ij,jk,ik->i", points, np.linalg.inv(information), points)
    error = float((whole * np.log1p(errors)).sum() + BEFORE * np.log1p(turned))
    return GripperFit(points @ found, np.asarray(growth <= SURE**2), found[1:], error)
