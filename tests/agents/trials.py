"""What tests do with agents again and again: make trials, answer procedures, compare what is kept."""

import gymnasium as gym
import numpy as np
import pytest

STAND_FIRST = ["stand", pytest.param("waist", marks=pytest.mark.slow)]
"""Mounts, for tests of many trials: the waist, where most tests have cameras, is left to the longer ones."""


class Lengths(gym.Wrapper):
    """Counts the motions of each trial."""

    def __init__(self, env):
        super().__init__(env)
        self.lengths = []
        self.seed = None

    def reset(self, **arguments):
        if self.seed is not None:
            arguments, self.seed = {"seed": self.seed, **arguments}, None
        self.lengths.append(0)
        return self.env.reset(**arguments)

    def step(self, action):
        self.lengths[-1] += 1
        return self.env.step(action)


def motions_of(agent, env, observation=None, **reset):
    """Makes one trial without learning, from a reset or from an observation."""
    if observation is None:
        observation, _ = env.reset(**reset)
    state, over = None, False
    while not over:
        words, state = agent.predict(observation, state)
        observation, _, arrived, late, info = env.step(words)
        over = arrived or late
        yield words, observation, arrived, info


def carry_out(procedure, observed, most=None):
    """Answers the words of a procedure by what is then `observed`, to its end or for so many motions."""
    sent = []
    try:
        words = next(procedure)
        while len(sent) != most:
            sent.append(words)
            words = procedure.send(observed(words))
    except StopIteration as end:
        return np.array(sent), end.value
    return np.array(sent), None


def assert_same_arrays(one, other):
    """That two which can be saved would save the same."""
    one, other = one.arrays(), other.arrays()
    assert one.keys() == other.keys()
    for name, array in one.items():
        np.testing.assert_array_equal(array, other[name], err_msg=name)
