"""Attributes of rows, under Gymnasium's names for them, against its own vector environment."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import calfree_gym

ROWS = 3


def both(**arguments):
    """The batched environment and Gymnasium's list of single ones, in the same worlds."""
    made = [
        gym.make_vec("CalFree/Reach-v0", num_envs=ROWS, vectorization_mode=mode, **arguments)
        for mode in ("vector_entry_point", "sync")
    ]
    for envs in made:
        envs.reset(seed=5)
        envs.step(np.full((ROWS, 3), 0.1))
    return made


@pytest.mark.parametrize("name", ["world", "home_seconds", "applied", "tolerance_px", "render_mode"])
def test_rows_have_the_attributes_of_single_environments(name):
    roll = [{"at": {"motion": 0}, "do": {"type": "camera_roll"}}]
    rows, singles = both(perturbations=roll)
    found = rows.get_attr(name)
    assert isinstance(found, tuple)
    assert found == singles.get_attr(name)
    assert rows.get_attr("observation_space") == singles.get_attr("observation_space")
    assert rows.get_attr("action_space") == singles.get_attr("action_space")


def test_methods_are_called_for_each_row():
    rows, singles = both()
    world = calfree_gym.nominal()
    for envs in (rows, singles):
        assert envs.call("set_world", world) == (None,) * ROWS
        assert envs.get_attr("world") == (world,) * ROWS
    goals = np.zeros(4), np.full(4, 0.5)
    assert rows.call("compute_reward", *goals, {}) == singles.call("compute_reward", *goals, {})
    states = rows.call("get_state")
    assert [state["registers"].tolist() for state in states] == rows.arms.registers.tolist()


def test_attributes_are_set_for_each_row_where_rows_have_their_own():
    rows, singles = both()
    worlds = list(rows.get_attr("world"))[::-1]
    for envs in (rows, singles):
        envs.set_attr("world", worlds)
        assert list(envs.get_attr("world")) == worlds
        envs.set_attr("world", worlds[0])
        assert envs.get_attr("world") == (worlds[0],) * ROWS
        envs.set_attr("note", "shared")
        assert envs.get_attr("note") == ("shared",) * ROWS
    with pytest.raises(ValueError, match="camera_mount is an argument of make_vec; make another"):
        rows.set_attr("camera_mount", "stand")
    with pytest.raises(ValueError, match="autoreset_mode is an argument of make_vec"):
        rows.set_attr("autoreset_mode", "SameStep")
    with pytest.raises(ValueError, match=r"note got \[1, 2, 3\]; all rows share it"):
        rows.set_attr("note", [1, 2, 3])
    with pytest.raises(ValueError, match="world got 2 values; it must get 3, one a row, or one for all"):
        rows.set_attr("world", worlds[:2])
    with pytest.raises(AttributeError, match="no 'step' of its own"):
        rows.call("step", np.zeros(3))
    with pytest.raises(AttributeError, match="wrold"):
        rows.get_attr("wrold")


@pytest.mark.parametrize("mode", AutoresetMode)
def test_the_autoreset_mode_stands_where_wrappers_look_for_it(mode):
    rows = gym.make_vec("CalFree/Reach-v0", num_envs=ROWS, autoreset_mode=mode)
    assert rows.autoreset_mode is rows.metadata["autoreset_mode"] is mode
