"""True image points, their Jacobian and the rendezvous: what estimates are held against."""

import mujoco
import numpy as np

from calfree_gym.image import IMAGE_UNIT
from calfree_gym.robot.arms.movemaster import JOINT_LIMITS, SPAN


def points_jacobian(env, registers=None):
    """∂(gripper and object points)/∂registers (8, 3), noise-free, at `registers` or where the arm is."""
    return _points_and_jacobian(env, registers)[1]


def distance_jacobian(env, registers=None):
    """∂d/∂registers (4, 3) of the image distance d."""
    jacobian = points_jacobian(env, registers)
    return jacobian[:4] - jacobian[4:]


def points(env, registers=None):
    """Noise-free gripper and object points (4, 2), with the arm at `registers` (3,) or where it is."""
    return _points_and_jacobian(env, registers)[0].reshape(4, 2)


def rendezvous(env):
    """Registers (3,) at which gripper and object coincide in both images: Newton's method on true points."""
    registers = env.unwrapped.arms.registers[0].copy()
    for _ in range(20):
        true = points(env, registers)
        d = (true[:2] - true[2:]).ravel()
        registers = registers - np.linalg.lstsq(distance_jacobian(env, registers), d, rcond=None)[0]
    assert np.abs(d).max() < 1e-9, "there is no rendezvous"
    return registers


def _points_and_jacobian(env, registers):
    """Points (8,), and their derivative by the registers (8, 3)."""
    arms = env.unwrapped.arms
    world = arms.world(0)
    registers = arms.registers[0] if registers is None else registers
    model, data = arms.simulation.show(0, arms.simulation.picture())
    data.qpos[:] = arms.motors.joints(registers[None], np.array([0]))[0]
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)
    images, rows = [], []
    for point in ("gripper_point", "object_point"):
        site = model.site(point).id
        point_moves = np.zeros((3, model.nv))
        mujoco.mj_jacSite(model, data, point_moves, None, site)
        for i, camera in enumerate(("left", "right")):
            seen, moves = _in_camera(model, data, model.camera(camera).id, data.site_xpos[site], point_moves)
            image, motion = _image(seen, moves, world, i)
            images.append(image)
            rows.append(motion)
    jacobian = np.concatenate(rows) @ _joints_by_registers(world, registers, data.qpos)
    return np.concatenate(images), jacobian


def _in_camera(model, data, camera, point, point_moves):
    """A point (3,) in the camera's frame, and its derivative by the joint angles (3, nv)."""
    camera_moves, camera_turns = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    centre, axes = data.cam_xpos[camera], data.cam_xmat[camera].reshape(3, 3)
    mujoco.mj_jac(model, data, camera_moves, camera_turns, centre, model.cam_bodyid[camera])
    carried = np.cross(camera_turns.T, point - centre).T
    return axes.T @ (point - centre), axes.T @ (point_moves - camera_moves - carried)


def _image(seen, moves, world, camera):
    """The image point (2,) of a point seen at (3,), which moves by (3, nv); and its derivative (2, nv)."""
    x, y, z = seen
    flat = np.array([x, -y]) / -z
    by_place = np.array([[1, 0, flat[0]], [0, -1, flat[1]]]) / -z
    k1 = world.lens_k1[camera]
    bend = 1 + k1 * flat @ flat
    image = (world.focal_length[camera] * bend * flat + world.principal_point[camera]) * IMAGE_UNIT
    lens = bend * np.eye(2) + 2 * k1 * np.outer(flat, flat)
    return image, world.focal_length[camera] * IMAGE_UNIT * lens @ by_place @ moves


def _joints_by_registers(world, registers, joints):
    """∂(J1..J5)/∂registers (5, 3): J4 holds the hand vertical until it meets its limit; J5 stands still."""
    slopes = world.motor_sign * world.motor_gain * SPAN
    slopes = slopes * (1 + world.motor_curvature * (3 * registers**2 - 1))
    jacobian = np.zeros((5, 3))
    jacobian[:3] = np.diag(slopes)
    if JOINT_LIMITS[3, 0] < joints[3] < JOINT_LIMITS[3, 1]:
        jacobian[3, 1:] = -slopes[1:]
    return jacobian
