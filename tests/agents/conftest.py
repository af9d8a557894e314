"""What tests of agents share: environments to reach in, single observations, and whole trials."""

import gymnasium as gym
import numpy as np
import pytest

import agents
import calfree_gym
from agents.base.observation import Observation
from tests.agents.lengths import Lengths


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
def observe():
    """Makes an observation of given points (4, 2) in image units; all are seen, at home, unless said."""

    def make(points, registers=(0.0, 0.0, 0.0), visible=(True,) * 4, **privileged):
        return Observation(np.array(points, float), np.array(visible), np.array(registers), privileged)

    return make


@pytest.fixture(scope="session")
def live():
    """Lets an agent learn in an environment, and counts the motions of each trial.

    For so many whole trials, or for so many motions; then the last count is of a trial cut off. The seed,
    where there is one, draws the environment's world. Returns the agent and the counts.
    """

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
def answer():
    """Sends a procedure observations, one after the other; returns the words (n, m) that it asked for."""

    def send(procedure, observations):
        words = [next(procedure)]
        words += [procedure.send(observation) for observation in observations]
        return words

    return send
