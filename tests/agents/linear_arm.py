"""An arm whose points registers move linearly: procedures can be followed in it by algebra."""

import numpy as np

from agents.base.observation import Observation
from calfree_gym.image import IMAGE_UNIT

HOME = np.array([[0.1, 0.1], [-0.2, 0.0], [0.3, -0.3], [0.0, 0.2]])


class LinearArm:
    """Points (4, 2) that registers move linearly; motors stop at bounds of their own."""

    def __init__(self, px_by_word, lowest=-1.0, highest=1.0, home=HOME):
        directions = np.array([[1, 0], [0, 1], [-0.6, 0.8], [0, 0]])
        self.jacobian = (directions[:, :, None] * np.asarray(px_by_word) * IMAGE_UNIT).reshape(8, 3)
        self.lowest, self.highest, self.home = lowest, highest, home
        self.registers = np.zeros(3)

    def observed(self, words=0.0):
        """What is seen after words (3,)."""
        self.registers = np.clip(self.registers + words, self.lowest, self.highest)
        points = self.home + (self.jacobian @ self.registers).reshape(4, 2)
        return Observation(points, np.ones(4, bool), self.registers.copy())
