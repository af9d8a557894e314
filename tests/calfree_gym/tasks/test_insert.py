"""Inserting, as images tell it: by hand-made points."""

import numpy as np
import pytest

from calfree_gym.tasks import insert

BASE, TIP = np.array([[[0.0, -0.2], [0.1, -0.2]]]), np.array([[[0.0, 0.0], [0.1, 0.0]]])
SEEN = np.array([True])


@pytest.mark.parametrize("share", [-0.5, 0.0, 0.17, 0.3])
def test_depth_is_what_is_beyond_the_hole_on_the_axis(share):
    beside = np.array([0.01, 0.0])
    hole = TIP - share * (TIP - BASE) + beside
    assert insert.depth_told(TIP, BASE, hole, SEEN) == pytest.approx([share])


def test_what_is_not_seen_is_not_in():
    assert insert.depth_told(TIP, BASE, TIP - 0.1, ~SEEN) == [-1]
    assert insert.depth_told(TIP, TIP, BASE, SEEN) == [0], "no axis is seen"


def test_deep_is_in_only_at_the_hole():
    desired = np.array([0.1, 0.2, 0.3, 0.4, insert.DEPTH])
    assert insert.inserted(desired, desired, 0.05)
    assert not insert.inserted(desired - np.array([0, 0, 0, 0, 0.01]), desired, 0.05)
    assert not insert.inserted(desired + np.array([0, 0, 0.06, 0, 0.5]), desired, 0.05)
    assert insert.inserted(np.stack([desired, desired + 0.2]), desired, 0.05).tolist() == [True, False]
