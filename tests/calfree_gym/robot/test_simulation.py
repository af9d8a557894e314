"""Physics against the place where it should settle, and MuJoCo against closed form."""

import numpy as np
import pytest

from calfree_gym import MOUNTS, WorldDistribution
from calfree_gym.geometry import rotation_matrix
from calfree_gym.robot.arms.kinematics import gripper_position
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.motors import MotorMap
from calfree_gym.robot.simulation import DYNAMICS, ReachSimulation
from calfree_gym.vision.cameras import image_points, pinhole

ROWS = 32
EVERY = slice(None)


@pytest.fixture(params=MOUNTS)
def pair(request):
    worlds = [WorldDistribution("wild").sample(seed) for seed in range(ROWS)]
    made, motors = {}, MotorMap(ROWS, MOVEMASTER)
    for row, world in enumerate(worlds):
        motors.set_world(row, world)
    home, objects = motors.joints(np.zeros((ROWS, 3)), EVERY), np.tile([0.4, 0.1, 0.1], (ROWS, 1))
    for dynamics in DYNAMICS:
        mounts = MOVEMASTER.mounts(request.param)
        made[dynamics] = ReachSimulation(ROWS, MOVEMASTER, mounts, dynamics, threads=1)
        for row, world in enumerate(worlds):
            made[dynamics].set_world(row, world)
        made[dynamics].place(EVERY, home, objects)
    return made["physics"], made["kinematic"], motors, worlds, request.param


def test_a_motion_ends_settled_to_a_tenth_of_a_pixel(pair):
    physics, kinematic, motors, _, _ = pair
    rng = np.random.default_rng(0)
    for _ in range(20):
        joints = motors.joints(rng.uniform(motors.lowest, motors.highest), EVERY)
        for simulation in (physics, kinematic):
            simulation.move(EVERY, joints)
            simulation.refresh()
        (a, _), (b, depth) = physics.pinhole_pixels(), kinematic.pinhole_pixels()
        near = (depth > 0.1) & (np.abs(b - 256) < 256).all(-1)
        assert near.sum() > ROWS
        assert np.abs(a - b)[near].max() < 0.1


def test_image_points_follow_from_closed_form_kinematics_and_projection(pair):
    _, kinematic, motors, worlds, mount = pair
    rng = np.random.default_rng(1)
    for _ in range(10):
        kinematic.move(EVERY, motors.joints(rng.uniform(motors.lowest, motors.highest), EVERY))
        kinematic.refresh()
        pixels, depth = kinematic.pinhole_pixels()
        gripper, _ = kinematic.positions()
        for row, world in enumerate(worlds):
            joints = kinematic.joints()[row, :4]
            point = gripper_position(joints, world.link_lengths)
            np.testing.assert_allclose(point, gripper[row], atol=1e-12)
            if mount == "waist":
                point = gripper_position(joints * [0, 1, 1, 1], world.link_lengths)
            rotation = np.array([rotation_matrix(q) for q in world.camera_orientation])
            flat, closed_depth = pinhole(point, world.camera_position, rotation)
            np.testing.assert_allclose(closed_depth, depth[row, :2], atol=1e-9)
            images, _ = image_points(flat, world.focal_length[:, None] / 256, np.zeros(2), np.zeros(2))
            before = closed_depth > 0.1
            there = (images * 256 + 256)[before]
            np.testing.assert_allclose(there, pixels[row, :2][before], rtol=1e-6, atol=1e-3)


def test_a_motion_leaves_the_models_flags_as_they_were(pair):
    """Sensors are off during a motion; contacts stay off and sensors come back after it."""
    physics, _, motors, _, mount = pair
    physics.move(EVERY, motors.joints(np.full((ROWS, 3), 0.1), EVERY))
    model = physics._batch.get_model(0)
    assert model.opt.disableflags == MOVEMASTER.scene(MOVEMASTER.mounts(mount)).model.opt.disableflags
