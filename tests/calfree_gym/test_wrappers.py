"""Bounded words, in one environment and in many."""

import re

import gymnasium as gym
import numpy as np
import pytest

from calfree_gym.sb3 import as_sb3_env, make_sb3_env
from calfree_gym.wrappers import ScaledWords, VectorScaledWords
from tests.calfree_gym.environments import assert_same, kinematic, make, of_row

SCALED = {"limit": 0.25, "curvature": 2.0}


def test_an_action_becomes_a_small_word():
    env = ScaledWords(kinematic(world="nominal"), **SCALED)
    env.reset(seed=0)
    observation, *_ = env.step(np.array([1, -0.5, 0], np.float32))
    np.testing.assert_allclose(observation["observation"][4:], [0.25, -0.0625, 0], atol=1e-6)
    assert env.action_space == gym.spaces.Box(-1, 1, (3,), np.float32)
    np.testing.assert_allclose(env.action(np.array([4, -9, 0.5])), [0.25, -0.25, 0.0625])


def test_the_batched_and_the_sb3_environment_scale_alike():
    actions = np.random.default_rng(0).uniform(-1, 1, (4, 2, 3)).astype(np.float32)
    single = [ScaledWords(kinematic(world="nominal"), **SCALED) for _ in range(2)]
    batch = VectorScaledWords(kinematic(rows=2, world="nominal"), **SCALED)
    words = {"word_limit": 0.25, "word_curvature": 2.0}
    sb3 = make_sb3_env("CalFree/Reach-v0", 2, dynamics="kinematic", world="nominal", **words)
    sb3.seed(3)
    for i, env in enumerate(single):
        env.reset(seed=3 + i)
    batch.reset(seed=3)
    sb3.reset()
    for rows in actions:
        batched, *_ = batch.step(rows)
        of_sb3, *_ = sb3.step(rows)
        for i, env in enumerate(single):
            observation, *_ = env.step(rows[i])
            assert_same(of_row(batched, i), observation)
            assert_same(of_row(of_sb3, i), observation)


def test_a_wrapped_environment_is_made_again_from_its_spec():
    env = gym.make(ScaledWords(kinematic(world="nominal"), **SCALED).spec)
    assert (env.limit, env.curvature) == (0.25, 2.0)


NO_NUMBERS = ["a", None, True, np.nan, [0.5], 1j]


@pytest.mark.parametrize(
    ("name", "wrong", "allowed"),
    [
        *(("limit", wrong, "0 < limit <= 1") for wrong in (0, 1.5, *NO_NUMBERS)),
        *(("curvature", wrong, "finite curvature > 0") for wrong in (0, np.inf, *NO_NUMBERS)),
    ],
)
def test_bounds_that_bound_nothing_are_errors(name, wrong, allowed):
    said = re.escape(f"{name} is {wrong!r}; allowed: {allowed}")
    with pytest.raises(ValueError, match=said):
        ScaledWords(make(), **{name: wrong})
    with pytest.raises(ValueError, match=said):
        VectorScaledWords(make(rows=1), **{name: wrong})
    with pytest.raises(ValueError, match=said):
        make_sb3_env(n_envs=1, **{f"word_{name}": wrong})


@pytest.mark.parametrize("number", [1, np.float32(0.5), np.float64(0.5), np.int64(1)])
def test_numbers_of_numpy_bound_words(number):
    env = ScaledWords(make(), limit=number, curvature=number)
    np.testing.assert_allclose(env.action(np.ones(3)), number)


def test_only_rows_that_begin_again_at_once_suit_stable_baselines3():
    with pytest.raises(ValueError, match=r"autoreset_mode is .*NEXT_STEP.* must be SAME_STEP"):
        as_sb3_env(make(rows=1))
