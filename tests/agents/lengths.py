"""How many motions each trial took."""

import gymnasium as gym


class Lengths(gym.Wrapper):
    """Counts the motions of each trial.

    Attributes:
        lengths: Of each trial, the present one included.
        seed: Of the first reset, where one is given.
    """

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
