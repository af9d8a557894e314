"""Copies and states go on alike, bit by bit, from any moment; and what fails changes nothing."""

import copy
import pickle
from dataclasses import replace
from functools import partial
from itertools import count

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stable_baselines3.common.vec_env import SubprocVecEnv

from calfree_gym import nominal
from calfree_gym.robot import workspace
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.workspace import in_view
from calfree_gym.world import WorldDistribution
from tests.arms import own
from tests.calfree_gym.environments import assert_same, begun, kinematic, make, of_row
from tests.calfree_gym.robot.one_motor import FIELDS

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
COPIES = {"deepcopy": copy.deepcopy, "pickle": lambda env: pickle.loads(pickle.dumps(env))}
moments = st.integers(0, 16)
dynamics = st.sampled_from(["physics", "kinematic"])
few = settings(max_examples=8)


def made(**arguments):
    return make(**ARGUMENTS | arguments)


def made_rows(**arguments):
    return make(rows=ROWS, **ARGUMENTS | arguments)


def physics(env):
    return env.unwrapped.arms.simulation._physics.copy()


def lived(env, motions, seed=0):
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
    env.action_space.seed(3)
    env.action_space.sample()
    lived(env, moment)
    twin = COPIES[how](env)
    copied = COPIES[how](env)
    assert physics(env).any()
    assert_same(physics(copied), physics(env))
    assert_same(copied.unwrapped.arms.error_px(), env.unwrapped.arms.error_px())
    expected = lived(env, 12, seed=1)
    lived(twin, 3, seed=2)  # another way: neither of the others must notice
    twin.reset(seed=5)
    assert_same(lived(copied, 12, seed=1), expected)
    assert_same(copied.reset(), env.reset())
    assert_same(copied.action_space.sample(), env.action_space.sample())
    assert_same(copied.reset(seed=3), env.reset(seed=3))


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
    env.set_world(nominal())
    lived(env, 5, seed=2)
    shown = [env.step(np.zeros(env.action_space.shape))[-1]["truth"]]
    kept = copy.deepcopy(shown)
    for _ in range(2):
        env.set_state(state)
        assert env.applied == ([[]] * ROWS if batched else [])
        assert_same(env.get_state(), before)
        assert_same(lived(env, 8, seed=1), expected)
    assert_same(shown, kept)
    assert_same(state, before)


SEEN = {"dynamics": "kinematic", "image_size": 48}
CASES = {
    # the first two have friction, so that the solver's warm start counts; the last one many postures
    **{name: ("Reach", {"arm": own.ARMS[name]}) for name in ("scara", "gantry", "redundant")},
    "grasping": ("Grasp", {"camera_mount": "stand"}),
    "held": ("Grasp", {"orientation": "any", "camera_mount": "stand"}),
    "inserting": ("Insert", {}),
    "safe": ("SafeReach", {"world": "nominal"}),
    "rough motors": ("Reach", {"world": replace(nominal(), **FIELDS), "keep_in_view": False}),
    "vision": ("Reach", {"observation": "vision", **SEEN}),
    "rgb": ("Reach", {"observation": "rgb", **SEEN}),
}


@pytest.mark.parametrize("case", CASES)
def test_copies_and_states_go_on_alike_in_every_task(case, request):
    if case in ("vision", "rgb"):
        request.getfixturevalue("opengl")
    task, arguments = CASES[case]
    env = make(task, terminate_on_success=False, **arguments)
    words = np.random.default_rng(3).uniform(-0.3, 0.3, (8, *env.action_space.shape)).astype(np.float32)
    if task == "Grasp":
        words[:, -1], words[3, -1] = 0, 1  # jaws close
    env.reset(seed=8)
    for each in words[:4]:
        env.step(each)
    state, twins = env.unwrapped.get_state(), [copied(env) for copied in COPIES.values()]
    expected = [env.step(each) for each in words[4:]]
    env.reset(seed=9)
    env.unwrapped.set_state(state)
    for again in (*twins, env.unwrapped):
        assert_same([again.step(each) for each in words[4:]], expected)
        again.close()


def test_all_rows_try_what_is_next_from_the_state_of_a_single_arm():
    env, rows = made().unwrapped, made_rows().unwrapped
    env.reset(seed=4)
    lived(env, 5)
    rows.reset(seed=0)
    lived(rows, 7)
    rows.set_state(env.get_state())
    words = np.random.default_rng(0).uniform(-0.2, 0.2, (ROWS, 3))
    tried, rewards, terminated, truncated, infos = rows.step(words)
    observation, reward, ends, _, info = env.step(words[1])
    assert_same(of_row(tried, 1), observation)
    assert (rewards[1], terminated[1]) == (reward, ends)
    assert infos["truth"]["error_px"][1] == info["truth"]["error_px"]
    assert truncated.all()  # after six motions of the trial, of which the single arm has made five
    assert len(np.unique(infos["truth"]["error_px"])) == ROWS
    rows.set_state(env.get_state(), row=2)
    assert_same(rows.get_state()[2], env.get_state())


def test_states_of_others_are_refused():
    env, rows = made().unwrapped, made_rows().unwrapped
    env.reset(seed=0)
    rows.reset(seed=0)
    for arguments, message in (
        ({"arm": own.ARMS["scara"]}, r"of another arm: its motors are .*; here they are .*waist"),
        ({"camera_mount": "stand"}, "of another arm: its camera mounts are"),
    ):
        other = begun(make(**arguments).unwrapped)
        with pytest.raises(ValueError, match=message):
            env.set_state(other.get_state())
    with pytest.raises(ValueError, match="there are 2 states; there must be 3, one a row, or one for all"):
        rows.set_state(rows.get_state()[:2])
    before, other = env.world, copy.deepcopy(env)
    other.reset(seed=1)  # in another world
    state = other.get_state()
    without = {key: {k: v for k, v in state.items() if k != key} for key in ("registers", "_sight")}
    for wrong, message in (
        (without["registers"], "the state has no registers"),
        (without["_sight"], r"it must be what get_state\(\) gave"),
        (state | {"registers": np.zeros(4)}, r"registers has shape \(4,\); it must have \(3,\)"),
        (state | {"delivered": range(3)}, "the state delivers 3 arrays; it must be 2"),
        *((each, r"the state is .*; it must be what get_state\(\) gave") for each in ({}, 3, None, {"q": 0})),
    ):
        with pytest.raises(ValueError, match=message):
            env.set_state(wrong)
        assert env.world == before
    with pytest.raises(ValueError, match="row is 7; it must be a whole number from 0 to 2"):
        rows.set_state(state, 7)


def test_stable_baselines3s_subprocesses_take_copies():
    env = made(perturbations=None)
    expected = env.reset(seed=2)[0]
    envs = SubprocVecEnv([partial(pickle.loads, pickle.dumps(env))], start_method="spawn")
    try:
        envs.seed(2)
        assert_same(of_row(envs.reset(), 0), expected)
    finally:
        envs.close()


REVERSED = {"do": {"type": "motor_sign", "motor": "shoulder"}}
OUT_OF_VIEW = {"do": {"type": "camera_aim", "camera": "left", "degrees": 170.0}}
FAR = (0.9, 0.0)


def sign(env):
    return int(env.unwrapped.world.motor_sign[1])


def test_a_reset_that_fails_applies_no_event_and_ends_the_trial():
    schedule = [{"at": {"trial": 1}, **REVERSED}]
    env = begun(make("Grasp", world="nominal", shape="sphere", perturbations=schedule).unwrapped)
    before = sign(env)
    with pytest.raises(ValueError, match=r"0\.9"):
        env.reset(options={"object": FAR})
    assert sign(env) == before
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros(env.action_space.shape))
    env.reset()
    assert sign(env) == -before


@pytest.mark.parametrize("rows", [None, 2])
def test_a_reset_whose_arguments_are_wrong_changes_nothing(rows):
    env = begun(kinematic(rows).unwrapped)
    before = str(env.get_state())
    for wrong in ({"options": {"objekt": FAR}}, {"options": {"object": "here"}}):
        with pytest.raises(ValueError, match="obje"):
            env.reset(seed=1, **wrong)
        assert str(env.get_state()) == before


def test_where_no_world_can_be_drawn_an_arm_stays_in_its_own_and_asks_for_a_reset(monkeypatch):
    env = begun(kinematic().unwrapped)
    as_before = kinematic(world=env.world)
    mounts, wild = env.arms.mounts, WorldDistribution("wild")
    seed = next(s for s in count(1) if not in_view(wild.sample(s), MOVEMASTER, mounts, whole=True))
    monkeypatch.setattr(workspace, "ATTEMPTS", 1)
    with pytest.raises(ValueError, match="never in view"):
        env.reset(seed=seed)
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros(3))
    monkeypatch.undo()
    assert_same(env.reset(), as_before.reset(seed=seed))


def test_a_motion_before_which_an_event_fails_applies_none_and_a_drift_goes_on_from_where_it_was():
    """A drift's direction is drawn once, by the first of its steps that is applied."""
    drift = {"drift": {"per": "motion"}, "do": {"type": "camera_roll", "camera": "left"}}
    schedule = [drift, {"at": {"motion": 1}, **REVERSED}, {"at": {"motion": 1}, **OUT_OF_VIEW}]
    env = begun(kinematic(world=nominal(), perturbations=schedule).unwrapped)
    env.step(np.zeros(3))
    before = env.world
    for _ in range(2):
        with pytest.raises(ValueError, match=r"camera_aim.*never in view"):
            env.step(np.zeros(3))
        assert env.world == before
    assert env.get_state()["_scheduler"]["_drifts"] == {}


def test_a_copy_looks_no_more_often_than_what_it_is_of():
    """A tracker of grasps remembers what it saw; rows of a mask begin, and others only look."""
    rows = make("Grasp", rows=2, observation="vision", autoreset_mode="Disabled")
    rows.reset(seed=4)
    for words in np.random.default_rng(1).uniform(-0.3, 0.3, (3, 2, 5)):
        rows.step(words)
    again = copy.deepcopy(rows)
    mask = {"reset_mask": np.array([True, False])}
    assert_same(rows.reset(options=mask)[0], again.reset(options=mask)[0])
