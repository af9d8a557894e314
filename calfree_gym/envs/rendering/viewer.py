"""MuJoCo's viewer, in which one looks at an arm while it moves."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

import gymnasium as gym

from calfree_gym.envs.rendering.scene_frame import dress_cameras

if TYPE_CHECKING:
    from calfree_gym.envs.arms.base import Arms


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
