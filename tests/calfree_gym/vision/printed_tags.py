"""Drawn frames of printed tags, with the true places of gripper and object, by geometry of our own.

A pinhole camera looks at the gripper's print, an arch with two tags, and at the object's, a card with one. A
pixel is the mean of rays that meet the plane of a print. The camera adds blur, exposure with clipping, noise
and JPEG.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from tests.calfree_gym.vision.drawings import through_jpeg

CELL = 40 / 6
"""Of a tag, in mm."""
BITS = {
    0: ["1011", "0101", "0011", "0010"],
    1: ["0000", "1111", "1001", "1010"],
    2: ["0011", "0011", "0010", "1101"],
}
"""The inner cells of ArUco's first tags of 4 × 4: 1 is white."""
HEIGHT, WIDTH, FOCAL, DEPTH = 480, 640, 555.0, 600.0
"""Of the image in px, and of the prints' middles in mm: a tag that faces the camera has 37 px."""
FINE = 4
"""A pixel is the mean of so many each way; a cell of a tag has five times as many."""


def tag(number):
    """The cells of a tag and of its white margin (8, 8): white 1, black 0."""
    cells = np.ones((8, 8))
    cells[1:-1, 1:-1] = 0
    cells[2:-2, 2:-2] = [[int(bit) for bit in row] for row in BITS[number]]
    return cells


def arch(numbers=(0, 1)):
    """The gripper's print: its cells (12, 29), beside it -1, and where among them its middle is.

    Its legs have tags of these numbers, or none.
    """
    cells = np.ones((12, 29))
    cells[2:, 8:-8] = -1
    for number, leg in zip(numbers, (cells[4:, :8], cells[4:, -8:]), strict=True):
        leg[:] = 1 if number is None else tag(number)
    return cells, (14.5, 8)


def card():
    return tag(2), (4, 4)


@dataclass
class Pose:
    """Where the middle of a print is, (3,) in mm in the camera's axes, and its axes as columns (3, 3)."""

    middle: np.ndarray
    axes: np.ndarray

    @property
    def homography(self):
        """From places on the print, in mm from its middle, to places in the image, in px (3, 3)."""
        optics = [[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]]
        return optics @ np.stack([*self.axes.T[:2], self.middle], 1)


def random_pose(rng, place, tilt):
    """Of a print whose middle is seen at a place in px, tilted by at most `tilt` to the line of sight."""
    middle = DEPTH * np.array([*(np.subtract(place, [WIDTH / 2, HEIGHT / 2]) / FOCAL), 1])
    sight = middle / np.linalg.norm(middle)
    across = np.cross(sight, rng.normal(size=3))
    lean = rng.uniform(0, tilt)
    normal = np.cos(lean) * sight + np.sin(lean) * across / np.linalg.norm(across)
    first = np.cross(normal, rng.normal(size=3))
    first /= np.linalg.norm(first)
    return Pose(middle, np.stack([first, np.cross(normal, first), normal], 1))


def put(picture, cells, middle, pose, rng):
    """Puts a print, whose middle is so many cells from its corner, into a picture (h, w, 3)."""
    fine = 5 * FINE
    to_mm = np.array([[CELL / fine, 0, -CELL * middle[0]], [0, CELL / fine, -CELL * middle[1]], [0, 0, 1]])
    to_pixels = np.diag([FINE, FINE, 1]) @ pose.homography @ to_mm
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])  # OpenCV's zero is the middle of a pixel
    between = np.linalg.inv(half) @ to_pixels @ half
    black, white = rng.uniform(15, 50), rng.uniform(170, 240)
    light = np.where(cells == 1, white, black) * (cells >= 0)

    def seen(values):
        large = np.kron(values, np.ones((fine, fine))).astype(np.float32)
        image = cv2.warpPerspective(large, between, (FINE * WIDTH, FINE * HEIGHT))
        return cv2.resize(image, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)[..., None]

    share, light = seen(cells >= 0), seen(light)
    picture[:] = (1 - share) * picture + light


def camera(picture, rng):
    """What a webcam makes of a picture (h, w, 3), with exposure of 0.5 to 1.35 and JPEG of 55 to 92."""
    picture = cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.3, 1.2))
    picture = picture * rng.uniform(0.9, 1.1, 3) * rng.uniform(0.5, 1.35)
    picture = picture + rng.uniform(0, 6) * rng.normal(size=picture.shape)
    image = np.clip(np.round(picture), 0, 255).astype(np.uint8)
    return through_jpeg(image, int(rng.integers(55, 93)))


def random_frame(rng, behind, gripper=None, tilt=np.pi / 4):
    """An image (h, w, 3) of both prints, neither before the other, and where their middles are in px (2, 2).

    Args:
        rng: Of all that is drawn.
        behind: Draws what is behind them, as `drawings.background`.
        gripper: The gripper's print, if not `arch()`.
        tilt: The largest, in rad.
    """
    picture = behind(rng, HEIGHT, WIDTH).astype(np.float32)
    while True:
        places = rng.uniform((110, 110), (WIDTH - 110, HEIGHT - 110), (2, 2))
        if np.hypot(*(places[0] - places[1])) > 150:
            break
    poses = [random_pose(rng, place, tilt) for place in places]
    for print_, pose in zip((gripper or arch(), card()), poses, strict=True):
        put(picture, *print_, pose, rng)
    images = np.array([pose.homography[:, 2] for pose in poses])
    return camera(picture, rng), images[:, :2] / images[:, 2:]
