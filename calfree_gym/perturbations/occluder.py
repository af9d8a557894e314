"""A thing that stands in the way: between one camera and a part of the work space."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from calfree_gym.geometry import Array
from calfree_gym.perturbations.base import Perturbation, amount, one_of, setting, uniform
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.arms.robot import Robot
from calfree_gym.robot.arms.scene import HALF_APART, RADIUS
from calfree_gym.robot.motors import MotorMap
from calfree_gym.robot.workspace import judging_draws
from calfree_gym.world import World

POINTS = 1_000
"""Of the work space by which shares are judged."""
CLEAR = HALF_APART + 2 * RADIUS
"""Sight lines pass the gripper at home at this distance (m, for the RV-M2), where the post begins."""
WIDEST = math.radians(60)
"""The largest half angle at which a post still begins beside the gripper at home."""
_STEPS = 40
"""Of bisections."""


@dataclass(frozen=True)
class Occluder(Perturbation):
    """Stands a post in a camera's way that hides a `share` (drawn: 0.1-0.4) of the work space; 0 removes it.

    That is the share of the gripper points there that the camera, with its mount at home, cannot see. The
    post stands `at` (drawn: 0.3-0.5) of the way from the camera to the gripper at home, on the side of that
    line where more of the work space lies: it hides the gripper at home only where `share` is more than that
    side has. As a drift, it hides a `share` more in each step. There is one post: that of
    another event takes its place.
    """

    type: ClassVar[str] = "occluder"
    at_home: ClassVar[bool] = True
    camera: str = one_of("cameras")
    share: float = amount(uniform(0.1, 0.4), least=0, most=0.8)
    at: float = setting(uniform(0.3, 0.5), least=0.1, most=0.8)

    def check_fits(self, robot: Robot) -> None:
        """See `Perturbation`: it hides an arm's work space."""
        if robot.wheels:
            raise ValueError("occluder hides an arm's work space from a camera; this robot is no arm")
        super().check_fits(robot)

    def change(self, world: World, robot: Robot = MOVEMASTER) -> World:
        return world.replace(occluder=self._posts(world, robot).hiding(self.share))

    def drift(self, world: World, back: bool = False, robot: Robot = MOVEMASTER) -> World:
        posts = self._posts(world, robot)
        share = posts.share_hidden(float(world.occluder[3])) + (-self.share if back else self.share)
        there = replace(self, share=round(share, 12))  # not below 0 by rounding
        return world.replace(occluder=posts.hiding(there.share))

    def _posts(self, world: World, robot: Robot) -> Posts:
        camera = world.camera_position[robot.cameras.index(self.camera)]
        return Posts(camera, *work_space(world, robot), self.at, CLEAR * robot.rig.scale)


def work_space(world: World, robot: Robot) -> tuple[Array, Array]:
    """The gripper at home (3,), and gripper points (n, 3) of the work space, in m."""
    motors, every = MotorMap(1, robot), slice(None)
    draws = judging_draws(max(robot.candidates, POINTS), len(robot.motors))[0]
    motors.set_world(0, world)
    home = motors.joints(np.zeros((1, len(robot.motors))), every)
    angles = motors.angles(robot.postures(draws), every)
    home, points = (robot.gripper_position(each, world.link_lengths) for each in (home, angles))
    return home[0], points[robot.within(points)][:POINTS]


class Posts:
    """Posts of any radius between a camera and a work space, each of which hides what thinner ones hide.

    Seen from above, they touch a line through the camera, which passes beside the gripper at home, all at one
    place. The thickest ones, which also hide what is on its other side, have one middle instead.

    Args:
        camera: Optical centre (3,).
        home: The gripper at home (3,).
        points: Of the work space (n, 3).
        at: Where they touch the line, as a share of the way to the gripper.
        clear: How far from the gripper that line passes (m).
    """

    def __init__(self, camera: Array, home: Array, points: Array, at: float, clear: float) -> None:
        self._camera, self._points = camera, points
        x, y, _ = home - camera
        far = max(math.hypot(x, y), 2 * clear)
        bearing, margin = math.atan2(y, x), math.asin(clear / far)
        aside = (np.arctan2(*(points - camera).T[1::-1]) - bearing + np.pi) % (2 * np.pi) - np.pi
        self._side = 1.0 if np.median(aside) > 0 else -1.0
        self._first = bearing + self._side * margin
        self._touch = at * far
        half = (float((self._side * aside).max()) - margin) / 2
        self._half = min(max(half, 0.01), WIDEST)
        self._radii = np.sort(self._hiding_each())
        self._shares = (np.arange(len(points)) + 0.5) / len(points)

    def hiding(self, share: float) -> Array:
        """The occluder (5,) that hides this share of the points."""
        radius = float(np.interp(share, [0, *self._shares], [0, *self._radii]))
        if radius == 0:
            return np.zeros(5)
        middle = self._middle(np.array(radius))
        _, heights = nearest(self._camera, self._points, middle)
        lowest, highest = min(heights.min(), self._points[:, 2].min()), heights.max()
        return np.array([*middle, (lowest + highest) / 2, radius, (highest - lowest) / 2])

    def share_hidden(self, radius: float) -> float:
        """Which share of the points a post of this radius hides."""
        return float(np.interp(radius, [0, *self._radii], [0, *self._shares]))

    def _middle(self, radius: Array) -> Array:
        """Seen from above (..., 2)."""
        half = np.minimum(np.arctan2(radius, self._touch), self._half)
        bearing, far = self._first + self._side * half, self._touch / np.cos(half)
        return self._camera[:2] + far[..., None] * np.stack([np.cos(bearing), np.sin(bearing)], -1)

    def _hiding_each(self) -> Array:
        """The radius (n,) from which on posts hide each point, by bisection."""
        thinnest = np.zeros(len(self._points))
        thickest = np.full(len(self._points), 0.99 * self._touch / math.cos(self._half))
        for _ in range(_STEPS):
            radius = (thinnest + thickest) / 2
            near = nearest(self._camera, self._points, self._middle(radius))[0] <= radius
            thinnest, thickest = np.where(near, thinnest, radius), np.where(near, radius, thickest)
        return thickest


def nearest(camera: Array, points: Array, middle: Array) -> tuple[Array, Array]:
    """Where sight lines pass an upright axis.

    Args:
        camera: Where they begin (3,).
        points: Where they end (n, 3).
        middle: Where the axis is, seen from above (2,) or (n, 2).

    Returns:
        Their smallest distances (n,), and their heights (n,) there, in m.
    """
    way, before = points - camera, middle - camera[:2]
    level = np.maximum((way[:, :2] ** 2).sum(-1), 1e-12)
    share = np.clip((way[:, :2] * before).sum(-1) / level, 0.0, 1.0)
    passing = camera + share[:, None] * way
    return np.linalg.norm(passing[:, :2] - middle, axis=-1), passing[:, 2]
