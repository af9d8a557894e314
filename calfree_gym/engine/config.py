"""The arguments of environments: what every task has, checked; constructors are written from them."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from calfree_gym.errors import check_choice, check_flag, check_whole, known_arguments
from calfree_gym.image import IMAGE_SIZE
from calfree_gym.perturbations.schedule import parse_schedule
from calfree_gym.world import WorldChoice

RENDER_MODES = ("rgb_array", "human")
REWARDS = ("sparse", "dense")
REDRAWS = ("never", "trial")
LARGEST_POOL = 1_000_000
SMALLEST_IMAGE, LARGEST_IMAGE = 16, 1024
"""Width and height in pixels of images that are delivered."""
MOST_TOLERANCE = IMAGE_SIZE // 2
"""A tolerance is less, in pixels: what is hidden is shown farther away than that, and yet in the image."""
SMALLEST, LARGEST = 120, 4096
"""Width and height in pixels of frames."""


class Config:
    """The arguments that every task has, or that have one value where it lacks them.

    A task's own is a dataclass that lists all that its environments take, in the order of their
    documentation, and checks what is its own.
    """

    world: WorldChoice | Sequence[WorldChoice]
    camera_mount: str | Sequence[str]
    observation: str
    tolerance_px: float
    perturbations: Any
    redraw: str
    pool: int | None
    terminate_on_success: bool
    keep_in_view: bool
    truth: bool
    render_mode: str | None
    width: int
    height: int
    tell: Sequence[str] = ()
    image_size: int = IMAGE_SIZE
    reward: str = "sparse"

    def __post_init__(self) -> None:
        """Checks what all tasks share.

        Raises:
            ValueError: An argument is not allowed; says what was found and what is allowed.
        """
        check_choice("reward", self.reward, REWARDS)
        check_choice("redraw", self.redraw, REDRAWS)
        if self.pool is not None:
            check_whole("pool", self.pool, 1, LARGEST_POOL)
            if self.redraw != "trial":
                raise ValueError(
                    f"every trial takes a world of the pool: redraw is {self.redraw!r}, not 'trial'"
                )
        for name in ("truth", "terminate_on_success", "keep_in_view"):
            check_flag(name, getattr(self, name))
        check_whole("image_size", self.image_size, SMALLEST_IMAGE, LARGEST_IMAGE)
        tolerance = self.tolerance_px
        is_number = isinstance(tolerance, int | float | np.number) and not isinstance(tolerance, bool)
        if not (is_number and 0 < tolerance < MOST_TOLERANCE):
            raise ValueError(f"tolerance_px is {tolerance!r}; it must be a number in (0, {MOST_TOLERANCE})")
        if self.render_mode is not None:
            check_choice("render_mode", self.render_mode, RENDER_MODES)
        check_size(self.width, self.height)
        self.perturbations = parse_schedule(self.perturbations)  # an iterator would be used up


def check_told(tell: Any, allowed: Sequence[str]) -> None:
    """Raises ValueError where these are no names of privileged quantities."""
    if isinstance(tell, str) or not isinstance(tell, Sequence):
        such = tell if isinstance(tell, str) else allowed[0]
        raise ValueError(f"tell is {tell!r}; it must be a sequence of names, such as ({such!r},)")
    for name in tell:
        check_choice("tell", name, allowed)


def check_size(width: int, height: int) -> None:
    """Raises ValueError where no frame can have that size."""
    check_whole("width", width, SMALLEST, LARGEST)
    check_whole("height", height, SMALLEST, LARGEST)
    if width < height or height % 2:
        raise ValueError(
            f"width is {width} and height {height}; height must be even, and width at least as much"
        )


def constructor(owner: type, *configs: type[Any]) -> Callable[..., None]:
    """An `__init__` of `owner` that takes the fields of dataclasses by keyword; `_build` gets these."""
    fields_of = {config: {each.name: each for each in fields(config)} for config in configs}
    parameters = [inspect.Parameter("self", inspect.Parameter.POSITIONAL_OR_KEYWORD)]
    for each in (each for of_one in fields_of.values() for each in of_one.values()):
        written = {"default": each.default, "annotation": each.type}
        parameters.append(inspect.Parameter(each.name, inspect.Parameter.KEYWORD_ONLY, **written))

    def __init__(self: Any, **given: Any) -> None:
        made = (
            config(**{name: given[name] for name in of_one.keys() & given.keys()})
            for config, of_one in fields_of.items()
        )
        self._build(*made)

    __init__.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    __init__.__module__, __init__.__qualname__ = owner.__module__, f"{owner.__qualname__}.__init__"
    return known_arguments(__init__)
