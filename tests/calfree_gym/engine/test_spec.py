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
from tests.calfree_gym.environments import assert_same, kinematic, make

WORLD = calfree_gym.nominal()
WORLDS = ["nominal", WORLD, WORLD.to_dict(), WorldDistribution("coarse")]
PLAIN = [
    {"at": {"motion": 1}, "do": {"type": "camera_roll", "camera": "left", "degrees": 10.0}},
    {"drift": {"per": "motion"}, "do": {"type": "latency"}},
    {"at": {"motion": 3}, "undo": 0},
]
OF_VALUES = [
    PLAIN[0] | {"do": CameraRoll(camera="left", degrees=np.float64(10.0))},
    PLAIN[1] | {"do": Latency()},
    PLAIN[2],
]
SCHEDULES = [None, PLAIN, OF_VALUES, parse_schedule(PLAIN)]
SCARA = own.ARMS["scara"]


def shown(env, motions=4):
    """What an environment shows in some motions."""
    shape = env.action_space.shape
    found = [env.reset(seed=3)[0]]
    found += [env.step(np.full(shape, 0.05))[0] for _ in range(motions)]
    return [look[key].tolist() for look in found for key in sorted(look)]


def remade(env, make_it=gym.make):
    """By way of JSON, in which nothing is lost."""
    made = make_it(EnvSpec.from_json(env.spec.to_json()))
    assert json.loads(made.spec.to_json()) == json.loads(env.spec.to_json())
    return made


@settings(max_examples=25)
@given(
    world=st.sampled_from(WORLDS),
    perturbations=st.sampled_from(SCHEDULES),
    arm=st.sampled_from(["movemaster", SCARA, calfree_gym.Arm(**SCARA)]),
    camera_mount=st.sampled_from(["waist", "stand", ("stand", "waist")]),
    tolerance_px=st.sampled_from([4, 5.5, np.float64(3.3), np.int64(5), np.float32(0.1)]),
)
def test_json_makes_the_same_environment(world, perturbations, arm, camera_mount, tolerance_px):
    if arm != "movemaster" and not isinstance(world, str | WorldDistribution):
        world = calfree_gym.nominal(calfree_gym.Arm(**SCARA).robot)
    arguments = {"arm": arm, "camera_mount": camera_mount, "tolerance_px": tolerance_px}
    arguments |= {"world": world, "perturbations": perturbations, "tell": ("joint_angles",)}
    env = kinematic(keep_in_view=False, **arguments)
    copied = remade(env)
    assert shown(copied) == shown(env)
    assert copied.unwrapped.arms.tolerance == env.unwrapped.arms.tolerance


def test_worlds_are_the_same_as_values_and_as_dicts():
    env, plain = make(world=WORLD), make(world=json.loads(json.dumps(WORLD.to_dict())))
    assert_same(plain.reset(seed=0), env.reset(seed=0))
    assert env.spec.kwargs["world"] == WORLD.to_dict()
    rows = make(rows=3, world=[WORLD.to_dict(), "wild", WORLD])
    rows.reset(seed=0)
    assert rows.unwrapped.worlds[0] == rows.unwrapped.worlds[2] == WORLD


def test_wrappers_stay_in_the_spec():
    env = ScaledWords(make(world=WORLD, max_episode_steps=7), limit=0.5)
    copied = remade(env)
    assert isinstance(copied, ScaledWords)
    assert copied.spec == env.spec
    assert shown(copied) == shown(env)


def test_json_makes_the_same_rows():
    arguments = {"world": [WORLD, "wild", WORLD.to_dict()], "perturbations": OF_VALUES}
    mode = AutoresetMode.SAME_STEP
    rows = make(rows=3, autoreset_mode=mode, max_episode_steps=3, **arguments).unwrapped
    copied = remade(rows, gym.make_vec).unwrapped
    assert copied.autoreset_mode is mode
    assert shown(copied) == shown(rows)


@pytest.mark.parametrize("name", sorted(TYPES))
def test_every_perturbation_goes_through_json(name):
    events = parse_schedule((*PLAIN, {"every": {"trial": 2}, "do": {"type": name}}))
    plain = json.loads(json.dumps([event.to_dict() for event in events]))
    assert plain[:3] == PLAIN
    assert parse_schedule(plain) == events
