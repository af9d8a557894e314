"""Closed-form kinematics of the arm: where the gripper is at given joint angles."""

import numpy as np

from calfree_gym.geometry import Array


def gripper_position(joints: Array, link_lengths: Array) -> Array:
    """Gripper points (..., 3) in m, in the frame of the base.

    Args:
        joints: Angles of J1-J4 in rad (..., 4); J2 rises from the horizontal, J3 and J4 bend on.
        link_lengths: In m (..., 5), as in `World`.
    """
    base, shoulder, upper_arm, forearm, hand = (link_lengths[..., i] for i in range(5))
    waist = joints[..., 0]
    upper = joints[..., 1]
    fore = upper + joints[..., 2]
    grip = fore + joints[..., 3]
    radius = shoulder + upper_arm * np.cos(upper) + forearm * np.cos(fore) + hand * np.cos(grip)
    points = np.empty((*radius.shape, 3))
    points[..., 0] = radius * np.cos(waist)
    points[..., 1] = radius * np.sin(waist)
    points[..., 2] = base + upper_arm * np.sin(upper) + forearm * np.sin(fore) + hand * np.sin(grip)
    return points
