"""What nobody has measured on the bench, drawn by a seed: where cameras are, and how horns are fixed."""

from dataclasses import dataclass

import mujoco
import numpy as np

from tests.calfree_gym.lerobot.so101 import HOME, MOTORS

ASPECT = 4 / 3
CAMERAS = (0.55, 0.42, 0.52), (0.6, -0.36, 0.48)
"""To both sides of the arm, and high: from the front its hand hides the object; from lower, one of its balls
hides the other where the wrist has turned."""
TARGET = (0.24, 0.0, 0.13)
SPREAD = 0.55
"""Objects are where the gripper is with joints so many times 45 degrees from home, at most."""
IN_VIEW = 0.85
"""So far from the middle of an image, at most, as a share of its half."""


@dataclass
class World:
    """Cameras' poses and lenses; and of each motor the tick at joint zero, and which way it turns."""

    positions: np.ndarray
    axes: np.ndarray
    fovy: np.ndarray
    k1: np.ndarray
    zeros: np.ndarray
    signs: np.ndarray

    @classmethod
    def drawn(cls, rng, cameras=CAMERAS):
        """One in which cameras are about there."""
        target = TARGET + rng.normal(0, 0.015, 3)
        positions = np.array(cameras) + rng.normal(0, 0.03, (2, 3))
        rolls = zip(positions, rng.normal(0, 0.1, 2), strict=True)
        axes = np.array([looking(at, target, roll) for at, roll in rolls])
        signs = rng.choice([-1, 1], len(MOTORS))
        homes = rng.integers(1200, 2900, len(MOTORS))
        zeros = homes - signs * HOME * 4096 / (2 * np.pi)
        return cls(positions, axes, rng.uniform(43, 50, 2), rng.uniform(-0.1, -0.05, 2), zeros, signs)

    def knocked(self, camera, rng, metres=0.03, degrees=5.0):
        """Moves a camera, and turns it, each in a random direction."""
        way, axis = (each / np.linalg.norm(each) for each in rng.normal(size=(2, 3)))
        turn, rotation = np.zeros(4), np.zeros(9)
        mujoco.mju_axisAngle2Quat(turn, axis, np.radians(degrees))
        mujoco.mju_quat2Mat(rotation, turn)
        self.positions[camera] += metres * way
        self.axes[camera] = rotation.reshape(3, 3) @ self.axes[camera]

    def put_into(self, model):
        """Gives the model's cameras these poses."""
        for i, name in enumerate(("left", "right")):
            camera = model.camera(name)
            camera.pos[:], camera.fovy[:] = self.positions[i], self.fovy[i]
            mujoco.mju_mat2Quat(camera.quat, self.axes[i].ravel())

    def images(self, point):
        """Where a point (3,) in m is in both images (2, 2), as shares of their halves; lenses apart."""
        seen = np.einsum("cij,ci->cj", self.axes, point - self.positions)
        slopes = np.tan(np.radians(self.fovy) / 2)[:, None]
        return seen[:, :2] / -seen[:, 2:] / slopes / [ASPECT, 1]

    def shows(self, point):
        """Whether a point (3,) in m is well inside both images."""
        return np.abs(self.images(point)).max() < IN_VIEW


def looking(at, target, roll):
    """A camera's axes (3, 3), as columns, that looks from `at` to `target`."""
    back = (at - target) / np.linalg.norm(at - target)
    right = np.cross([np.sin(roll) * back[1], -np.sin(roll) * back[0], np.cos(roll)], back)
    right /= np.linalg.norm(right)
    return np.column_stack([right, np.cross(back, right), back])
