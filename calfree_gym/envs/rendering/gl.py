"""An OpenGL context without a window, in which any thread draws; or a clear word on what is missing."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import gymnasium as gym
import mujoco

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
