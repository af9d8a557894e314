"""Pictures: a camera image through its lens, and the scene with both camera images beside it."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import cv2
import gymnasium as gym
import mujoco
import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import Array
from calfree_gym.image import CAMERAS, IMAGE_SIZE
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.arms.robot import ROOM
from calfree_gym.robot.arms.scene import MARKS_GROUP, RIG_GROUP
from calfree_gym.vision.cameras import undistort
from calfree_gym.world import World

if TYPE_CHECKING:
    from calfree_gym.envs.stereo_arms import StereoArms

Image = NDArray[np.uint8]

SOURCE_SIZE = 1024
"""Pixels of the wider pinhole image from which the lens's image is taken."""
SCENE_SIZE = 720
GRIPPER_COLOUR, OBJECT_COLOUR = (242, 13, 140), (13, 179, 64)
_SHOWN = [0, 1, 2, MARKS_GROUP]
"""Groups of geoms: by custom those behind are for collisions."""


def _gl_context(size: int) -> Any:
    """Makes a GL context, when the first image is rendered.

    Raises:
        gymnasium.error.DependencyNotInstalled: OpenGL is missing; names the package to install.
    """
    windowed = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    backend = os.environ.get("MUJOCO_GL", "").lower() or ("glfw" if windowed else "egl")
    try:
        if backend == "egl":
            from mujoco.egl import GLContext
        elif backend == "osmesa":
            from mujoco.osmesa import GLContext
        elif backend == "glfw":
            from mujoco.glfw import GLContext
        else:
            raise ImportError(f"MUJOCO_GL={backend} names no renderer; allowed: egl, osmesa, glfw")
        context = GLContext(size, size)
        context.make_current()
    except Exception as error:
        raise gym.error.DependencyNotInstalled(
            f"no image can be rendered: the GL backend {backend!r} failed ({error}). Without a screen, "
            "install EGL (Debian: libegl1 and libgl1-mesa-dri) or OSMesa (libosmesa6) and set "
            "MUJOCO_GL=egl or MUJOCO_GL=osmesa. Nothing but images needs it."
        ) from error
    return context


class Renderer:
    """Renders MuJoCo scenes off screen. Makes its GL context when it is made."""

    def __init__(self) -> None:
        self._gl: Any = _gl_context(SOURCE_SIZE)
        self._context: mujoco.MjrContext | None = None

    def render(
        self, model: mujoco.MjModel, data: mujoco.MjData, camera: Any, size: int, groups: list[int]
    ) -> Image:
        """An image (size, size, 3) from an `MjvCamera`, of the geom groups given."""
        self._gl.make_current()
        if self._context is None:
            self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        options = mujoco.MjvOption()
        options.geomgroup[:] = 0
        options.geomgroup[groups] = 1
        scene = mujoco.MjvScene(model, maxgeom=200)
        everything = int(mujoco.mjtCatBit.mjCAT_ALL)
        mujoco.mjv_updateScene(model, data, options, None, camera, everything, scene)
        viewport = mujoco.MjrRect(0, 0, size, size)
        mujoco.mjr_render(viewport, scene, self._context)
        image = np.empty((size, size, 3), np.uint8)
        mujoco.mjr_readPixels(image, None, viewport, self._context)
        return np.ascontiguousarray(image[::-1])

    def close(self) -> None:
        """Frees the GL context."""
        if self._gl is not None:
            self._gl.make_current()
            if self._context is not None:
                self._context.free()
            self._gl.free()
            self._gl = None


def camera_image(
    renderer: Renderer,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    world: World,
    camera: int,
    marks_only: bool = False,
    prefix: str = "",
) -> Image:
    """What a camera sees (512, 512, 3), lens included.

    A pinhole image, wide enough for all that the lens shows, is rendered and remapped.
    """
    pixels = np.arange(IMAGE_SIZE) + 0.5 - IMAGE_SIZE / 2
    distorted = np.stack(np.meshgrid(pixels, pixels), -1) - world.principal_point[camera]
    lens_k1 = float(world.lens_k1[camera])
    rays, shown = undistort(distorted / world.focal_length[camera], lens_k1)
    half = float(np.abs(rays).max()) * 1.01
    place = model.camera(prefix + CAMERAS[camera]).id
    model.cam_intrinsic[place] = [model.cam_sensorsize[place, 0] / (2 * half)] * 2 + [0, 0]
    view = mujoco.MjvCamera()
    view.type = mujoco.mjtCamera.mjCAMERA_FIXED
    view.fixedcamid = place
    groups = [MARKS_GROUP] if marks_only else _SHOWN
    source = renderer.render(model, data, view, SOURCE_SIZE, groups)
    where = ((rays / half + 1) * SOURCE_SIZE / 2 - 0.5).astype(np.float32)
    image = cv2.remap(source, where[..., 0], where[..., 1], cv2.INTER_LINEAR)
    image[~shown] = 0
    return np.asarray(image, np.uint8)


class SceneRenderer:
    """Draws one arm: the scene, and at its side what both cameras see, with points and tolerance."""

    def __init__(self) -> None:
        self._renderer = Renderer()

    def draw(self, arms: StereoArms, row: int) -> Image:
        """A frame (720, 1080, 3) of one row."""
        model, data = arms.simulation.snapshot(row)
        world = arms.world(row)
        prefix = arms.simulation.prefix
        _dress_cameras(model, arms)
        mujoco.mj_kinematics(model, data)
        view = mujoco.MjvCamera()
        rig = arms.robot.rig
        ahead = (rig.target - rig.position.mean(0)) * [1, 1, 0]
        ahead /= np.linalg.norm(ahead)
        view.lookat[:] = rig.target + rig.scale * (0.15 * np.array([0, 0, 1]) - 0.2 * ahead)
        view.azimuth = 148.0 + np.degrees(np.arctan2(ahead[1], ahead[0]))
        view.distance, view.elevation = 1.75 * rig.scale, -22.0
        scene = self._renderer.render(model, data, view, SCENE_SIZE, [*_SHOWN, RIG_GROUP])
        insets = []
        for camera, name in enumerate(CAMERAS):
            image = camera_image(self._renderer, model, data, world, camera, prefix=prefix)
            points = arms.points[row].reshape(2, 2, 2)[:, camera]
            seen = arms.visible[row].reshape(2, 2)[:, camera]
            _draw_points(image, points, seen, float(arms.tolerance) * IMAGE_SIZE / 2)
            for colour, width in (((255, 255, 255), 5), ((30, 30, 30), 2)):
                cv2.putText(image, name, (14, 40), cv2.FONT_HERSHEY_SIMPLEX, 1.1, colour, width, cv2.LINE_AA)
            half = SCENE_SIZE // 2
            insets.append(cv2.resize(image, (half, half), interpolation=cv2.INTER_AREA))
        return np.hstack([scene, np.vstack(insets)])

    def close(self) -> None:
        """Frees the GL context."""
        self._renderer.close()


def _draw_points(image: Image, points: Array, seen: NDArray[np.bool_], tolerance_px: float) -> None:
    """Rings around the gripper and object points (2, 2), thin where not seen now; the tolerance."""
    shift = 4
    for point, now, colour in zip(points, seen, (GRIPPER_COLOUR, OBJECT_COLOUR), strict=True):
        center = np.round(((point + 1) * IMAGE_SIZE / 2 - 0.5) * 2**shift).astype(int).tolist()
        thickness = 2 if now else 1
        cv2.circle(image, center, 14 << shift, colour, thickness, cv2.LINE_AA, shift)
        if colour is OBJECT_COLOUR:
            radius = round(tolerance_px * 2**shift)
            cv2.circle(image, center, radius, (255, 255, 255), 1, cv2.LINE_AA, shift)


def _dress_cameras(model: mujoco.MjModel, arms: StereoArms) -> None:
    """Puts each camera's housing where the camera is, and its rod from the housing to the mount."""
    prefix, scale = arms.simulation.prefix, arms.robot.rig.scale
    for name, mount in zip(CAMERAS, arms.mounts, strict=True):
        camera = model.camera(prefix + name)
        position, turn = camera.pos.copy(), camera.quat.copy()
        foot = position * [1, 1, 0] if mount == ROOM else np.zeros(3)
        if arms.robot is MOVEMASTER and mount == "waist":
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
