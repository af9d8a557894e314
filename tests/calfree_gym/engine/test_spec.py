"""Specs hold plain values: what JSON gives back makes an environment with the same numbers."""

import json

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from hypothesis import given, settings
from hypothesis import strategies as st

import calfree_gym
from calfree_gym.perturbations import TYPES, CameraRoll, Latency, parse_schedule
from calfree_gym.world import WorldDistribution
from calfree_gym.wrappers import ScaledWords
from tests.arms import own

WORLD = calfree_gym.nominal()
WORLDS = ["nominal", WORLD, WORLD.to_dict(), WorldDistribution("coarse")]
PLAIN = [
    {"at": {"motion": 1}, "do": {"type": "camera_roll", "camera": "left", "degrees": 10.0}},
    {"drift": {"per": "motion"}, "do": {"type": "latency"}},
    {"at": {"motion": 3}, "undo": 0},
]
SCHEDULES = [
    None,
    PLAIN,
    [
        {"at": {"motion": 1}, "do": CameraRoll(camera="left", degrees=np.float64(10.0))},
        {"drift": {"per": "motion"}, "do": Latency()},
        {"at": {"motion": 3}, "undo": 0},
    ],
    parse_schedule(PLAIN),
]


def shown(env, motions=4):
    """What an environment shows in some motions."""
    shape = env.action_space.shape
    found = [env.reset(seed=3)[0]]
    found += [env.step(np.full(shape, 0.05))[0] for _ in range(motions)]
    return [look[key].tolist() for look in found for key in sorted(look)]


def remade(env, make=gym.make):
    """By way of JSON, in which nothing is lost."""
    text = env.unwrapped.spec.to_json() if make is gym.make_vec else env.spec.to_json()
    made = make(EnvSpec.from_json(text))
    again = made.unwrapped.spec.to_json() if make is gym.make_vec else made.spec.to_json()
    assert json.loads(again) == json.loads(text)
    return made


@settings(max_examples=25)
@given(
    world=st.sampled_from(WORLDS),
    perturbations=st.sampled_from(SCHEDULES),
    arm=st.sampled_from(["movemaster", own.ARMS["scara"], calfree_gym.Arm(**own.ARMS["scara"])]),
    camera_mount=st.sampled_from(["waist", "stand", ("stand", "waist")]),
    tolerance_px=st.sampled_from([4, 5.5, np.float64(3.3), np.int64(5), np.float32(0.1)]),
)
def test_json_makes_the_same_environment(world, perturbations, arm, camera_mount, tolerance_px):
    if arm != "movemaster" and not isinstance(world, str | WorldDistribution):
        world = calfree_gym.nominal(calfree_gym.Arm(**own.ARMS["scara"]).robot)
    env = gym.make(
        "CalFree/Reach-v0",
        world=world,
        perturbations=perturbations,
        arm=arm,
        camera_mount=camera_mount,
        tolerance_px=tolerance_px,
        tell=("joint_angles",),
        dynamics="kinematic",
        keep_in_view=False,
        disable_env_checker=True,
    )
    copied = remade(env)
    assert shown(copied) == shown(env)
    assert copied.unwrapped.arms.tolerance == env.unwrapped.arms.tolerance


def test_worlds_are_the_same_as_values_and_as_dicts():
    env = gym.make("CalFree/Reach-v0", world=WORLD)
    assert (
        gym.make("CalFree/Reach-v0", world=json.loads(json.dumps(WORLD.to_dict()))).reset(seed=0)[1]["truth"][
            "error_px"
        ]
        == env.reset(seed=0)[1]["truth"]["error_px"]
    )
    assert env.spec.kwargs["world"] == WORLD.to_dict()
    worlds = [WORLD.to_dict(), "wild", WORLD]
    rows = gym.make_vec("CalFree/Reach-v0", num_envs=3, world=worlds)
    rows.reset(seed=0)
    assert rows.unwrapped.worlds[0] == rows.unwrapped.worlds[2] == WORLD


def test_wrappers_stay_in_the_spec():
    env = ScaledWords(gym.make("CalFree/Reach-v0", world=WORLD, max_episode_steps=7), limit=0.5)
    copied = remade(env)
    assert isinstance(copied, ScaledWords)
    assert copied.spec == env.spec
    assert shown(copied) == shown(env)


def test_json_makes_the_same_rows():
    rows = gym.make_vec(
        "CalFree/Reach-v0",
        num_envs=3,
        world=[WORLD, "wild", WORLD.to_dict()],
        perturbations=SCHEDULES[2],
        autoreset_mode=AutoresetMode.SAME_STEP,
        max_episode_steps=3,
    )
    copied = remade(rows, gym.make_vec)
    assert copied.unwrapped.autoreset_mode is AutoresetMode.SAME_STEP
    assert shown(copied) == shown(rows)


@pytest.mark.parametrize("name", sorted(TYPES))
def test_every_perturbation_goes_through_json(name):
    events = parse_schedule([{"every": {"trial": 2}, "do": {"type": name}}])
    assert parse_schedule(json.loads(json.dumps([event.to_dict() for event in events]))) == events


def test_the_schedule_may_be_a_tuple_of_events():
    events = parse_schedule(PLAIN)
    assert [event.to_dict() for event in events] == PLAIN


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ("wrold", r"'wrold' .did you mean world.*; allowed: world, arm, camera_mount, .*render_mode"),
        ("tolerance", r"'tolerance' .did you mean tolerance_px"),
        ("zzz", r"got an unexpected keyword argument 'zzz'; allowed: "),
    ],
)
def test_a_wrong_keyword_gets_near_misses_and_the_allowed_names(wrong, said):
    with pytest.raises(TypeError, match=said):
        gym.make("CalFree/Reach-v0", **{wrong: "wild"})
    with pytest.raises(TypeError, match=said.replace("world, arm", ".*world, arm")):
        gym.make_vec("CalFree/Reach-v0", num_envs=2, **{wrong: "wild"})
