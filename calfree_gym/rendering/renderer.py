"""OpenGL contexts without a window, in which any thread draws, and MuJoCo's renderer in one, off screen."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import gymnasium as gym
import mujoco
import numpy as np
from numpy.typing import NDArray

from calfree_gym.robot.simulation import keep_in_copies

Image = NDArray[np.uint8]
Picture = tuple[Image, NDArray[np.float32] | None]
"""Upside down, its first row is the lowest, as OpenGL has it: colours (height, width, 3); and depths (height,
width) along the camera's axis in m, where they are wanted."""

SHADOW_MAP = 512
"""Width and height of the shadow map. Choice: 1024 costs a fifth more time, and shadows stay soft."""
SLICES, STACKS = 12, 8
"""Of round geoms. Choice: vertices cost most of the time; with these a ball is round to 3 % of its
radius."""
FINER_BY, FINE_FROM = 2, 200
"""For people, in pictures of so many pixels, round geoms have so many times more slices and stacks, and
shadow maps are larger by the square of it. Choice: they take 1.7 times as long."""
SPARE = 1_000
"""Room in a scene beyond geoms and sites, for tendons, skins and the like; where that is full, it is doubled.
Choice."""
NO_SHADOW_MAP = 2
"""Width and height of a shadow map of which nothing is drawn: MuJoCo leaves a border of one pixel."""
FREE_NAMES = 10_000
"""OpenGL makes a texture of any name, a number; MuJoCo's own, a thousand at most, have the first ones."""
BACKENDS = ("egl", "osmesa", "glfw")
_lock = threading.RLock()
_bound: list[Any] = []
"""Contexts that are drawn in now: Python may free one while another is drawn in."""
_used = _is_copy = False
"""Whether a context was made here; and whether this process was forked from one that had used OpenGL."""


def gl_context(size: int) -> Any:
    """Makes a GL context, to draw in where it is `current`; MUJOCO_GL names its backend.

    Args:
        size: Width and height in pixels of its own surface, on which nothing is drawn.

    Raises:
        gymnasium.error.DependencyNotInstalled: There is none; names the package to install.
        RuntimeError: This process was forked from one that had used OpenGL.
    """
    global _used
    _refuse_copy()
    try:
        with _lock:
            context = _context(*_backend())(size, size)
            _used = True
        with current(context):
            return context
    except Exception as error:
        raise _missing(error) from error


@contextmanager
def current(context: Any) -> Iterator[None]:
    """Binds a GL context to this thread while it draws; others wait, and any thread may be the next.

    Raises:
        RuntimeError: This process was forked from one that had used OpenGL.
    """
    _refuse_copy()
    with _lock:
        context.make_current()
        _bound.append(context)
        try:
            yield
        finally:
            _bound.pop()
            if _bound:
                _bound[-1].make_current()
            else:
                _release(context)


def is_copy() -> bool:
    """Whether this process was forked from one that had used OpenGL: its calls may wait for ever here."""
    return _is_copy


def _refuse_copy() -> None:
    if _is_copy:
        raise RuntimeError(
            "no image can be rendered: this process was forked from one that had used OpenGL, which does not "
            'survive that. Start processes with context="spawn" (stable-baselines3: start_method="spawn"), '
            "or step many arms in one process with gym.make_vec"
        )


def _note_copy() -> None:
    global _is_copy
    display = getattr(sys.modules.get("mujoco.egl"), "EGL_DISPLAY", None)  # others' renderers use it, too
    _is_copy = _is_copy or _used or display is not None


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_note_copy)


def _release(context: Any) -> None:
    """Leaves no context of the backend of `context` current in this thread."""
    backend: Any = sys.modules[type(context).__module__]
    if hasattr(backend, "EGL"):
        none = backend.EGL.EGL_NO_SURFACE, backend.EGL.EGL_NO_SURFACE, backend.EGL.EGL_NO_CONTEXT
        backend.EGL.eglMakeCurrent(backend.EGL_DISPLAY, *none)
    elif hasattr(backend, "osmesa"):
        backend.osmesa.OSMesaMakeCurrent(None, None, backend.GL.GL_FLOAT, 0, 0)
    else:
        backend.glfw.make_context_current(None)


def drawing_context(model: mujoco.MjModel) -> mujoco.MjrContext:
    """What MuJoCo draws a model with, off screen, in the GL context that is current.

    Raises:
        gymnasium.error.DependencyNotInstalled: OpenGL cannot draw; names the package to install.
    """
    try:
        context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_50)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, context)
        mujoco.mjr_addAux(0, 1, 1, 0, context)
    except Exception as error:
        raise _missing(error) from error
    return context


def _backend() -> tuple[str, bool]:
    """The name of the backend, and whether there is a screen."""
    windowed = bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    return os.environ.get("MUJOCO_GL", "").lower() or ("glfw" if windowed else "egl"), windowed


def _missing(error: Exception) -> gym.error.DependencyNotInstalled:
    backend, _ = _backend()
    return gym.error.DependencyNotInstalled(
        f"no image can be rendered: the GL backend {backend!r} failed ({error or type(error).__name__}). "
        "Without a screen, install EGL (Debian: libegl1 and libgl1-mesa-dri) or OSMesa (libosmesa6) and set "
        "MUJOCO_GL=egl or MUJOCO_GL=osmesa. Nothing but images needs it."
    )


def _context(backend: str, windowed: bool) -> Any:
    if backend == "egl":
        from mujoco.egl import GLContext
    elif backend == "osmesa":
        from mujoco.osmesa import GLContext
    elif backend == "glfw":
        if not windowed:
            raise RuntimeError("it needs a screen, and neither DISPLAY nor WAYLAND_DISPLAY is set")
        from mujoco.glfw import GLContext
    else:
        raise ValueError(f"MUJOCO_GL names no renderer; allowed: {', '.join(BACKENDS)}")
    return GLContext


class View(NamedTuple):
    """From where, and how large, a picture is: width and height are in pixels."""

    camera: mujoco.MjvCamera
    width: int
    height: int


class Renderer:
    """Renders pictures of one model, whose state and fields may change from picture to picture.

    There is no multisampling: it costs more than all else together, and image points are found as well
    without. Makes its GL context when it is made.

    Attributes:
        model: The model.
        data: Its state.

    Args:
        model: See above; its settings of quality are changed.
        data: See above.
        size: Width and height of the largest picture that is usual; larger ones take a moment longer once.
        for_people: Whether glass casts no shadow, and large pictures are finer, which takes longer.

    Raises:
        gymnasium.error.DependencyNotInstalled: OpenGL is missing; names the package to install.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, size: int, for_people: bool = False
    ) -> None:
        self._gl: Any = None
        self.model, self.data = model, data
        quality = model.vis.quality
        finer = FINER_BY if for_people and size >= FINE_FROM else 1
        quality.offsamples, quality.shadowsize = 0, finer**2 * SHADOW_MAP
        quality.numslices, quality.numstacks, quality.numquads = finer * SLICES, finer * STACKS, 1
        model.vis.global_.offwidth = model.vis.global_.offheight = size
        self._size, self._for_people = (size, size), for_people
        self._gl = gl_context(size)
        with current(self._gl):
            self._context = drawing_context(model)
        self._options = mujoco.MjvOption()
        self._options.sitegroup[:] = 0  # they are no things
        self._scene = mujoco.MjvScene(model, maxgeom=model.ngeom + SPARE)
        keep_in_copies(self)

    def draw(
        self, views: Sequence[View], groups: Sequence[int], shadows: bool = True, depth: bool = False
    ) -> list[Picture]:
        """Pictures of the model as it is now.

        Args:
            views: One a picture.
            groups: Of the geoms that are shown.
            shadows: Whether the lamp casts shadows.
            depth: Whether depths are wanted, too.
        """
        self._options.geomgroup[:] = np.isin(range(mujoco.mjNGROUP), groups)
        self._update(views[0].camera)
        if self._for_people:
            self._let_light_through()
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shadows
        with current(self._gl):
            first, *others = views
            pictures = [self._draw(first, depth)]
            with self._shadow_map_kept():
                return pictures + [self._draw(view, depth) for view in others]

    def _draw(self, view: View, depth: bool) -> Picture:
        camera, width, height = view
        if width > self._size[0] or height > self._size[1]:
            self._size = max(width, self._size[0]), max(height, self._size[1])
            mujoco.mjr_resizeOffscreen(*self._size, self._context)
        mujoco.mjv_updateCamera(self.model, self.data, camera, self._scene)
        viewport = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(viewport, self._scene, self._context)
        image = np.empty((height, width, 3), np.uint8)
        buffer = np.empty((height, width), np.float32) if depth else None
        mujoco.mjr_readPixels(image, buffer, viewport, self._context)
        return image, None if buffer is None else self._metres(buffer)

    @contextmanager
    def _shadow_map_kept(self) -> Iterator[None]:
        """Takes the shadow map from the picture before: MuJoCo draws the next one elsewhere, without size."""
        context = self._context
        kept = context.shadowFBO, context.shadowSize
        context.shadowFBO, context.shadowSize = int(context.auxFBO[0]), NO_SHADOW_MAP
        try:
            yield
        finally:
            context.shadowFBO, context.shadowSize = kept

    def _update(self, camera: mujoco.MjvCamera) -> None:
        """Puts all that is shown into the scene, which grows until nothing is left out."""
        everything = int(mujoco.mjtCatBit.mjCAT_ALL)
        while True:
            mujoco.mjv_updateScene(
                self.model, self.data, self._options, None, camera, everything, self._scene
            )
            if self._scene.ngeom < self._scene.maxgeom:
                return
            self._scene = mujoco.MjvScene(self.model, maxgeom=2 * self._scene.maxgeom)

    def _let_light_through(self) -> None:
        """Makes glass clearer, and decoration, which casts no shadow."""
        for geom in self._scene.geoms[: self._scene.ngeom]:
            if geom.rgba[3] < 1:
                geom.category, geom.rgba[3] = int(mujoco.mjtCatBit.mjCAT_DECOR), geom.rgba[3] / 2

    def use_texture(self, texture: int, name: int, pixels: Image | None = None) -> None:
        """Draws with another texture from now on.

        Args:
            texture: Of the model, whose place it takes.
            name: OpenGL's: of one that was given pixels before, or any from `FREE_NAMES` on.
            pixels: Its new ones (height, width, 3).
        """
        self._context.texture[texture] = name
        if pixels is not None:
            first = self.model.tex_adr[texture]
            self.model.tex_data[first : first + pixels.size] = pixels.ravel()
            with current(self._gl):
                mujoco.mjr_uploadTexture(self.model, self._context, texture)

    def _metres(self, buffer: NDArray[np.float32]) -> NDArray[np.float32]:
        """Depths in m of a depth buffer."""
        planes, extent = self.model.vis.map, self.model.stat.extent
        near, far = planes.znear * extent, planes.zfar * extent
        return np.asarray(near * far / (far - buffer * (far - near)), np.float32)

    def close(self) -> None:
        """Frees the GL context; nothing can be drawn after that."""
        if self._gl is not None and not is_copy():
            with current(self._gl):
                self._context.free()
                self._gl.free()
            self._gl = None

    def __del__(self) -> None:
        # MuJoCo frees what it has drawn with in the context that is current then, which may be another's.
        if getattr(self, "_gl", None) is not None and not sys.is_finalizing():
            self.close()
