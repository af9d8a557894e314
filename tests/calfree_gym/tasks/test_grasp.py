"""When an object counts as held, by jaws and images alone."""

import numpy as np
import pytest

from calfree_gym.image import IMAGE_UNIT
from calfree_gym.tasks.grasp import held

FAR, NEAR = 40 * IMAGE_UNIT, 4 * IMAGE_UNIT


def ways(length, noise=0.0):
    """Of a point in both images (1, 2, 2)."""
    way = np.full((1, 2, 2), length / np.sqrt(2))
    return way + np.random.default_rng(0).normal(0, noise, way.shape)


@pytest.mark.parametrize("before", [False, True])
@pytest.mark.parametrize(
    ("gripper", "object_", "blocked", "seen", "wanted"),
    [
        (FAR, FAR, True, True, True),  # it goes with the gripper
        (FAR, 0.0, True, True, False),  # it stays
        (FAR, FAR, False, True, False),  # the jaws are closed on nothing
        (NEAR, 0.0, True, True, None),  # hardly moved: as before
        (FAR, 0.0, True, False, None),  # not seen: as before
    ],
)
def test_what_goes_with_a_gripper_that_moves_is_held(gripper, object_, blocked, seen, wanted, before):
    noise = 2 * IMAGE_UNIT
    found = held(
        np.array([blocked]), np.array([before]), ways(gripper), ways(object_, noise), np.array([seen])
    )
    assert found == (before if wanted is None else wanted)
