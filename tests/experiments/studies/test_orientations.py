"""The map of orientations, beside what contact shows."""

import gymnasium as gym
import numpy as np
import pytest

from calfree_gym.robot.grasping.shapes import SHAPE_NAMES
from experiments.studies.orientations import GRASP, search, tables


def reset(shape, seed):
    env = gym.make(GRASP, shape=shape, orientation="any", camera_mount="stand", keep_in_view=False)
    env.reset(seed=seed)
    return env.unwrapped.arms


def test_what_geometry_calls_graspable_is_lifted_by_the_search():
    for seed in (5, 6):
        arms = reset("bar", seed)
        assert any(arms.placing.ways(0, arms.world(0), arms.placed[0].thing, arms.placed[0].pose))
        assert search(arms, arms.placed[0].pose)


def test_what_is_out_of_reach_is_not_lifted():
    assert not search(reset("sphere", 7), np.array([0.9, 0.0, 0.12, 1, 0, 0, 0]))


@pytest.mark.slow
def test_the_table_tells_shares():
    of_map, of_search = tables(worlds=1, mounts=("stand",))
    assert set(of_map.frame["shape"]) == set(of_search.frame["shape"]) == set(SHAPE_NAMES)
    assert of_search.frame["map"].between(0, 1).all()
    assert (of_map.frame["map"] >= of_map.frame["straight down"]).all()
