"""Docking by vision: what is found in pictures against projection, and the promises of all environments."""

import copy
import pickle
import warnings

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from calfree_gym.image import lengths_px
from calfree_gym.robot.docking.base import MARKS, Base
from calfree_gym.vision.dock_tags import prints
from calfree_gym.world import WorldDistribution
from tests.calfree_gym.environments import alone, assert_same, make, together, trials

RNG = np.random.default_rng
STILL = np.zeros(2)


def dock(rows=None, **arguments):
    return make("Dock", rows, observation="vision", **arguments)


def built(**fields):
    of = WorldDistribution("nominal").sample(0, robot=Base("differential", 1, 4))
    return of.replace(**{"slip": 0} | fields)


@pytest.mark.parametrize("arguments", [{}, {"base": "omni", "cameras": 2, "dynamics": "physics"}])
def test_marks_are_found_where_projection_has_them(arguments):
    """In wild worlds, by all their blur, noise and light."""
    env = dock(**arguments).unwrapped
    off, flags = [], []
    for seed in range(3):
        for observation, info in trials(env, 3, seed):
            true = info["truth"]["points"].reshape(-1, 2)
            goals = np.concatenate([observation["achieved_goal"], observation["desired_goal"]])
            seen = observation["observation"][: len(true)] > 0
            off += lengths_px(goals.reshape(-1, 2) - true)[seen].tolist()
            flags += seen.tolist()
    assert np.median(off) <= 0.5
    assert np.max(off) < 2.5
    assert np.mean(flags) > 0.95


def found(env, pose):
    """Flags of the dock's marks (4,) and of the own ones (4,) from a pose."""
    observation, _ = env.reset(options={"pose": pose})
    return observation["observation"][:8].reshape(2, 4).astype(bool)


def test_a_mark_is_not_seen_outside_the_picture_or_behind_an_own_print():
    """Where that is, by a ray from the camera through the middle of an own print."""
    env = dock(world=built(), keep_in_view=False)
    env.reset(seed=0)
    assert found(env, (-1, 0, 0)).all()
    turned = found(env, (-1, 0, np.radians(35)))
    assert turned[1].all()
    assert not turned[0].all()
    eye, covered = np.array([0.1, 0, 0.5]), 0
    for tag in prints(4):
        mark = MARKS[tag.mark]
        at = mark - [0, *tag.middle]
        if tag.own and at[2] != eye[2] and (times := (mark - eye)[2] / (at - eye)[2]) > 1:
            away = mark - (eye + times * (at - eye))
            assert not found(env, (*away[:2], 0))[0, tag.mark]
            assert found(env, (away[0], 0, 0)).all()
            covered += 1
    assert covered


def test_worlds_and_starts_have_all_tags_in_view():
    for cameras in (1, 2):
        env = dock(cameras=cameras).unwrapped
        for seed in range(3):
            env.reset(seed=seed)
            assert env.arms._workspaces.seen(env.arms.rolling.before_dock()[:, None], np.array([0])).all()
    with pytest.raises(ValueError, match="all by tags of 13 pixels or more"):
        dock(world=built(focal_length=[130.0]))


def test_who_is_docked_sees_a_rendezvous():
    env = dock(world=built())
    env.reset(seed=0, options={"pose": (-0.02, 0, 0)})
    *_, terminated, _, info = env.step(np.array([0.02, 0.02]))
    assert terminated
    assert info["truth"]["offset_mm"] < 1


def test_checkers_pass_without_a_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(dock().unwrapped, skip_render_check=True)


def test_rows_are_single_environments_and_copies_go_on_alike():
    schedule = [{"at": {"motion": 1}, "do": {"type": "camera_aim", "camera": "front", "degrees": 5}}]
    schedule += [{"at": {"motion": 2}, "do": {"type": "latency", "motions": 1}}]
    words = RNG(0).uniform(-0.05, 0.05, (4, 2, 2)).astype(np.float32)
    envs = dock(rows=2, max_episode_steps=3, perturbations=schedule)
    rows = together(envs, words, seed=5)
    for row in range(2):
        single = dock(max_episode_steps=3, perturbations=schedule)
        assert_same(rows[row], alone(single, words[:, row], seed=5 + row))
    twins = copy.deepcopy(single), pickle.loads(pickle.dumps(single))
    single.reset()
    for twin in twins:
        twin.reset()
    after = single.step(words[0, 0])
    for twin in twins:
        assert_same(twin.step(words[0, 0]), after)
