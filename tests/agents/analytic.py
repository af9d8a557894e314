"""The true Jacobian of the image points, from MuJoCo's own derivatives: what estimates are held against."""

import mujoco
import numpy as np

from calfree_gym.image import IMAGE_UNIT
from calfree_gym.robot.motors import JOINT_LIMITS, SPAN


def points_jacobian(env, registers=None):
    """∂(gripper and object points)/∂registers (8, 3), noise-free, with the arm at `registers` or where it is.

    The chain of the motor map's derivative, the kinematics' (mj_jac of the points and of the cameras, which
    turn with the waist on the waist mount), the pinhole's and the lens's.
    """
    arms = env.unwrapped.arms
    world = arms.world(0)
    registers = arms.registers[0] if registers is None else registers
    model, data = arms.simulation.snapshot(0)
    data.qpos[:] = arms.simulation.motors.joints(registers[None], np.array([0]))[0]
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)
    rows = []
    for point in ("gripper_point", "object_point"):
        site = model.site(point).id
        point_moves = np.zeros((3, model.nv))
        mujoco.mj_jacSite(model, data, point_moves, None, site)
        for i, camera in enumerate(("left", "right")):
            seen, moves = _in_camera(model, data, model.camera(camera).id, data.site_xpos[site], point_moves)
            rows.append(_image_motion(seen, moves, world, i))
    return np.concatenate(rows) @ _joints_by_registers(world, registers, data.qpos)


def distance_jacobian(env, registers=None):
    """∂d/∂registers (4, 3) of the image distance d."""
    jacobian = points_jacobian(env, registers)
    return jacobian[:4] - jacobian[4:]


def _in_camera(model, data, camera, point, point_moves):
    """A point (3,) in the camera's frame, and its derivative by the joint angles (3, nv)."""
    camera_moves, camera_turns = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    centre, axes = data.cam_xpos[camera], data.cam_xmat[camera].reshape(3, 3)
    mujoco.mj_jac(model, data, camera_moves, camera_turns, centre, model.cam_bodyid[camera])
    carried = np.cross(camera_turns.T, point - centre).T
    return axes.T @ (point - centre), axes.T @ (point_moves - camera_moves - carried)


def _image_motion(seen, moves, world, camera):
    """Derivative (2, nv) of the image point of a point seen at (3,), which moves by (3, nv)."""
    x, y, z = seen
    flat = np.array([x, -y]) / -z
    by_place = np.array([[1, 0, flat[0]], [0, -1, flat[1]]]) / -z
    k1 = world.lens_k1[camera]
    lens = (1 + k1 * flat @ flat) * np.eye(2) + 2 * k1 * np.outer(flat, flat)
    return world.focal_length[camera] * IMAGE_UNIT * lens @ by_place @ moves


def _joints_by_registers(world, registers, joints):
    """∂(J1..J5)/∂registers (5, 3): J4 holds the hand vertical until it meets its limit; J5 stands still."""
    slopes = world.motor_sign * world.motor_gain * SPAN
    slopes = slopes * (1 + world.motor_curvature * (3 * registers**2 - 1))
    jacobian = np.zeros((5, 3))
    jacobian[:3] = np.diag(slopes)
    if JOINT_LIMITS[3, 0] < joints[3] < JOINT_LIMITS[3, 1]:
        jacobian[3, 1:] = -slopes[1:]
    return jacobian
