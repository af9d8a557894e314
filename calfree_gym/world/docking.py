"""How worlds of mobile bases are drawn: as those of arms, and then track, slip, marks and aims."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calfree_gym.geometry import Array, quaternion_about, quaternion_product
from calfree_gym.robot.arms.robot import Robot
from calfree_gym.world.value import World

Draw = Callable[[str], np.random.Generator]
"""Gives the random stream of one group of world fields."""
SLIP = 0.01
"""Of the built base. Choice: on a hard floor."""
ROUGHLY = ("wild", "rough")
"""Distributions of bases that were never measured."""


def misaimed(orientations: Array, rng: np.random.Generator) -> Array:
    """Cameras (c, 4) that look up to 20 degrees off in any direction."""
    turns = [quaternion_about(rng.standard_normal(3), np.radians(rng.uniform(0, 20))) for _ in orientations]
    return np.stack([quaternion_product(*each) for each in zip(orientations, turns, strict=True)])


def on_wheels(name: str, world: World, draw: Draw, robot: Robot) -> World:
    """A base's world of the distribution of that name, from what is drawn of cameras, motors and images.

    Worlds of coarsely calibrated bases differ in nothing else. In wild ones cameras look up to 20 degrees off
    in any direction, the track is 0.8 to 1.25 times as long, marks are up to 5 cm off along each axis (those
    of robot and dock alike: they fit), and up to 2 % of a wheel's way slips.
    """
    world = world.replace(marks=robot.marks, slip=SLIP)
    if name not in ROUGHLY:
        return world
    return world.replace(
        camera_orientation=misaimed(world.camera_orientation, draw("base_aim")),
        link_lengths=robot.lengths * draw("track").uniform(0.8, 1.25, len(robot.lengths)),
        marks=robot.marks + draw("marks").uniform(-0.05, 0.05, robot.marks.shape),
        slip=draw("slip").uniform(0.0, 0.02),
    )
