"""What was known in earlier worlds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from ..base.checks import checked_array
from ..base.observation import Array, camera_lengths_px
from ..base.storage import prefixed, under
from .home_view import HomeView

Arrays = Mapping[str, NDArray[Any]]


class Archive:
    """Keeps knowledge that was set aside, each with where the gripper was seen at home in its time.

    Attributes:
        worlds: Knowledge as named arrays, the latest last; "home" (4,) is the view at home, in image units.
    """

    KEPT = 8
    """This many worlds are kept. Choice: it bounds memory; each holds as many looks
    as `Remembered` keeps."""

    def __init__(self) -> None:
        self.worlds: list[Arrays] = []

    def add(self, known: Arrays, home: Array) -> None:
        """Sets aside what was known while the gripper at home was seen there (4,); drops the oldest."""
        self.worlds = [*self.worlds, {**known, "home": home}][-self.KEPT :]

    def find(self, gripper: Array, noise_px: float) -> Arrays | None:
        """The latest world in which the gripper at home was seen there (4,), as well as noise can tell."""
        near_px = HomeView.SIGMAS * noise_px
        for known in reversed(self.worlds):
            if (camera_lengths_px(gripper - known["home"]) < near_px).all():
                return known
        return None

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All worlds, as named arrays."""
        return {
            name: array
            for i, known in enumerate(self.worlds)
            for name, array in prefixed(f"archive/{i}", known).items()
        }

    def restore(self, arrays: Arrays) -> None:
        """Takes over what `arrays` returned.

        Raises:
            ValueError: Of a world it is not told where the gripper was seen at home.
        """
        self.worlds = []
        while known := under(f"archive/{len(self.worlds)}", arrays):
            checked_array(known, "home", (4,), allow_nan=True)
            self.worlds.append(known)
