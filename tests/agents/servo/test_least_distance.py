"""Where gripper and object are expected to meet, in views whose every rendezvous is known."""

import numpy as np
import pytest

from agents.base.observation import Observation
from agents.servo.image_model.least_distance import Seeker
from agents.servo.image_model.smooth_points import SmoothPoints

FREE = np.ones(2)
GRID = np.array([[a, b] for a in np.linspace(-0.8, 1, 10) for b in np.linspace(-0.8, 0.8, 5)])


def looked(gripper, target, at):
    """What is known after looks at registers (n, 2): of a gripper's view, and an object at `target` (4,)."""
    points, objects = SmoothPoints(2), np.reshape(target, (2, 2))
    for registers in at:
        seen = np.concatenate([np.reshape(gripper(registers), (2, 2)), objects])
        points.look(Observation(seen, np.ones(4, bool), registers), 0.5)
    return points


def folded(registers):
    """A view (4,) that two postures share: registers a and 0.6 - a."""
    a, b = registers
    return np.array([(a - 0.3) ** 2, b, (a - 0.3) ** 2 + b, 0.5 * b])


STOP = np.array([-0.1, -1.0])


@pytest.mark.parametrize(
    ("start", "lowest", "posture"),
    [
        ([-0.1, 0.0], -FREE, -0.2),
        ([0.6, 0.0], -FREE, 0.8),
        ([-0.05, 0.3], STOP, 0.8),
        ([0.1, 0.3], STOP, 0.8),
    ],
)
def test_it_finds_the_nearest_posture_and_the_other_where_a_stop_is_in_the_way(start, lowest, posture):
    points = looked(folded, folded((-0.2, 0.3)), GRID)
    found = Seeker(points, np.array(start), lowest, FREE, caution=0.1).seek()
    np.testing.assert_allclose(found.registers, [posture, 0.3], atol=0.01)
    assert not found.far


def test_where_no_posture_does_it_says_that_this_is_hopeless():
    points = looked(folded, folded((-0.2, 0.3)), GRID)
    found = Seeker(points, np.array([0.1, 0.3]), STOP, np.array([0.7, 1]), caution=0.1).seek()
    assert found.far
    assert found.hopeless


def test_what_is_unknown_is_no_worse_than_a_place_known_not_to_do():
    points = looked(folded, folded((-0.15, 0.3)), GRID[GRID[:, 0] < 0.05])
    found = Seeker(points, np.array([0.0, 0.3]), STOP, FREE, caution=0.1).seek()
    assert not found.hopeless
    assert found.registers[0] > 0.3
