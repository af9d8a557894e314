"""The stable-baselines3 adapter against single environments and under SB3's algorithms; bounded words."""

import re

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3 import PPO, SAC, HerReplayBuffer

from calfree_gym.sb3 import as_sb3_env, make_sb3_env
from calfree_gym.wrappers import ScaledWords, VectorScaledWords
from tests.calfree_gym.environments import assert_same, begun, kinematic, make, of_row

QUICK = {"dynamics": "kinematic", "max_episode_steps": 5}


def test_rows_are_single_environments_that_begin_again_at_once():
    env = make_sb3_env("CalFree/Reach-v0", 3, tolerance_px=60.0, **QUICK)
    env.seed(7)
    shown = env.reset()
    singles = [make(tolerance_px=60.0, **QUICK) for _ in range(3)]
    expected = [single.reset(seed=7 + i)[0] for i, single in enumerate(singles)]
    ends = 0
    for words in np.random.default_rng(0).uniform(-0.2, 0.2, (12, 3, 3)).astype(np.float32):
        for i, observation in enumerate(expected):
            assert_same(of_row(shown, i), observation)
        shown, rewards, dones, infos = env.step(words)
        for i, single in enumerate(singles):
            expected[i], reward, terminated, truncated, info = single.step(words[i])
            assert (rewards[i], dones[i]) == (reward, terminated or truncated)
            assert infos[i]["is_success"] == info["is_success"] or not dones[i]
            if dones[i]:
                ends += 1
                assert infos[i]["TimeLimit.truncated"] == (truncated and not terminated)
                assert_same(infos[i]["terminal_observation"], expected[i])
                expected[i], _ = single.reset()
    assert ends >= 6


def test_ppo_sac_and_hindsight_learn_in_it():
    dense = make_sb3_env("calfree_gym:CalFree/ReachDense-v0", 4, **QUICK)
    ppo = PPO("MultiInputPolicy", dense, n_steps=8, batch_size=16, device="cpu")
    ppo.learn(64)
    assert len(ppo.ep_info_buffer) > 0
    sparse = make_sb3_env("CalFree/Reach-v0", 2, camera_mount="stand", **QUICK)
    few = {"learning_starts": 20, "buffer_size": 400, "device": "cpu"}
    SAC("MultiInputPolicy", sparse, replay_buffer_class=HerReplayBuffer, **few).learn(60)


def test_rows_have_attributes_and_methods_of_their_own():
    env = make_sb3_env("CalFree/Reach-v0", 3, **QUICK)
    env.seed(0)
    env.reset()
    first, *_, last = env.get_attr("world")
    assert first != last
    assert env.get_attr("world", indices=2) == [last]
    env.env_method("set_world", first, indices=[2])
    assert env.get_attr("world")[2] == first
    env.set_attr("world", last, indices=[0])
    assert env.get_attr("world", indices=0) == [last]
    env.set_attr("note", 1)
    assert env.get_attr("note") == [1, 1, 1]
    with pytest.raises(ValueError, match="all rows share it"):
        env.set_attr("note", 2, indices=[0])


def test_a_world_given_to_one_row_leaves_the_others_to_be_redrawn():
    env = make_sb3_env(n_envs=2, redraw="trial", dynamics="kinematic")
    env.reset()
    first, second = env.get_attr("world")
    env.set_attr("world", first, indices=[0])
    env.reset()
    assert env.get_attr("world")[0] == first
    assert env.get_attr("world")[1] != second


def test_unknown_ids_are_named():
    with pytest.raises(ValueError, match=r"'CalFree/Reach-v1'.*CalFree/Reach-v0"):
        make_sb3_env("CalFree/Reach-v1")


@pytest.mark.parametrize("name", ["num_envs", "autoreset_mode"])
def test_arguments_of_make_vec_that_have_another_name_here_are_refused(name):
    with pytest.raises(TypeError, match=f"{name!r}; n_envs says how many"):
        make_sb3_env(**{name: 2})


def test_options_of_all_rows_are_those_of_the_next_reset():
    envs = make_sb3_env("CalFree/ReachDense-v0", 2, world="nominal", seed=0)
    asked = [{"object": (0.4, 0.1, 0.1)}, {"object": (0.4, -0.1, 0.1)}]
    envs.set_options(asked)
    envs.reset()
    placed = envs.vector_env.unwrapped.arms.simulation.positions()[1]
    np.testing.assert_allclose(placed, [each["object"] for each in asked], atol=1e-9)
    assert [info.keys() for info in envs.venv.reset_infos] == [{"is_success"}] * 2
    envs.reset()
    assert (np.abs(envs.vector_env.unwrapped.arms.simulation.positions()[1] - placed).max(1) > 1e-3).all()
    envs.set_options([asked[0], {}])
    with pytest.raises(ValueError, match="of one kind"):
        envs.reset()


SCALED = {"limit": 0.25, "curvature": 2.0}


def test_an_action_becomes_a_small_word():
    env = begun(ScaledWords(kinematic(world="nominal"), **SCALED))
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


def test_only_rows_that_begin_again_at_once_suit_stable_baselines3():
    with pytest.raises(ValueError, match=r"autoreset_mode is .*NEXT_STEP.* must be SAME_STEP"):
        as_sb3_env(make(rows=1))


def test_a_list_of_single_environments_is_refused_before_a_trial_ends():
    at_once = {"autoreset_mode": gym.vector.AutoresetMode.SAME_STEP}
    listed = make(rows=1, vectorization_mode="sync", vector_kwargs=at_once)
    with pytest.raises(ValueError, match=r"is a SyncVectorEnv; .*without vectorization_mode.*DummyVecEnv"):
        as_sb3_env(listed)
    with pytest.raises(ValueError, match="the batched environment is a str"):
        as_sb3_env("CalFree/Reach-v0")


def test_observations_that_are_wrapped_already_are_refused():
    envs = gym.vector.VectorWrapper(make(rows=1, autoreset_mode=gym.vector.AutoresetMode.SAME_STEP))
    envs.single_observation_space = gym.spaces.flatten_space(envs.single_observation_space)
    with pytest.raises(ValueError, match="observations are wrapped"):
        as_sb3_env(envs)
