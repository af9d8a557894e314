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
    angles = np.empty((4, *joints.shape[:-1]))  # of the waist, and of each link to the horizontal
    angles[0], angles[1] = joints[..., 0], joints[..., 1]
    angles[2] = angles[1] + joints[..., 2]
    angles[3] = angles[2] + joints[..., 3]
    (c, *along), (s, *up) = np.cos(angles), np.sin(angles)
    radius = shoulder + upper_arm * along[0] + forearm * along[1] + hand * along[2]
    points = np.empty((*radius.shape, 3))
    points[..., 0], points[..., 1] = radius * c, radius * s
    points[..., 2] = base + upper_arm * up[0] + forearm * up[1] + hand * up[2]
    return points
