"""The stable-baselines3 adapter against single environments, and under SB3's own algorithms."""

import numpy as np
import pytest
from stable_baselines3 import PPO, SAC, HerReplayBuffer

from calfree_gym.sb3 import make_sb3_env
from tests.calfree_gym.environments import assert_same, make, of_row

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


def test_a_seed_given_at_once_is_that_of_the_first_reset():
    env, seeded = make_sb3_env(n_envs=2, **QUICK), make_sb3_env(n_envs=2, seed=3, **QUICK)
    env.seed(3)
    assert_same(seeded.reset(), env.reset())
    assert seeded.get_attr("world") == env.get_attr("world")


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
    envs.set_options([asked[0], {}])
    with pytest.raises(ValueError, match="of one kind"):
        envs.reset()
