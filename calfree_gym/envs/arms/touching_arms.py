"""N stereo arms that reach where things stand in the way, by motors of unknown strength."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from calfree_gym.envs.arms.stereo_arms import StereoArms
from calfree_gym.geometry import Array, Rows
from calfree_gym.robot.arms.robot import Mounts, Robot
from calfree_gym.robot.objects import ObjectDraws
from calfree_gym.robot.touching.simulation import CLEARANCE, TouchingSimulation
from calfree_gym.robot.workspace import ATTEMPTS
from calfree_gym.streams import stream
from calfree_gym.world import World, WorldDistribution, log_uniform

SEEN_WITH = 2.0
"""Whether the cameras see enough of what motors reach is judged with this gain: the largest of wild worlds,
by which they reach all of it."""


class TouchingArms(StereoArms):
    """N arms that can touch table, walls and themselves.

    Attributes:
        force_bound: Contact force (N) above which a trial ends.
        total_travel: Sum over a trial's motions (N,) of the travel of the joint that went farthest, in rad
            or m.
        harmed: Whether a contact of the trial was above the bound (N,).

    Args:
        rows: N.
        gains: The least and the largest factor of the motors' gains in worlds that are drawn.
        force_bound: Contact force (N) above which a trial ends.
        **arguments: See `StereoArms`.

    Raises:
        ValueError: See `StereoArms`; the arm touches something at home.
    """

    simulation: TouchingSimulation
    may_stop_short: ClassVar[bool] = True
    state_names: ClassVar[tuple[str, ...]] = (*StereoArms.state_names, "total_travel", "harmed")
    also_asks = "does the arm at home touch nothing, nor hide its mark"

    def __init__(
        self, rows: int, *, gains: tuple[float, float], force_bound: float, **arguments: Any
    ) -> None:
        self._gains, self.force_bound = gains, force_bound
        super().__init__(rows, dynamics="physics", **arguments)
        self.total_travel, self.harmed = np.zeros(rows), np.zeros(rows, bool)

    def _new_simulation(
        self, rows: int, robot: Robot, mounts: Mounts, dynamics: str, threads: int
    ) -> TouchingSimulation:
        return TouchingSimulation(rows, robot, mounts, threads)

    def _new_objects(self, keep_in_view: bool) -> ObjectDraws:
        free, tolerance = self.simulation.way_is_free, float(self.tolerance)
        return ObjectDraws(self._workspaces, self.motors, tolerance, keep_in_view, self._lines, free)

    def _draw_world(self, distribution: WorldDistribution, row: int, seed: int, trial: int) -> World:
        """See `Arms`: then each motor gets weaker or stronger, and still there is an object to reach."""
        world = super()._draw_world(distribution, row, seed, trial)
        strengths = stream(seed, "world_strength", trial)
        for _ in range(ATTEMPTS):
            factors = log_uniform(strengths, *self._gains, len(self.robot.motors))
            drawn = replace(world, motor_gain=world.motor_gain * factors)
            self.enter(row, drawn)
            if self._objects.exists(row):
                return drawn
        raise ValueError(
            f"motors of a {distribution.name} world are too weak with gains {list(self._gains)}: in "
            f"{ATTEMPTS} draws none left an object within reach, in view of both cameras, with nothing in "
            "the way to it"
        )

    def as_seen(self, world: World) -> World:
        """See `Arms`: what is seen does not depend on how strong motors are."""
        return replace(world, motor_gain=np.full(len(self.robot.motors), SEEN_WITH))

    def also_in_view(self, row: int) -> Callable[[World], bool]:
        """See `Arms`: nothing is touched at home."""
        also, can_begin = super().also_in_view(row), self.can_begin(row)
        return lambda world: can_begin(world) and (also is None or also(world))

    def can_begin(self, row: int) -> Callable[[World], bool]:
        """See `Arms`: nothing is touched at home."""

        def is_free(world: World) -> bool:
            self.motors.set_world(row, world)
            self.simulation.set_world(row, world)
            home = self.motors.joints(np.zeros((1, len(self.robot.motors))), np.array([row]))[0]
            return self.simulation.is_free(row, home)

        return is_free

    def next_objects(self, rows: NDArray[np.intp], given: Array | None) -> Array:
        """See `Arms`.

        Raises:
            ValueError: An arm touches something at home; or there is no object.
        """
        homes = self.motors.joints(np.zeros((len(rows), len(self.robot.motors))), rows)
        for row, home in zip(rows.tolist(), homes, strict=True):
            if not self.simulation.is_free(row, home):
                raise ValueError(
                    f"the arm of row {row} touches itself at home, or is nearer to table or walls than "
                    f"{CLEARANCE * self.robot.rig.scale:.3f} m: see its world"
                )
        return super().next_objects(rows, given)

    def begun(self, rows: Rows) -> None:
        """See `Arms`."""
        super().begun(rows)
        for part in self.simulation.touched:
            part[rows] = 0.0
        self.total_travel[rows], self.harmed[rows] = 0.0, False

    def execute(self, rows: Rows, words: Array) -> Array:
        """See `Arms`: registers tell where an arm stands that was stopped."""
        seconds = super().execute(rows, words)
        touched = self.simulation.touched
        for row in self._all[rows].tolist():
            if (share := touched.shares[row]) < 1:
                self.stopped_short(row, share)
        self.total_travel[rows] += touched.travel[rows]
        self.harmed[rows] |= touched.force[rows] > self.force_bound
        return seconds
