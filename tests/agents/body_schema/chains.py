"""A chain with the joints of an arm in a MuJoCo file, and what it shows."""

from pathlib import Path

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from agents.body_schema.chain import PLACE, TURN, JointChain, Views
from agents.body_schema.fitting import Fit, Fitted, Gaussian, Known, any_std
from agents.memory.pairs import Pairs
from calfree_gym.image import IMAGE_UNIT

MODELS = Path(__file__).parents[2] / "arms" / "models"
HOMES = {"redundant.xml": (0.3, 0.6, -0.2, -0.9, 0.3, 0.6, 0.0)}
"""Positions of joints at home, in rad, where all zeros are singular."""
LENGTH = 1.5
"""Metres to the unit of lengths."""


class Arm:
    """An arm in MuJoCo, and the numbers of the same chain, told from MuJoCo's axes."""

    def __init__(self, file, site, mount=0):
        self.model = mujoco.MjModel.from_xml_path(str(MODELS / file))
        self.data = mujoco.MjData(self.model)
        self.site = self.model.site(site).id
        motors = self.model.njnt
        self.home = np.array(HOMES.get(file, np.zeros(motors)))
        self.spans = np.random.default_rng(3).uniform(0.6, 1.4, motors) * (-1.0) ** (np.arange(motors) + 1)
        self.chain = JointChain(motors, (mount, mount))
        self.numbers = np.zeros(self.chain.size)
        self._at(np.zeros(motors))
        for joint in range(motors):
            axis, anchor = self.data.xaxis[joint], self.data.xanchor[joint] * LENGTH
            slides = self.model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
            twist = np.r_[np.zeros(3), axis * LENGTH] if slides else np.r_[axis, -np.cross(axis, anchor)]
            self.numbers[self.chain.joint(joint)][:6] = twist * self.spans[joint]
        gripper = self.data.site_xpos[self.site] * LENGTH
        self.numbers[self.chain.gripper] = gripper
        for camera, way in enumerate([(1.0, -0.8, 0.7), (0.9, 0.9, 0.5)]):
            away = np.array(way) * 1.6
            axis = -away / np.linalg.norm(away)
            right = np.cross(axis, [0.0, 0.0, 1.0])
            right /= np.linalg.norm(right)
            turn = np.stack([right, np.cross(axis, right), axis])
            of_camera = self.numbers[self.chain.camera(camera)]
            of_camera[:2] = np.log(1.1 + 0.2 * camera), 0.04
            of_camera[TURN] = Rotation.from_matrix(turn).as_rotvec()
            of_camera[PLACE] = gripper + away

    def _at(self, registers):
        self.data.qpos[:] = self.home + registers * self.spans
        mujoco.mj_kinematics(self.model, self.data)

    def gripper(self, registers):
        """Where MuJoCo has the gripper (3,), in units of lengths."""
        self._at(registers)
        return self.data.site_xpos[self.site] * LENGTH

    def body_behind(self, mount, registers):
        """Rotation (3, 3) and position (3,) of the body that so many joints move."""
        self._at(registers)
        body = self.model.jnt_bodyid[mount - 1]
        return self.data.xmat[body].reshape(3, 3).copy(), self.data.xpos[body] * LENGTH

    def pinhole(self, place, camera):
        """The image point (2,) of a place (3,), by the definition of a pinhole with a lens."""
        log_focal, k1, *rest = self.numbers[self.chain.camera(camera)]
        before = Rotation.from_rotvec(rest[:3]).apply(place - np.array(rest[3:]))
        flat = before[:2] / before[2]
        return np.exp(log_focal) * flat * (1 + k1 * flat @ flat)

    def pairs(self, trials, looks=4, noise_px=0.5, seed=0, numbers=None):
        """What trials show, beginning at home, with noise."""
        random = np.random.default_rng(seed)
        numbers = self.numbers if numbers is None else numbers
        registers = random.uniform(-0.5, 0.5, (trials, looks, self.chain.motors))
        registers[:, 0] = 0.0
        registers = registers.reshape(-1, self.chain.motors)
        objects = random.uniform(-0.5, 0.5, (trials, self.chain.motors)).repeat(looks, 0)
        homes = Views(self.chain, numbers, objects, np.zeros((len(objects), 4))).points[:, :2].reshape(-1, 4)
        points = Views(self.chain, numbers, registers, homes).points
        points = points + random.normal(size=points.shape) * noise_px * IMAGE_UNIT
        gripper, objects = points[:, :2].reshape(-1, 4), points[:, 2:].reshape(-1, 4)
        homes, noise = objects[::looks].repeat(looks, 0), np.full(len(registers), max(noise_px, 0.1))
        return Pairs(registers, gripper, objects, homes, noise, np.arange(trials).repeat(looks))

    def known(self, pairs):
        """What is known of this chain, fitted to what was seen from where it really is."""
        before = Gaussian(self.numbers, Gaussian.of_any(self.chain).information)
        (fitted,) = Fit(self.chain, pairs, before)(self.numbers[None], steps=20)
        return Known(self.chain, before, pairs, fitted)

    @property
    def exact(self):
        """Known without any error."""
        sure = Gaussian(self.numbers, np.diag(1e12 / any_std(self.chain) ** 2))
        nothing = Pairs.none(self.chain.motors)
        return Known(self.chain, sure, nothing, Fitted(self.numbers, 0.0, np.zeros((0, 4, 2))))
