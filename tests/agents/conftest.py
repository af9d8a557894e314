"""What tests of agents share: environments to reach in, and whole trials."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import agents
import calfree_gym
from experiments.evaluation import evaluate
from tests.agents.trials import Lengths


@pytest.fixture(params=calfree_gym.MOUNTS)
def mount(request):
    """Where the cameras stand: a test that asks for it is run for each mount."""
    return request.param


@pytest.fixture(scope="session")
def make_env():
    """Makes an environment without dynamics; further options as `gym.make` takes them."""

    def make(mount="waist", **options):
        return gym.make("CalFree/Reach-v0", camera_mount=mount, **{"dynamics": "kinematic", **options})

    return make


@pytest.fixture(scope="session")
def noise_free(make_env):
    """Makes an environment in a wild world whose image points are exact, or as noisy as is said."""

    def make(mount, seed, point_noise=0.0, **options):
        env = make_env(mount, **options).unwrapped
        env.reset(seed=seed)
        env.set_world(replace(env.world, point_noise=np.asarray(point_noise)))
        return env

    return make


@pytest.fixture(scope="session")
def live():
    """Lets an agent learn in an environment, and counts the motions of each trial."""

    def learn(name, env, seed=None, trials=None, motions=None, **settings):
        log = Lengths(env)
        log.seed = seed
        agent = agents.make(name, log, **settings)
        if trials is None:
            return agent.learn(motions), log.lengths
        agent.learn(60 * trials, callback=lambda _: len(log.lengths) <= trials)
        return agent, log.lengths[:trials]

    return learn


@pytest.fixture(scope="session")
def reach(make_env):
    """Lets a new agent make one trial in each world."""

    def make_trials(name, seeds, mount="waist", options=None, **settings):
        records = []
        for seed in seeds:
            env = make_env(mount, **(options or {}))
            records += evaluate(agents.make(name, env, **settings), env, trials=1, seed=seed)
        share = np.mean([record.rendezvous for record in records])
        return share, *np.median([(record.motions, record.distance_mm) for record in records], axis=0)

    return make_trials
