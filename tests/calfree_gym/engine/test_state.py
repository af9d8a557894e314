"""Copies and states: from any moment on, the same steps, resets, worlds and perturbations, bit by bit."""

import copy
import functools
import pickle
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv
from hypothesis import given, settings
from hypothesis import strategies as st
from stable_baselines3.common.vec_env import SubprocVecEnv

import calfree_gym
from tests.arms import own

SCHEDULE = [
    {"at": {"motion": 5}, "do": {"type": "backlash", "motor": "shoulder"}},
    {"every": {"motion": 4}, "do": {"type": "camera_roll"}},
    {"drift": {"per": "motion"}, "do": {"type": "lens"}},
    {"at": {"trial": 1}, "do": {"type": "latency", "motions": 2}},
    {"at": {"trial": 1}, "do": {"type": "repeatability"}},
    {"at": {"motion": 14}, "undo": 0},
    {"at": {"motion": 3}, "do": {"type": "dead_zone", "motor": "shoulder", "words": 0.1}},
    {"at": {"trial": 1}, "do": {"type": "register_noise"}},
    {"at": {"motion": 8}, "undo": 6},
]
ARGUMENTS = {
    "perturbations": SCHEDULE,
    "keep_in_view": False,  # worlds are not judged: that takes long
    "tolerance_px": 30.0,
    "tell": ("object_registers", "joint_zeros"),
    "max_episode_steps": 6,
}
ROWS = 3
COPIES = {
    "deepcopy": copy.deepcopy,
    "pickle": lambda env: pickle.loads(pickle.dumps(env)),
}
moments = st.integers(0, 16)
dynamics = st.sampled_from(["physics", "kinematic"])
few = settings(max_examples=8)


def made(**arguments):
    return gym.make("CalFree/Reach-v0", disable_env_checker=True, **ARGUMENTS | arguments)


def made_rows(**arguments):
    return gym.make_vec("CalFree/Reach-v0", num_envs=ROWS, **ARGUMENTS | arguments)


def leaves(value):
    """All numbers and arrays in a result, flat."""
    if isinstance(value, dict):
        return [leaf for key in sorted(value) for leaf in leaves(value[key])]
    if isinstance(value, list | tuple):
        return [leaf for each in value for leaf in leaves(each)]
    return [value]


def assert_equal(one, other):
    one, other = leaves(one), leaves(other)
    assert len(one) == len(other)
    for a, b in zip(one, other, strict=True):
        if isinstance(a, calfree_gym.World) or not isinstance(a, np.ndarray | np.generic | float):
            assert a == b
        else:
            assert np.asarray(a).tobytes() == np.asarray(b).tobytes()


def physics(env):
    return env.unwrapped.arms.simulation._physics.copy()


def lived(env, motions, seed=0):
    """All that so many motions show, with resets where trials end."""
    rng = np.random.default_rng(seed)
    shape = env.action_space.shape
    found = []
    for _ in range(motions):
        words = rng.uniform(-0.2, 0.2, shape) * (rng.random(shape) < 0.7)  # some motors do not move
        result = env.step(words)
        found += [result, env.unwrapped.applied, env.unwrapped.home_seconds, physics(env)]
        found.append(getattr(env.unwrapped, "worlds", None) or env.unwrapped.world)
        if len(shape) == 1 and (result[2] or result[3]):
            found.append(env.reset())
    return found


@few
@given(moment=moments, dynamics=dynamics, how=st.sampled_from(sorted(COPIES)), batched=st.booleans())
def test_a_copy_goes_on_as_the_original_and_shares_nothing_with_it(moment, dynamics, how, batched):
    env = (made_rows if batched else made)(dynamics=dynamics)
    env.reset(seed=11)
    lived(env, moment)
    twin = COPIES[how](env)
    copied = COPIES[how](env)
    assert physics(env).any()
    assert_equal(physics(copied), physics(env))
    assert_equal(copied.unwrapped.arms.error_px(), env.unwrapped.arms.error_px())
    expected = lived(env, 12, seed=1)
    lived(twin, 3, seed=2)  # another way: neither of the others must notice
    twin.reset(seed=5)
    assert_equal(lived(copied, 12, seed=1), expected)
    assert_equal(copied.reset(), env.reset())
    assert_equal(copied.reset(seed=3), env.reset(seed=3))


@few
@given(moment=moments, dynamics=dynamics, batched=st.booleans(), stored=st.booleans())
def test_a_state_is_gone_back_to_whatever_happened_in_between(moment, dynamics, batched, stored):
    env = (made_rows if batched else made)(dynamics=dynamics).unwrapped
    env.reset(seed=12)
    lived(env, moment)
    state = env.get_state()
    if stored:
        state = pickle.loads(pickle.dumps(state))
    before = copy.deepcopy(state)
    expected = lived(env, 8, seed=1)
    env.reset(seed=40)
    env.set_world(calfree_gym.nominal())
    lived(env, 5, seed=2)
    shown = [env.step(np.zeros(env.action_space.shape))[-1]["truth"]]
    kept = copy.deepcopy(shown)
    for _ in range(2):
        env.set_state(state)
        assert env.applied == ([[]] * ROWS if batched else [])
        assert_equal(env.get_state(), before)
        assert_equal(lived(env, 8, seed=1), expected)
    assert_equal(shown, kept)
    assert_equal(state, before)


def test_before_the_first_reset_copies_are_made_and_states_are_not():
    env = made()
    env.unwrapped.set_world(calfree_gym.nominal())
    copied = copy.deepcopy(env)
    assert_equal(copied.reset(seed=3), env.reset(seed=3))
    assert copied.unwrapped.world == calfree_gym.nominal()
    with pytest.raises(gym.error.ResetNeeded, match=r"no trial has begun: call reset\(\) first"):
        made().unwrapped.get_state()
    with pytest.raises(gym.error.ResetNeeded):
        made_rows().unwrapped.get_state()
    for new in (made(), made_rows()):
        with pytest.raises(gym.error.ResetNeeded):
            copy.deepcopy(new).unwrapped.step(new.action_space.sample())


def test_spaces_are_copied_where_their_random_numbers_are():
    env = made()
    env.action_space.seed(3)
    env.action_space.sample()
    np.testing.assert_array_equal(copy.deepcopy(env).action_space.sample(), env.action_space.sample())


def test_all_rows_try_what_is_next_from_the_state_of_a_single_arm():
    """What a planner does: the row that does what the single arm then does ends where it ends."""
    env, rows = made().unwrapped, made_rows().unwrapped
    env.reset(seed=4)
    lived(env, 5)
    rows.reset(seed=0)
    lived(rows, 7)
    rows.set_state(env.get_state())
    words = np.random.default_rng(0).uniform(-0.2, 0.2, (ROWS, 3))
    tried, rewards, terminated, truncated, infos = rows.step(words)
    observation, reward, ends, _, info = env.step(words[1])
    assert_equal({key: value[1] for key, value in tried.items()}, observation)
    assert (rewards[1], terminated[1]) == (reward, ends)
    assert infos["truth"]["error_px"][1] == info["truth"]["error_px"]
    assert truncated.all()  # after six motions of the trial, of which the single arm has made five
    assert len(np.unique(infos["truth"]["error_px"])) == ROWS
    rows.set_state(env.get_state(), row=2)
    assert_equal(rows.get_state()[2], env.get_state())


def test_rows_that_are_over_are_over_in_their_state():
    rows = made_rows(perturbations=None, autoreset_mode="Disabled").unwrapped
    rows.reset(seed=0)
    for _ in range(6):
        rows.step(np.full((ROWS, 3), 0.01))
    over = rows.get_state()
    rows.reset(seed=1)
    rows.step(np.zeros((ROWS, 3)))
    rows.set_state(over)
    with pytest.raises(gym.error.ResetNeeded, match=r"rows \[0, 1, 2\] are over"):
        rows.step(np.zeros((ROWS, 3)))


def test_latency_that_has_just_begun_belongs_to_the_state():
    env = made(perturbations=None).unwrapped
    env.reset(seed=2)
    lived(env, 2)
    env.set_world(replace(env.world, latency=2))
    state = env.get_state()
    expected = lived(env, 3, seed=1)
    env.set_state(state)
    assert_equal(lived(env, 3, seed=1), expected)


@pytest.mark.parametrize("name", ["scara", "gantry", "redundant"])
def test_any_arm_is_copied(name):
    """The first two have friction, so that the solver's warm start counts; the last one many postures."""
    env = made(arm=own.ARMS[name], tell=("object_registers",), perturbations=None)
    env.reset(seed=1)
    lived(env, 4)
    copied = pickle.loads(pickle.dumps(env))
    assert_equal(lived(copied, 7, seed=1), lived(env, 7, seed=1))


def other_world_of(env):
    """A state in another world, of the same arguments."""
    other = copy.deepcopy(env)
    other.reset(seed=1)
    return other.get_state()


def test_states_of_others_are_refused():
    env, rows = made().unwrapped, made_rows().unwrapped
    env.reset(seed=0)
    rows.reset(seed=0)
    other = gym.make("CalFree/Reach-v0", arm=own.ARMS["scara"]).unwrapped
    other.reset(seed=0)
    with pytest.raises(ValueError, match=r"of another arm: its motors are .*; here they are .*waist"):
        env.set_state(other.get_state())
    with pytest.raises(ValueError, match="there are 2 states; there must be 3, one a row, or one for all"):
        rows.set_state(rows.get_state()[:2])
    elsewhere = made(camera_mount="stand").unwrapped
    elsewhere.reset(seed=0)
    with pytest.raises(ValueError, match="of another arm: its camera mounts are"):
        env.set_state(elsewhere.get_state())
    before, state = env.world, other_world_of(env)
    with pytest.raises(ValueError, match="the state has no registers"):
        env.set_state({key: value for key, value in state.items() if key != "registers"})
    with pytest.raises(ValueError, match=r"registers has shape \(4,\); it must have \(3,\)"):
        env.set_state(state | {"registers": np.zeros(4)})
    with pytest.raises(ValueError, match="the state delivers 3 arrays; it must be 2"):
        env.set_state(state | {"delivered": (*state["delivered"], np.zeros(1))})
    with pytest.raises(ValueError, match=r"it must be what get_state\(\) gave"):
        env.set_state({key: value for key, value in state.items() if key != "_sight"})
    assert env.world == before
    with pytest.raises(ValueError, match="row is 7; it must be a whole number from 0 to 2"):
        rows.set_state(state, 7)
    for wrong in ({}, 3, None, {"qpos": [0]}):
        with pytest.raises(ValueError, match=r"the state is .*; it must be what get_state\(\) gave"):
            env.set_state(wrong)


def copied_from(data):
    return pickle.loads(data)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [SyncVectorEnv, AsyncVectorEnv])
def test_gymnasiums_vector_environments_of_copies_go_on(kind):
    env = made(perturbations=None)
    env.reset(seed=2)
    lived(env, 2)
    copies = [functools.partial(copied_from, pickle.dumps(env))] * 2
    envs = kind(copies, context="spawn") if kind is AsyncVectorEnv else kind(copies)
    try:
        envs.reset(seed=2)
        observations, *_, infos = envs.step(np.full((2, 3), 0.1))
        env.reset(seed=2)
        observation, *_, info = env.step(np.full(3, 0.1))
        assert_equal({key: value[0] for key, value in observations.items()}, observation)
        assert infos["truth"]["error_px"].tolist()[0] == info["truth"]["error_px"]
        envs.call("set_state", env.unwrapped.get_state())
        assert_equal(envs.call("get_state")[1], env.unwrapped.get_state())
    finally:
        envs.close()


def test_stable_baselines3s_subprocesses_take_copies():
    env = made(perturbations=None)
    expected = env.reset(seed=2)[0]
    envs = SubprocVecEnv([functools.partial(copied_from, pickle.dumps(env))], start_method="spawn")
    try:
        envs.seed(2)
        assert_equal({key: value[0] for key, value in envs.reset().items()}, expected)
    finally:
        envs.close()
