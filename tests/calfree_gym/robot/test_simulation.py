"""Physics against the place where it should settle, and MuJoCo against closed form."""

import numpy as np
import pytest

from calfree_gym import MOUNTS, WorldDistribution
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.kinematic import KinematicSimulation
from calfree_gym.robot.motors import MotorMap
from calfree_gym.robot.simulation import DYNAMICS, ReachSimulation

ROWS = 32
EVERY = slice(None)


@pytest.fixture(params=MOUNTS)
def pair(request):
    worlds = [WorldDistribution("wild").sample(seed) for seed in range(ROWS)]
    made, motors = {}, MotorMap(ROWS, MOVEMASTER)
    for row, world in enumerate(worlds):
        motors.set_world(row, world)
    home, objects = motors.joints(np.zeros((ROWS, 3)), EVERY), np.tile([0.4, 0.1, 0.1], (ROWS, 1))
    for dynamics, kind in zip(DYNAMICS, (ReachSimulation, KinematicSimulation), strict=True):
        made[dynamics] = kind(ROWS, MOVEMASTER, MOVEMASTER.mounts(request.param), threads=1)
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


def test_what_follows_in_closed_form_is_what_mujoco_computes(pair):
    physics, kinematic, motors, _, _ = pair
    rng = np.random.default_rng(1)
    for _ in range(10):
        joints = motors.joints(rng.uniform(motors.lowest, motors.highest), EVERY)
        objects = rng.uniform([0.2, -0.3, 0.0], [0.6, 0.3, 0.3], (ROWS, 3))
        for simulation in (physics, kinematic):
            simulation.place(EVERY, joints, objects)
            simulation.refresh()
        for computed, closed in zip(physics.positions(), kinematic.positions(), strict=True):
            np.testing.assert_allclose(closed, computed, atol=1e-9)
        (pixels, depth), (closed, closed_depth) = physics.pinhole_pixels(), kinematic.pinhole_pixels()
        np.testing.assert_allclose(closed_depth, depth, atol=1e-9)
        near = (depth > 0.1) & (np.abs(pixels - 256) < 512).all(-1)
        assert near.sum() > ROWS
        np.testing.assert_allclose(closed[near], pixels[near], atol=1e-4)


def test_a_motion_leaves_the_models_flags_as_they_were(pair):
    """Sensors are off during a motion; contacts stay off and sensors come back after it."""
    physics, _, motors, _, mount = pair
    physics.move(EVERY, motors.joints(np.full((ROWS, 3), 0.1), EVERY))
    model = physics._batch.get_model(0)
    assert model.opt.disableflags == MOVEMASTER.scene(MOVEMASTER.mounts(mount)).model.opt.disableflags
