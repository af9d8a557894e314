"""Perturbations of one camera: its pose, its focal length, its lens."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from calfree_gym.geometry import quaternion_about, quaternion_between, quaternion_product
from calfree_gym.perturbations.base import (
    DRIFT_STEPS,
    Factor,
    Perturbation,
    amount,
    factor,
    one_of,
    setting,
    uniform,
    with_entry,
)
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.arms.robot import Robot
from calfree_gym.world import World, wild_camera, wilder_camera

_OPTICAL_AXIS = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True)
class CameraRoll(Perturbation):
    """Turns a camera about its optical axis by `degrees` (drawn: any angle)."""

    type: ClassVar[str] = "camera_roll"
    camera: str = one_of("cameras")
    degrees: float = amount(uniform(-180, 180))

    def change(self, world: World, robot: Robot = MOVEMASTER) -> World:
        return _turned(world, robot.cameras.index(self.camera), _OPTICAL_AXIS, self.degrees)

    def inverse(self) -> Perturbation:
        return replace(self, degrees=-self.degrees)


@dataclass(frozen=True)
class CameraAim(Perturbation):
    """Turns a camera's viewing direction by `degrees` (drawn: 3-15), towards `direction`.

    `direction` (drawn: any) is where the view moves, in degrees from the image's x to its y axis.
    """

    type: ClassVar[str] = "camera_aim"
    camera: str = one_of("cameras")
    degrees: float = amount(uniform(3, 15))
    direction: float = setting(uniform(-180, 180))

    def change(self, world: World, robot: Robot = MOVEMASTER) -> World:
        angle = math.radians(self.direction)
        axis = np.array([-math.sin(angle), -math.cos(angle), 0.0])
        return _turned(world, robot.cameras.index(self.camera), axis, self.degrees)

    def inverse(self) -> Perturbation:
        return replace(self, degrees=-self.degrees)


@dataclass(frozen=True)
class CameraZoom(Factor):
    """Multiplies a camera's focal length by `factor` (drawn: 0.8-1.25)."""

    type: ClassVar[str] = "camera_zoom"
    quantity: ClassVar[str] = "focal_length"
    camera: str = one_of("cameras")
    factor: float = factor(0.8, 1.25)


@dataclass(frozen=True)
class CameraShift(Perturbation):
    """Moves a camera, without turning it, by `metres` (drawn: 0.02-0.10), in a direction (drawn: any).

    `azimuth` is in degrees from the room's x axis to its y axis, `elevation` from the horizontal, with the
    arm at home as built; a camera on a link then goes with it.
    """

    type: ClassVar[str] = "camera_shift"
    camera: str = one_of("cameras")
    metres: float = amount(uniform(0.02, 0.10))
    azimuth: float = setting(uniform(-180, 180))
    elevation: float = setting(lambda rng: math.degrees(math.asin(rng.uniform(-1, 1))), least=-90, most=90)

    def change(self, world: World, robot: Robot = MOVEMASTER) -> World:
        camera = robot.cameras.index(self.camera)
        azimuth, elevation = math.radians(self.azimuth), math.radians(self.elevation)
        level = math.cos(elevation)
        direction = [level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation)]
        moved = world.camera_position[camera] + self.metres * np.array(direction)
        return with_entry(world, "camera_position", camera, moved)

    def inverse(self) -> Perturbation:
        return replace(self, metres=-self.metres)


@dataclass(frozen=True)
class CameraNearer(Perturbation):
    """Moves a camera by a `share` (drawn: 0.1-0.9) of the way to the next one, and turns it to its view.

    The last one's next is the first; a robot's only camera stays where it is.
    """

    type: ClassVar[str] = "camera_nearer"
    camera: str = one_of("cameras")
    share: float = amount(uniform(0.1, 0.9), least=-99, most=0.99)

    def change(self, world: World, robot: Robot = MOVEMASTER) -> World:
        camera = robot.cameras.index(self.camera)
        other = (camera + 1) % len(robot.cameras)
        here, there = world.camera_position[[camera, other]]
        views = world.camera_orientation
        world = with_entry(world, "camera_position", camera, here + self.share * (there - here))
        turned = quaternion_between(views[camera], views[other], self.share)
        return with_entry(world, "camera_orientation", camera, turned)

    def inverse(self) -> Perturbation:
        return replace(self, share=-self.share / (1 - self.share))


@dataclass(frozen=True)
class CameraReplace(Perturbation):
    """Replaces a camera by another, drawn from `seed` as in wild worlds; in wilder ones as there.

    Wilder worlds are those with unequal pixels.

    As a drift, the camera goes a hundredth of the way that is left in each step.
    """

    type: ClassVar[str] = "camera_replace"
    camera: str = one_of("cameras")
    seed: int = setting(lambda rng: int(rng.integers(2**31)), least=0, most=2**31, whole=True)

    def change(self, world: World, robot: Robot = MOVEMASTER) -> World:
        return self._moved(world, 1.0, robot)

    def drift(self, world: World, back: bool = False, robot: Robot = MOVEMASTER) -> World:
        return self._moved(world, -1 / (DRIFT_STEPS - 1) if back else 1 / DRIFT_STEPS, robot)

    def _moved(self, world: World, share: float, robot: Robot) -> World:
        """Moves the camera by this share of the way to the other one."""
        camera = robot.cameras.index(self.camera)
        for name, value in self._other(world, camera, robot).items():
            present = getattr(world, name)[camera]
            if name == "camera_orientation":
                value = quaternion_between(present, value, share)
            elif share < 1:
                value = present + share * (value - present)
            world = with_entry(world, name, camera, value)
        return world

    def _other(self, world: World, camera: int, robot: Robot) -> dict[str, Any]:
        """The fields of the other camera."""
        rng = np.random.default_rng(self.seed)
        if (world.pixel_aspect != 1).any():
            return wilder_camera(rng, robot.rig)
        square = {"principal_point": np.zeros(2), "lens_k2": 0.0, "pixel_aspect": 1.0}
        return {**wild_camera(rng, camera, robot.rig), **square}


@dataclass(frozen=True)
class Lens(Perturbation):
    """Sets a lens's radial distortion to `k1` (drawn: -0.08 to 0.08); as a drift, adds it."""

    type: ClassVar[str] = "lens"
    camera: str = one_of("cameras")
    k1: float = amount(uniform(-0.08, 0.08), least=-0.5, most=0.5)

    def change(self, world: World, robot: Robot = MOVEMASTER) -> World:
        return with_entry(world, "lens_k1", robot.cameras.index(self.camera), self.k1)

    def drift(self, world: World, back: bool = False, robot: Robot = MOVEMASTER) -> World:
        present = float(world.lens_k1[robot.cameras.index(self.camera)])
        return replace(self, k1=present + (-self.k1 if back else self.k1)).change(world, robot)


def _turned(world: World, camera: int, axis: Any, degrees: float) -> World:
    turn = quaternion_about(axis, math.radians(degrees))
    turned = quaternion_product(world.camera_orientation[camera], turn)
    return with_entry(world, "camera_orientation", camera, turned)
