"""The first wave's camera image, frozen: what pictures are measured against."""

from __future__ import annotations

from typing import Any

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from calfree_gym.image import IMAGE_SIZE
from calfree_gym.rendering.renderer import current, gl_context
from calfree_gym.robot.rays import SEEN
from calfree_gym.robot.simulation import Picture
from calfree_gym.vision.cameras import undistort
from calfree_gym.world import World


class FirstRenderer:
    """Twice as large a pinhole image, four samples a pixel, and a lens map made anew for every image.

    Args:
        picture: Model and state of the scene; the model's settings of quality are changed.
        size: Width and height of an image in pixels.
    """

    def __init__(self, picture: Picture, size: int) -> None:
        self._model, self._data = picture
        self._size, self._source = size, 2 * size
        model = self._model
        quality = model.vis.quality
        quality.offsamples, quality.shadowsize = 4, 2048
        model.vis.global_.offwidth = model.vis.global_.offheight = self._source
        self._gl: Any = gl_context(self._source)
        with current(self._gl):
            self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)

    def pair(self, world: World) -> list[NDArray[np.uint8]]:
        """What both cameras see, each (size, size, 3)."""
        return [self._image(world, camera) for camera in (0, 1)]

    def _image(self, world: World, camera: int) -> NDArray[np.uint8]:
        scale = self._size / IMAGE_SIZE
        pixels = np.arange(self._size) + 0.5 - self._size / 2
        distorted = np.stack(np.meshgrid(pixels, pixels), -1) - scale * world.principal_point[camera]
        rays, shown = undistort(
            distorted / (scale * world.focal_length[camera]), float(world.lens_k1[camera])
        )
        half = float(np.abs(rays).max()) * 1.01
        self._model.cam_intrinsic[camera] = [self._model.cam_sensorsize[camera, 0] / (2 * half)] * 2 + [0, 0]
        where = ((rays / half + 1) * self._source / 2 - 0.5).astype(np.float32)
        image = cv2.remap(self._pinhole(camera), where[..., 0], where[..., 1], cv2.INTER_LINEAR)
        image[~shown] = 0
        return np.asarray(image, np.uint8)

    def _pinhole(self, camera: int) -> NDArray[np.uint8]:
        view, options = mujoco.MjvCamera(), mujoco.MjvOption()
        view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, camera
        options.geomgroup[:] = np.isin(range(mujoco.mjNGROUP), SEEN)
        scene = mujoco.MjvScene(self._model, maxgeom=200)
        everything = int(mujoco.mjtCatBit.mjCAT_ALL)
        mujoco.mjv_updateScene(self._model, self._data, options, None, view, everything, scene)
        viewport = mujoco.MjrRect(0, 0, self._source, self._source)
        image = np.empty((self._source, self._source, 3), np.uint8)
        with current(self._gl):
            mujoco.mjr_render(viewport, scene, self._context)
            mujoco.mjr_readPixels(image, None, viewport, self._context)
        return np.ascontiguousarray(image[::-1])

    def close(self) -> None:
        """Frees the GL context."""
        with current(self._gl):
            self._context.free()
            self._gl.free()
