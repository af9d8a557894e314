"""The work space: worlds are judged by the first candidates in it, however many are looked at a time."""

import numpy as np
import pytest

from calfree_gym.robot import workspace
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.workspace import CHECKED, Workspaces, judging_draws
from calfree_gym.world import WorldDistribution


@pytest.mark.parametrize("mount", ["waist", "stand", "forearm"])
def test_a_world_is_judged_by_the_first_of_all_candidates(monkeypatch, mount):
    spaces = Workspaces(1, MOVEMASTER, MOVEMASTER.mounts(mount))
    draws = judging_draws(MOVEMASTER.candidates, len(MOVEMASTER.motors))
    for seed in range(12):
        spaces.set_world(0, WorldDistribution("wild").sample(seed))
        found = spaces.candidates(draws, np.array([0]))
        first = np.flatnonzero(found.within)[:CHECKED]
        for at_once in (workspace.PLACED_AT_ONCE, 1):
            monkeypatch.setattr(workspace, "PLACED_AT_ONCE", at_once * len(first))
            reached, good = spaces.judged(0)
            np.testing.assert_array_equal(reached, found.reached[0, first])
            np.testing.assert_array_equal(good, found.reached[0, first] & found.seen[0, first])
