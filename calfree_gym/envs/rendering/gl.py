"""An OpenGL context without a window, or a clear word on what is missing."""

from __future__ import annotations

import os
from typing import Any

import gymnasium as gym
import mujoco

BACKENDS = ("egl", "osmesa", "glfw")


def gl_context(size: int) -> Any:
    """Makes a GL context, current in this thread; MUJOCO_GL names its backend.

    Args:
        size: Width and height in pixels of its own surface, on which nothing is drawn.

    Raises:
        gymnasium.error.DependencyNotInstalled: There is none; names the package to install.
    """
    try:
        context = _context(*_backend())(size, size)
        context.make_current()
    except Exception as error:
        raise _missing(error) from error
    return context


def drawing_context(model: mujoco.MjModel) -> mujoco.MjrContext:
    """What MuJoCo draws a model with, off screen, in the GL context that is current.

    Raises:
        gymnasium.error.DependencyNotInstalled: OpenGL cannot draw; names the package to install.
    """
    try:
        context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_50)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, context)
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
