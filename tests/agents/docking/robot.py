"""A robot on wheels as plane geometry, to test what agents make of image points: no simulator of ours."""

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from calfree_gym.image import IMAGE_UNIT

WHEELS = {
    "differential": np.array([[0.5, 0.5], [0, 0], [-2.9, 2.9]]),
    "omni": np.array([[0.58, 0, -0.58], [0.33, -0.67, 0.33], [2.0, 2.0, 2.0]]),
}
"""From what wheels roll to how the base moves (3, m): ahead, to the left (m), turn (rad)."""
MARKS = np.array([[0.45, -0.1, 0.3], [0.45, 0.1, 0.35], [0.8, -0.15, 0.8], [0.8, 0.15, 0.85]])


def turned(axis, angle):
    """A rotation matrix about an axis through an angle."""
    x, y, z = axis / np.linalg.norm(axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


class Robot(gym.Env):
    """Docks where its camera sees the dock's marks where it sees its own."""

    LIMIT = 60

    def __init__(self, seed, base="differential", noise_px=0.0, slip=0.0, bend=0.3):
        self.rng = rng = np.random.default_rng(seed)
        self.noise, self.slip, self.tolerance = noise_px * IMAGE_UNIT, slip, 2.5 * IMAGE_UNIT
        self.wheels = WHEELS[base] * rng.uniform(0.5, 1.5) * rng.choice([-1, 1], WHEELS[base].shape[1])
        self.bend = rng.uniform(-bend, bend, self.wheels.shape[1])
        self.axes = turned([0, 0, 1], rng.uniform(-3, 3)) @ [[0, -1, 0], [0, 0, -1], [1, 0, 0]]
        self.axes = self.axes @ turned([0, 1, 0], -0.1) @ turned([0, 0, 1], rng.uniform(-0.2, 0.2))
        self.eye = np.array([0.05, 0.0, 0.55]) + rng.uniform(-0.05, 0.05, 3)
        self.focal = rng.uniform(0.9, 1.2)
        self.pose = np.zeros(3)
        motors, points = self.wheels.shape[1], len(MARKS)
        box = spaces.Box(-1, 1, (2 * points,), np.float32)
        state = spaces.Box(-np.inf, np.inf, (2 * points + motors,), np.float32)
        self.observation_space = spaces.Dict(achieved_goal=box, desired_goal=box, observation=state)
        self.action_space = spaces.Box(-1, 1, (motors,), np.float32)

    def knock(self, degrees, shift=0.0):
        """Turns the camera about any axis, and shifts it, so that it still sees its own marks."""
        axes, eye = self.axes, self.eye
        while True:
            self.axes = turned(self.rng.normal(size=3), np.radians(degrees)) @ axes
            self.eye = eye + self.rng.uniform(-shift, shift, 3)
            if self.seen(np.zeros(3))[1].all() and self.seen(np.array([-1.0, 0, 0]))[1].all():
                break

    def seen(self, pose):
        """Image points (4, 2) of the dock's marks from a pose (x, y, turn), and which are seen (4,)."""
        c, s = np.cos(pose[2]), np.sin(pose[2])
        there = (MARKS - [*pose[:2], 0]) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        x = (there - self.eye) @ self.axes.T
        points = self.focal * x[:, :2] / x[:, 2:]
        return points, (x[:, 2] > 0.05) & (np.abs(points) < 1).all(1)

    def drive(self, words):
        """Executes words (m,): all wheels turn in constant ratios."""
        roll = words + self.bend * np.abs(words) ** 1.5 * np.sign(words)
        ahead, left, turn = self.wheels @ (roll * (1 + self.slip * self.rng.normal(size=roll.shape)))
        way = np.exp(1j * self.pose[2]) * (ahead + 1j * left)
        way *= np.expm1(1j * turn) / (1j * turn) if abs(turn) > 1e-12 else 1
        self.pose = self.pose + np.array([way.real, way.imag, turn])

    def reset(self, seed=None, options=None):
        while True:
            self.pose = self.rng.uniform([-1.5, -0.5, -0.4], [-0.3, 0.5, 0.4])
            if self.seen(self.pose)[1].all():
                break
        self.count, self.odometer = 0, np.zeros(len(self.bend))
        self.last = self.seen(self.pose)[0]
        return self.look(), {"truth": self.pose}

    def look(self):
        """What is observed."""
        points, visible = self.seen(self.pose)
        noisy = points + self.noise * self.rng.normal(size=points.shape)
        self.last = np.where(visible[:, None], noisy, self.last)
        own, owns = self.seen(np.zeros(3))
        self.goal = own + self.noise * self.rng.normal(size=own.shape)
        self.arrived = visible.all() and np.hypot(*(self.last - self.goal).T).max() <= self.tolerance
        state = np.concatenate([visible, owns, self.odometer])
        return {
            "achieved_goal": self.last.ravel().astype(np.float32),
            "desired_goal": self.goal.ravel().astype(np.float32),
            "observation": state.astype(np.float32),
        }

    def step(self, words):
        words = np.clip(np.asarray(words, float), -1, 1)
        self.drive(words)
        self.count, self.odometer = self.count + 1, self.odometer + words
        observation = self.look()
        info = {"truth": self.pose, "is_success": bool(self.arrived)}
        return observation, -1.0, bool(self.arrived), self.count >= self.LIMIT, info
