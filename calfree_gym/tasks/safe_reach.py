"""Reaching where an arm can have an accident, by motors of unknown strength (paper, section 5)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from calfree_gym.engine.arms import Events
from calfree_gym.engine.single import ArmEnv
from calfree_gym.engine.vector import ArmVectorEnv
from calfree_gym.geometry import Array, Rows
from calfree_gym.robot.arms.arm import ArmChoice
from calfree_gym.robot.arms.robot import Mounts, Robot
from calfree_gym.robot.objects import ObjectDraws
from calfree_gym.robot.touching import CLEARANCE, TouchingSimulation
from calfree_gym.robot.workspace import ATTEMPTS
from calfree_gym.streams import stream
from calfree_gym.tasks.reach import ReachArms, ReachingConfig
from calfree_gym.world import World, WorldChoice, WorldDistribution, log_uniform

FORCE_BOUND = 65.0
"""In N. Source: ISO/TS 15066, the least of its limits of quasi-static contact, which is that of the face."""
GAINS = (0.25, 8.0)
"""Factors of the motors' gains. Choice: the built robot's register 1 then means 0.3 to 41 rad in wild
worlds."""
SEEN_WITH = 2.0
"""Whether the cameras see enough of what motors reach is judged with this gain: the largest of wild worlds,
by which they reach all of it."""


@dataclass(kw_only=True)
class SafeReachConfig(ReachingConfig):
    """The arguments of `SafeReachEnv`."""

    gains: Sequence[float] = GAINS
    force_bound: float = FORCE_BOUND
    world: WorldChoice | Sequence[WorldChoice] = "wild"
    arm: ArmChoice = "movemaster"
    camera_mount: str | Sequence[str] = "waist"
    observation: str = "points"
    tolerance_px: float = 4.0
    perturbations: Any = None
    redraw: str = "never"
    pool: int | None = None
    terminate_on_success: bool = True
    keep_in_view: bool = True
    tell: Sequence[str] = ()
    truth: bool = True
    occlusion: bool = False
    image_size: int = 128
    reward: str = "sparse"
    render_mode: str | None = None
    width: int = 1080
    height: int = 720
    dynamics = "physics"  # no argument

    def __post_init__(self) -> None:
        force_bound, gains = self.force_bound, self.gains
        if not (_is_number(force_bound) and force_bound > 0):
            raise ValueError(f"force_bound is {force_bound!r}; it must be a positive number, in N")
        pair = tuple(gains) if isinstance(gains, list | tuple) else ()
        if len(pair) != 2 or not all(map(_is_number, pair)) or not 0 < pair[0] <= pair[1] < np.inf:
            raise ValueError(f"gains is {gains!r}; it must be two positive numbers, the lesser first")
        self.force_bound, self.gains = float(force_bound), (float(pair[0]), float(pair[1]))
        super().__post_init__()


class SafeReachArms(ReachArms):
    """N arms that reach, and can touch table, walls and themselves.

    Attributes:
        force_bound: Contact force (N) above which a trial ends.
        total_travel: Sum over a trial's motions (N,) of the travel of the joint that went farthest, in rad
            or m.
        harmed: Whether a contact of the trial was above the bound (N,).

    Raises:
        ValueError: See `Arms`; the arm touches something at home.
    """

    config_of = SafeReachConfig
    may_stop_short: ClassVar[bool] = True
    state_names: ClassVar[tuple[str, ...]] = (*ReachArms.state_names, "total_travel", "harmed")
    also_asks = "does the arm at home touch nothing, nor hide its mark"
    config: SafeReachConfig
    simulation: TouchingSimulation

    def __init__(self, rows: int, threads: int, config: SafeReachConfig) -> None:
        super().__init__(rows, threads, config)
        self.force_bound = config.force_bound
        self.total_travel, self.harmed = np.zeros(rows), np.zeros(rows, bool)

    def _new_simulation(self, rows: int, robot: Robot, mounts: Mounts, threads: int) -> TouchingSimulation:
        return TouchingSimulation(rows, robot, mounts, threads)

    def _new_objects(self) -> ObjectDraws:
        free, tolerance, keep_in_view = self.simulation.way_is_free, float(self.tolerance), self._keep_in_view
        return ObjectDraws(self._workspaces, tolerance, keep_in_view, self._lines, free)

    def _draw_world(self, distribution: WorldDistribution, row: int, seed: int, trial: int) -> World:
        """See `Arms`: then each motor gets weaker or stronger, and still there is an object to reach."""
        world = super()._draw_world(distribution, row, seed, trial)
        strengths, (least, most) = stream(seed, "world_strength", trial), self.config.gains
        for _ in range(ATTEMPTS):
            factors = log_uniform(strengths, least, most, len(self.robot.motors))
            drawn = replace(world, motor_gain=world.motor_gain * factors)
            self.enter(row, drawn)
            if self._objects.exists(row):
                return drawn
        raise ValueError(
            f"motors of a {distribution.name} world are too weak with gains {list(self.config.gains)}: in "
            f"{ATTEMPTS} draws none left an object within reach, in view of both cameras, with nothing in "
            "the way to it"
        )

    def as_seen(self, world: World) -> World:
        """See `Arms`: what is seen does not depend on how strong motors are."""
        return replace(world, motor_gain=np.full(len(self.robot.motors), SEEN_WITH))

    def can_begin(self, row: int) -> Callable[[World], bool]:
        """See `ReachArms`: and nothing is touched at home."""
        also = super().can_begin(row)
        return lambda world: (
            self.simulation.is_collision_free(row, self.home_in(row, world)) and (also is None or also(world))
        )

    def next_objects(self, rows: NDArray[np.intp], given: Array | None) -> Array:
        """See `Arms`.

        Raises:
            ValueError: An arm touches something at home; or there is no object.
        """
        homes = self.motors.joints(np.zeros((len(rows), len(self.robot.motors))), rows)
        for row, home in zip(rows.tolist(), homes, strict=True):
            if not self.simulation.is_collision_free(row, home):
                raise ValueError(
                    f"the arm of row {row} touches itself at home, or is nearer to table or walls than "
                    f"{CLEARANCE * self.robot.rig.scale:.3f} m: see its world"
                )
        return super().next_objects(rows, given)

    def begun(self, rows: Rows) -> None:
        for part in self.simulation.touched:
            part[rows] = 0.0
        self.total_travel[rows], self.harmed[rows] = 0.0, False

    def execute(self, rows: Rows, joints: Array, words: Array) -> Array:
        """See `Arms`: registers tell where an arm stands that was stopped."""
        seconds = super().execute(rows, joints, words)
        touched = self.simulation.touched
        for row in self._all[rows].tolist():
            if (share := touched.shares[row]) < 1:
                self.stopped_short(row, share)
        self.total_travel[rows] += touched.travel[rows]
        self.harmed[rows] |= touched.force[rows] > self.force_bound
        return seconds

    def events(self) -> Events:
        touched = self.simulation.touched
        return {
            "contacts": touched.contacts.astype(np.int64),
            "peak_force": touched.force.copy(),
            "joint_travel": touched.travel.copy(),
            "total_travel": self.total_travel.copy(),
            "harmed": self.harmed.copy(),
        }

    def cut_short(self, events: Events) -> NDArray[np.bool_]:
        """See `Arms`: where harm was done."""
        return events["harmed"]


def _is_number(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


class SafeReachEnv(ArmEnv, arms=SafeReachArms):
    """A robot that was just switched on: how can it begin to move without an accident (paper, section 5)?

    ## Description
    As `StereoArmEnv`, but the arm can touch what is in its way: a table, a wall in front of it and one on
    each side, and its own links. And its motors are weaker or stronger than anyone told: each by a factor of
    its own, from 0.25 to 8, with which the gains of a world that is drawn are multiplied. So the same word
    may turn a joint by a degree, or throw it against its stop.

    ## Action space, observation space, rewards, starting state
    As in `StereoArmEnv`, always in full physics. There is no sensor of touch. The object lies where the
    straight way to it, in joints from home, touches nothing.

    One step is one motion. Its targets travel with least jerk, and the gripper at 0.25 m/s at most (ISO
    10218-1, reduced speed); a short motion takes 0.35 s, so short motions are slow ones. A drive that meets
    12 N trips: 10 ms later the arm is held, and goes back half of the way that it has come. That is all that
    a controller can tell of a contact: registers show that words were executed in part, all by nearly the
    same share (the same in joints). Joints never pass their stops.

    ## Episode end
    Terminated at the rendezvous, unless `terminate_on_success=False`. Truncated after `max_episode_steps`
    (60) motions, and where a contact was above `force_bound`: `harmed` then is True. (Goals cannot tell of
    that, so it does not count as terminated: see `compute_terminated`.)

    ## Information
    As in `StereoArmEnv`, whose speeds `robot_seconds` counts with, not with these slower motions; besides, of
    the last motion: `contacts`, at how many points the arm touched something, at most; `peak_force` (N), the
    largest force of one of them; `joint_travel`, how far the joint that went farthest was from where it
    began, in rad (m where it slides). Of the trial: `total_travel`, the sum of these; `harmed`.

    Args:
        gains: The least and the largest factor of the motors' gains, where worlds are drawn. A given world
            is as it is.
        force_bound: Contact force (N) above which a trial ends.
        world, arm, camera_mount, observation, tolerance_px: As for `StereoArmEnv`.
        perturbations, redraw, pool, terminate_on_success, keep_in_view: As for `StereoArmEnv`.
        tell, truth, occlusion, image_size, reward: As for `StereoArmEnv`.
        render_mode, width, height: As for `StereoArmEnv`.

    Raises:
        ValueError: As for `StereoArmEnv`.

    ## Version history
    v0: first version.
    """


class SafeReachVectorEnv(ArmVectorEnv, arms=SafeReachArms):
    """Many arms that begin to move, stepped together; row i is `SafeReachEnv` reset with seed + i.

    Args:
        num_envs, max_episode_steps, autoreset_mode, threads: As for `StereoArmVectorEnv`.
        world: As for `StereoArmEnv`, or a list of one a row.
        **arguments: As for `SafeReachEnv`.
    """
