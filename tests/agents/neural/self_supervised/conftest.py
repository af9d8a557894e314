"""What tests of self-taught networks share: a linear world whose every answer is known."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces

import agents


class LinearWorld(gym.Env):
    """Image points that registers move linearly: gripper = home + J registers; the object stands still."""

    def __init__(self, motors=3, seed=0, noise=0.0, outliers=0.0, unit=1.0, tolerance=0.03):
        self.rng = np.random.default_rng(seed)
        self.jacobian = 0.4 * np.linalg.qr(self.rng.normal(size=(4, 4)))[0][:, :motors]
        if motors > 4:
            self.jacobian = self.rng.normal(0, 0.2, (4, motors))
        self.signs, self.noise, self.outliers, self.unit = np.ones(motors), noise, outliers, unit
        self.tolerance, self.motors = tolerance, motors
        boxes = {"achieved_goal": 4, "desired_goal": 4, "observation": 4 + motors}
        self.observation_space = spaces.Dict({k: spaces.Box(-1.0, 1.0, (n,)) for k, n in boxes.items()})
        self.action_space = spaces.Box(-1.0, 1.0, (motors,))

    def reset(self, *, seed=None, options=None):
        self.registers, self.made = np.zeros(self.motors), 0
        self.object = self.jacobian @ self.rng.uniform(-0.6, 0.6, self.motors)
        return self._observation(), {}

    def step(self, action):
        self.registers, self.made = np.clip(self.registers + action, -1, 1), self.made + 1
        now = self._observation()
        near = np.linalg.norm(now["achieved_goal"] - now["desired_goal"]) <= self.tolerance * self.unit
        return now, 0.0, bool(near), self.made >= 30, {}

    def _observation(self):
        gripper = self.jacobian @ (self.signs * self.registers)
        points = np.concatenate([gripper, self.object]) + self.noise * self.rng.normal(size=8)
        mistaken = np.repeat(self.rng.random(4) < self.outliers, 2)
        points = self.unit * np.where(mistaken, self.rng.uniform(-1, 1, 8), points)
        return {
            "achieved_goal": np.float32(points[:4]),
            "desired_goal": np.float32(points[4:]),
            "observation": np.float32([*np.ones(4), *self.registers]),
        }


QUICK = {"hidden": (16,), "updates": 1, "batch": 128}


@pytest.fixture(scope="session")
def linear():
    """Makes a linear world and an agent that has learned in it."""

    def make(name="self_supervised", motions=200, settings=QUICK, **world):
        env = LinearWorld(**world)
        return agents.make(name, env, **settings).learn(motions), env

    return make
