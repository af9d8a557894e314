"""How near the tracker comes to the true places of drawn balls."""

import numpy as np

from calfree_gym.vision.marks import MARK_NAMES, Marks
from calfree_gym.vision.tracking.tracker import BallFinder, gripper_point


def compared(frames):
    """Visible share, error in px of a 512 image (nan where not found), per ball; and the gripper's errors."""
    finder, rows, gripper = BallFinder(Marks()), [], []
    for frame in frames:
        finder.reset()
        balls, scale = finder(frame.image), 512 / min(frame.image.shape[:2])
        for name in MARK_NAMES:
            error = np.hypot(*(balls[name].centre - frame.centre[name])) * scale if name in balls else np.nan
            rows.append((frame.visible[name], error))
        if min(frame.visible[name] for name in MARK_NAMES[:2]) > 0.95 and gripper_point(balls) is not None:
            (p, z1), (q, z2) = ((frame.centre[n], 1 / frame.radius[n]) for n in MARK_NAMES[:2])
            gripper.append(np.hypot(*(gripper_point(balls) - (z1 * p + z2 * q) / (z1 + z2))) * scale)
    return np.array(rows), np.array(gripper)
