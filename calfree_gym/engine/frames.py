"""What people see: frames of the scene with what the cameras see at its side, and MuJoCo's viewer."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import cv2
import gymnasium as gym
import mujoco
import numpy as np
from numpy.typing import NDArray

from calfree_gym.engine.arms import Arms
from calfree_gym.engine.config import check_size
from calfree_gym.geometry import Array, Flags
from calfree_gym.image import CAMERAS, PIXELS_PER_UNIT
from calfree_gym.rendering.renderer import Image, Renderer, View
from calfree_gym.rendering.stereo_images import FOR_PEOPLE, StereoImages
from calfree_gym.robot.arms.movemaster import Movemaster
from calfree_gym.robot.arms.robot import ROOM
from calfree_gym.robot.rays import RIG_GROUP, SEEN

FINER = 2
"""A scene is drawn so many times larger, and then reduced: so its edges are smooth."""
GRIPPER_COLOUR, OBJECT_COLOUR = (242, 13, 140), (13, 179, 64)
_SHIFT = 4
"""Bits of a pixel's fraction, in OpenCV's drawing."""


class RobotFrame(ABC):
    """Draws one robot: the scene, and what its cameras see, see `beside`, with points and tolerance.

    Args:
        arms: The robots.
        width: Of a frame, in pixels; at least its height, half of which is an image's.
        height: Of a frame, in pixels.

    Raises:
        ValueError: The size is not allowed.
    """

    _renderer: Renderer

    def __init__(self, arms: Arms, width: int, height: int) -> None:
        check_size(width, height)
        self._arms, self._image_size = arms, height // 2
        self._size = width - (len(arms.robot.cameras) > 1) * self._image_size, height

    def draw(self, row: int) -> Image:
        """A frame (height, width, 3) of one row."""
        scene, *images = self.views(row)
        shown = self._arms.shown(row)
        for camera, (image, name) in enumerate(zip(images, self._arms.robot.cameras, strict=True)):
            self.mark(image, camera, *shown)
            _write(image, name)
        return beside(scene, images)

    @abstractmethod
    def views(self, row: int, configuration: Array | None = None) -> list[Image]:
        """What a frame of one row is made of, without points.

        Args:
            row: The row.
            configuration: All that moves (q,), where it is to be other than now.

        Returns:
            The scene, and of each camera its image (height / 2, height / 2, 3).
        """

    @abstractmethod
    def mark(self, image: Image, camera: int, points: Array, seen: Flags, target: Array) -> None:
        """Draws what is shown, see `Arms.shown`, on the image of a camera."""

    @abstractmethod
    def _view(self) -> mujoco.MjvCamera:
        """From where the scene is drawn."""

    @abstractmethod
    def _housing(self, camera: int) -> str:
        """The name of a camera's housing."""

    def _scene(self, groups: Sequence[int]) -> Image:
        """The scene (height, width, 3) as model and state are now."""
        view = View(self._view(), *(FINER * side for side in self._size))
        ((scene, _),) = self._renderer.draw([view], groups)
        return reduced(scene[::-1], self._size)

    def camera_in_scene(self, camera: int) -> Array:
        """Where in the scene (x, y), in pixels, a camera's housing was drawn last."""
        model, data = self._renderer.model, self._renderer.data
        view, housing = self._view(), model.geom(self._housing(camera)).id
        azimuth, elevation = np.radians([view.azimuth, view.elevation])
        ahead = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), 0])
        ahead[2] = np.sin(elevation)
        right = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
        away = data.geom_xpos[housing] - (view.lookat - view.distance * ahead)
        middle = np.array(self._size) / 2
        focal = middle[1] / np.tan(np.radians(model.vis.global_.fovy) / 2)
        return np.asarray(middle + focal * np.array([right, np.cross(ahead, right)]) @ away / (ahead @ away))

    def close(self) -> None:
        """Frees the GL context."""
        self._renderer.close()


class SceneFrame(RobotFrame):
    """Draws one arm, and what both cameras see.

    Args:
        arms, width, height: See `RobotFrame`.
        as_agents_see: Whether camera images have the light and the covers of the world, by which agents see;
            else they have those of the scene, which people see best.

    Raises:
        ValueError: The size is not allowed.
        gymnasium.error.DependencyNotInstalled: OpenGL is missing; names the package to install.
    """

    def __init__(self, arms: Arms, width: int, height: int, as_agents_see: bool) -> None:
        super().__init__(arms, width, height)
        self._light = None if as_agents_see else FOR_PEOPLE
        self._images = StereoImages(arms.simulation, arms.robot.rig, self._image_size, for_people=True)
        self._renderer = self._images.renderer

    def views(self, row: int, configuration: Array | None = None) -> list[Image]:
        """See `RobotFrame`."""
        arms, images = self._arms, self._images
        left, right = images.colours(row, arms.world(row), configuration=configuration, light=self._light)
        images.shine(FOR_PEOPLE)
        model, data = images.picture
        dress_cameras(model, arms)
        mujoco.mj_kinematics(model, data)
        return [self._scene((*SEEN, RIG_GROUP)), left, right]

    def mark(self, image: Image, camera: int, points: Array, seen: Flags, target: Array) -> None:
        """See `RobotFrame`."""
        tolerance_px = float(self._arms.tolerance) * PIXELS_PER_UNIT
        draw_points(image, points[:, camera], seen[:, camera], target[0, camera], tolerance_px)

    def _housing(self, camera: int) -> str:
        return f"{self._arms.simulation.prefix}{CAMERAS[camera]}_housing"

    def _view(self) -> mujoco.MjvCamera:
        """From before and above the arm, at its side."""
        rig, view = self._arms.robot.rig, mujoco.MjvCamera()
        ahead = (rig.target - rig.position.mean(0)) * [1, 1, 0]
        ahead /= np.linalg.norm(ahead)
        view.lookat[:] = rig.target + rig.scale * (0.15 * np.array([0, 0, 1]) - 0.2 * ahead)
        view.azimuth = 148.0 + np.degrees(np.arctan2(ahead[1], ahead[0]))
        view.distance, view.elevation = 1.5 * rig.scale, -22.0
        return view


def reduced(picture: Image, size: tuple[int, int]) -> Image:
    """A picture of a smaller size, width and height."""
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)


def beside(scene: Image, images: Sequence[Image]) -> Image:
    """A frame: the scene, and at its side both cameras' images, one above the other.

    That of a single camera lies in the upper right corner of the scene.
    """
    if len(images) > 1:
        return np.hstack([scene, np.vstack(images)])
    (image,) = images
    frame, size = scene.copy(), len(image)
    edge = size + max(1, size // 100)
    frame[:edge, -edge:] = 255
    frame[:size, -size:] = image
    return frame


def draw_points(
    image: Image, points: Array, seen: NDArray[np.bool_], target: Array, tolerance_px: float
) -> None:
    """Draws rings around the gripper and object points (2, 2), thin where not seen now; and the tolerance.

    Args:
        image: A camera's (size, size, 3); it is drawn on.
        points: In image units.
        seen: Which of them (2,) were seen now.
        target: Where the tolerance is (2,), in image units.
        tolerance_px: In pixels of 512.
    """
    scale = len(image) / (2 * PIXELS_PER_UNIT)
    for point, now, colour in zip(points, seen, (GRIPPER_COLOUR, OBJECT_COLOUR), strict=True):
        _ring(image, point, 14 * scale, colour, 2 if now else 1)
    for colour, thickness in (((30, 30, 30), 3), ((255, 255, 255), 1)):
        _ring(image, target, tolerance_px * scale, colour, thickness)


def _ring(image: Image, point: Array, radius: float, colour: tuple[int, int, int], thickness: int) -> None:
    center = np.round(((point + 1) * len(image) / 2 - 0.5) * 2**_SHIFT).astype(int).tolist()
    cv2.circle(image, center, round(radius * 2**_SHIFT), colour, thickness, cv2.LINE_AA, _SHIFT)


def _write(image: Image, name: str) -> None:
    scale = len(image) / (2 * PIXELS_PER_UNIT)
    place = round(14 * scale), round(40 * scale)
    for colour, width in (((255, 255, 255), 3), ((30, 30, 30), 1)):
        cv2.putText(image, name, place, cv2.FONT_HERSHEY_SIMPLEX, 1.1 * scale, colour, width, cv2.LINE_AA)


def dress_cameras(model: mujoco.MjModel, arms: Arms) -> None:
    """Puts each camera's housing where the camera is, and its rod from the housing to the mount."""
    prefix, scale = arms.simulation.prefix, arms.robot.rig.scale
    for name, mount in zip(CAMERAS, arms.mounts, strict=True):
        camera = model.camera(prefix + name)
        position, turn = camera.pos.copy(), camera.quat.copy()
        foot = position * [1, 1, 0] if mount == ROOM else np.zeros(3)
        if isinstance(arms.robot, Movemaster) and mount == "waist":
            foot = np.array([0.0, 0.07 * np.sign(position[1]), 0.36])
        rod, housing = model.geom(f"{prefix}{name}_rod"), model.geom(f"{prefix}{name}_housing")
        axis = position - foot
        rod.pos[:] = (position + foot) / 2
        rod.size[:2] = 0.005 * scale, np.linalg.norm(axis) / 2
        mujoco.mju_quatZ2Vec(rod.quat, axis)
        housing.pos[:] = position
        housing.quat[:] = turn
        housing.size[:] = scale * np.array([0.022, 0.018, 0.035])
    model.geom_sameframe[:] = 0


class Viewer:
    """A window that shows one arm.

    Args:
        arms: The arms.

    Raises:
        gymnasium.error.DependencyNotInstalled: No window can be opened.
    """

    def __init__(self, arms: Arms) -> None:
        self._arms = arms
        self._picture = arms.simulation.picture()
        self._window: Any = None

    def draw(self, row: int) -> None:
        """Shows where everything of a row is now."""
        if self._window is None:
            self._open(row)
        with self._window.lock():
            self._show(row)
        self._window.sync()

    def _open(self, row: int) -> None:
        self._show(row)
        try:
            _need_a_screen()
            from mujoco import viewer

            self._window = viewer.launch_passive(*self._picture, show_left_ui=False, show_right_ui=False)
        except Exception as error:
            raise gym.error.DependencyNotInstalled(
                f"render_mode='human' cannot open MuJoCo's viewer ({error}); it needs a screen. Without one, "
                "use render_mode='rgb_array'"
            ) from error

    def _show(self, row: int) -> None:
        self._arms.simulation.show(row, self._picture)
        dress_cameras(self._picture[0], self._arms)

    def close(self) -> None:
        """Closes the window."""
        if self._window is not None:
            self._window.close()
            self._window = None


def _need_a_screen() -> None:
    """Raises where no window can be opened: MuJoCo's viewer then ends the whole process."""
    import glfw

    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        if not glfw.init():
            raise RuntimeError("; ".join(str(each.message) for each in said) or "GLFW cannot be initialized")
    glfw.terminate()
