"""Perturb in Gymnasium's own environments, and as what Gymnasium expects of a wrapper."""

import pickle
import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest

from calfree_gym import ENV_IDS, Perturb
from tests.calfree_gym.environments import assert_same, begun
from tests.calfree_gym.perturb.workbench import arrays

pytest.importorskip("imageio", reason="Gymnasium's MuJoCo environments need imageio")
SCHEDULE = [
    {"at": {"step": 2}, "do": {"type": "light"}},
    {"every": {"step": 3}, "do": {"type": "motor_gain"}},
    {"at": {"step": 4}, "do": {"type": "latency"}},
    {"at": {"step": 6}, "undo": 0},
]


def life(envs, steps=10):
    actions = np.random.default_rng(0).uniform(-1, 1, (steps, *envs.action_space.shape)).astype(np.float32)
    found = [envs.reset(seed=3)]
    found += [envs.step(action) for action in actions]
    envs.close()
    return found


def test_it_can_be_made_again_from_its_spec():
    env = Perturb(gym.make("Reacher-v5"), SCHEDULE, seed=1, late=[()])
    assert env.spec.additional_wrappers[-1].kwargs["schedule"][0]["at"] == {"motion": 2}
    spec = gym.envs.registration.EnvSpec.from_json(env.spec.to_json())
    again = gym.make(spec)
    while not isinstance(again, Perturb):
        again = again.env
    assert_same(life(again), life(env))


def test_where_an_environment_is_pickled_as_made_anew_schedule_counts_and_world_go_on():
    env = begun(Perturb(gym.make("Reacher-v5"), SCHEDULE, seed=1))
    for _ in range(4):
        env.step(env.action_space.sample())
    again = pickle.loads(pickle.dumps(env))
    assert again.world == env.world
    assert_same(arrays(again.unwrapped.model), arrays(env.unwrapped.model))
    assert_same(life(again), life(env))
    assert env.applied == again.applied


def test_environments_of_our_own_say_which_mujoco_they_need():
    code = (
        "import sys; sys.modules['mujoco.batch'] = None\n"
        "import gymnasium, calfree_gym; calfree_gym.Perturb\n"
        "for name in calfree_gym.ENV_IDS:\n"
        "    try: gymnasium.make(name)\n"
        "    except gymnasium.error.DependencyNotInstalled as error: print(error)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.count("pip install 'mujoco>=3.17'") == len(ENV_IDS)
