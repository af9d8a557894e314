"""Rows of a batched environment: their worlds, how trials end and begin, and what all of them share."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from calfree_gym import nominal
from tests.calfree_gym.environments import assert_same, kinematic, make

WORD = np.full(3, 0.05)


def test_many_rows_change_no_row():
    few, many = kinematic(rows=3), kinematic(rows=67)
    few.reset(seed=0)
    many.reset(seed=0)
    for word in np.random.default_rng(1).uniform(-0.15, 0.15, (14, 3)):
        (a, *_), (b, *_) = (envs.step(np.tile(word, (envs.num_envs, 1))) for envs in (few, many))
        assert_same(a, {key: value[:3] for key, value in b.items()})


def test_worlds_may_differ_by_row():
    env = make(rows=2, world=["nominal", "wild"])
    env.reset(seed=0)
    assert env.unwrapped.worlds[0] == nominal()
    env.unwrapped.set_world(nominal(), row=1)
    assert env.unwrapped.worlds[1] == nominal()
    env = make(rows=2)
    env.unwrapped.set_world(nominal(), row=1)
    env.reset(seed=[5, None])
    assert env.unwrapped.worlds[1] == nominal()


@pytest.mark.parametrize("rows", [None, 2])
def test_trials_may_go_on_without_limit(rows):
    env = kinematic(rows, max_episode_steps=-1, terminate_on_success=False)
    env.reset(seed=0)
    still = np.zeros(env.action_space.shape, np.float32)
    assert not any(np.any(env.step(still)[3]) for _ in range(62)), "60 is the usual limit"


def test_same_step_autoreset_gives_the_last_observation_and_the_next_first_one():
    after = kinematic(rows=3, max_episode_steps=4)
    at_once = kinematic(rows=3, max_episode_steps=4, autoreset_mode="SameStep")
    assert at_once.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert after.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    after.reset(seed=0)
    at_once.reset(seed=0)
    ended, words = 0, np.tile(WORD, (3, 1))
    for _ in range(9):
        last, *_, truncated, _ = after.step(words)
        first, *_, also_truncated, infos = at_once.step(words)
        np.testing.assert_array_equal(truncated, also_truncated)
        if truncated.all():
            ended += 1
            assert_same(infos["final_obs"], last)
            np.testing.assert_array_equal(infos["_final_obs"], True)
            last, *_ = after.step(words)
        assert_same(first, last)
    assert ended == 2


def test_without_autoreset_rows_wait_for_a_masked_reset():
    env = kinematic(rows=3, max_episode_steps=4, autoreset_mode=AutoresetMode.DISABLED)
    env.reset(seed=0)
    words = np.tile(WORD, (3, 1))
    env.step(words)
    before, *_ = env.step(words)
    mask = np.array([False, True, False])
    observation, _ = env.reset(options={"reset_mask": mask})
    np.testing.assert_array_equal(observation["observation"][1, 4:], 0)
    for key, value in before.items():
        np.testing.assert_array_equal(observation[key][~mask], value[~mask])
    for _ in range(2):
        *_, truncated, _ = env.step(words)
    np.testing.assert_array_equal(truncated, ~mask)
    with pytest.raises(gym.error.ResetNeeded, match=r"rows \[0, 2\] are over"):
        env.step(words)
    env.reset(options={"reset_mask": ~mask})
    env.step(words)


def test_same_step_infos_count_perturbations_of_rows_that_are_not_over():
    every = [{"every": {"motion": 1}, "do": {"type": "camera_roll", "camera": "left", "degrees": 0.1}}]
    env = kinematic(rows=2, world=nominal(), autoreset_mode="SameStep", perturbations=every)
    env.reset(seed=[0, 1])
    env.step(np.zeros((2, 3)))
    env.unwrapped._max_episode_steps = np.array([2, 60])
    *_, infos = env.step(np.zeros((2, 3)))
    np.testing.assert_array_equal(infos["perturbed"], [0, 1])
    np.testing.assert_array_equal(infos["final_info"]["perturbed"], [1, 1])


ROWS = 3


def both(**arguments):
    """The batched environment and Gymnasium's list of single ones, in the same worlds."""
    modes = ("vector_entry_point", "sync")
    made = [make(rows=ROWS, vectorization_mode=mode, **arguments) for mode in modes]
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
    world = nominal()
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
    rows = kinematic(rows=ROWS, autoreset_mode=mode)
    assert rows.autoreset_mode is rows.metadata["autoreset_mode"] is mode
