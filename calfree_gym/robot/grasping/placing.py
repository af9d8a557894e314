"""Where things lie that can be grasped, and which of their marks the cameras see there."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from calfree_gym.geometry import Array, Flags
from calfree_gym.image import CAMERAS
from calfree_gym.robot.arms.movemaster import BEFORE_IT, DISTANCE, LIMIT_MARGIN, WAIST
from calfree_gym.robot.grasping.gripping_arm import AXIS, GrippingArm
from calfree_gym.robot.grasping.shapes import ShapeChoice, Thing, draw_thing
from calfree_gym.robot.objects import NOWHERE
from calfree_gym.robot.rays import shares_by_camera
from calfree_gym.robot.workspace import ATTEMPTS, CHECKED, MAX_REGISTER, Workspaces
from calfree_gym.streams import stream

if TYPE_CHECKING:
    from calfree_gym.robot.simulation import Simulation
    from calfree_gym.world.value import World

JAWS, EDGES = ("jaw_1_tip", "jaw_2_tip"), ("edge_1", "edge_2")
OF_A_JAW, OF_AN_EDGE = 0.016, 0.010
"""Radii of balls that stand for what marks them (m)."""
TOWARD_ENDS = 0.8
"""So far out on its axis a thing is seen at either end, too. Choice."""
LEAST_SHARE_OF_JAWS = 0.5
"""Of a jaw or an edge that must be in sight. Choice: its colour is then found."""


class InSight:
    """What the cameras of N worlds see past the arm.

    Args:
        simulation: The N worlds.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._picture = simulation.picture()
        model = self._picture[0]
        self._cameras = [model.camera(simulation.prefix + name).id for name in CAMERAS]
        self._jaws, self._edges = ([model.site(name).id for name in names] for names in (JAWS, EDGES))

    def gripper(self, row: int, joints: Array) -> bool:
        """Whether both cameras see both jaws, and an edge, with joints at (j,)."""
        _, data = self._simulation.show(row, self._picture, joints, NOWHERE)
        jaws = self._shares(data.site_xpos[self._jaws], OF_A_JAW)
        edges = self._shares(data.site_xpos[self._edges], OF_AN_EDGE)
        return bool(min(jaws.min(), edges.max(1).min()) >= LEAST_SHARE_OF_JAWS)

    def thing(self, row: int, thing: Thing, pose: Array, joints: Array) -> float:
        """The least share of a thing at a pose (4,) that a camera sees, with joints at (j,)."""
        self._simulation.show(row, self._picture, joints, NOWHERE)
        c, s = np.cos(pose[3]), np.sin(pose[3])
        x, y, z = TOWARD_ENDS * thing.axis
        ahead = np.array([c * x - s * y, s * x + c * y, z])
        return float(self._shares(pose[:3] + np.outer([0, 1, -1], ahead), thing.width / 4).min())

    def _shares(self, balls: Array, radius: float) -> Array:
        """Which share (2, k) of balls (k, 3) each camera sees."""
        return shares_by_camera(self._picture, self._cameras, balls, radius)


BLOCK = 32
"""Places that are judged at once."""
LIFTED = 0.18
"""Things are to be lifted to places at least so high (m): enough where 24 pixels are many mm, too."""
EXACT = 1e-6
"""The arm reaches what it comes so near to (m); a guard against rounding."""
BASE = 0.16
"""Nothing can lie nearer to the waist's axis than this (m): there the arm stands."""


LEAST_GRASPABLE = 0.2
"""Of the places on the table, so many must be graspable in a world that is drawn."""
LEAST_SHARE = 0.5
"""Of a thing that must be in sight with the gripper before it. Choice: from home all of it was seen."""


class Placed(NamedTuple):
    """What a trial begins with.

    Attributes:
        thing: To be grasped.
        pose: Where it lies (4,): x, y, z in m, and its angle about the vertical. Held in the air,
            where it is (7,): a quaternion instead of the angle.
        goal: The image point (4,) to which it is to be lifted, left and right.
    """

    thing: Thing
    pose: Array
    goal: Array


class Places:
    """Which places the gripper of N arms reaches, and both cameras see.

    Args:
        robot: The arm.
        workspaces: Of the N worlds.
    """

    def __init__(self, robot: GrippingArm, workspaces: Workspaces) -> None:
        self._robot, self._workspaces, self._motors = robot, workspaces, workspaces.motors

    def seen_from_home(self, row: int, points: Array) -> Flags:
        """Which points (k, 3) both cameras see (k,)."""
        return self.seen_from(row, points, self._workspaces.home(row)[None].repeat(len(points), 0))

    def seen_from(self, row: int, points: Array, angles: Array) -> Flags:
        """Which points (k, 3) both cameras see (k,), with joints at (k, j)."""
        return self._workspaces.images(points, angles, np.full(len(points), row))[1]

    def joints_at(
        self, row: int, world: World, places: Array, rest: Array | None = None
    ) -> tuple[Array, Flags]:
        """Joints (k, j) with the gripper at places (k, 3), and which of these it reaches (k,).

        At the pitch `rest` (1,), if the arm can tilt it.
        """
        robot, rows = self._robot, np.array([row])
        rest = robot.rest(world.joint_zeros) if rest is None else rest
        lowest, highest = robot.stops[:, 0] + LIMIT_MARGIN, robot.stops[:, 1] - LIMIT_MARGIN
        positions = robot.positions_at(places, rest, world.link_lengths)
        angles = self._motors.angles(positions[None], rows)[0]
        there = robot.gripper_position(angles, world.link_lengths)
        reached = np.abs(there - places).max(1) < EXACT
        reached &= self._motors.reaches(positions, MAX_REGISTER, rows)
        reached &= ((positions > lowest) & (positions < highest)).all(1)
        return angles, reached


class Placing(Places):
    """Draws things and their places for N arms: a pure function of seed and trial.

    Args:
        robot, workspaces: See `Places`.
        shape: Of the things.
        keep_in_view: Whether both cameras must see them.
        in_sight: Tells what hides them, where that matters.
    """

    def __init__(
        self,
        robot: GrippingArm,
        workspaces: Workspaces,
        shape: ShapeChoice,
        keep_in_view: bool,
        in_sight: InSight | None,
    ) -> None:
        super().__init__(robot, workspaces)
        self._shape, self._keep_in_view = shape, keep_in_view
        self._in_sight = in_sight if keep_in_view else None

    def draw(self, row: int, seed: int, trial: int, world: World) -> Placed:
        """What the trial of a row begins with.

        Raises:
            ValueError: There is no such place.
        """
        thing = draw_thing(self._shape, stream(seed, "thing", trial))
        for block in range(ATTEMPTS):
            poses = _poses(stream(seed, "place", trial, block).random((BLOCK, 3)), thing.height)
            for pose in self._graspable(row, world, thing, poses):
                return Placed(thing, pose, self.goal(row, seed, trial, LIFTED))
        hidden = "" if self._in_sight is None else ", hidden by nothing"
        raise ValueError(
            f"no {thing.shape} in {ATTEMPTS * BLOCK} drawn places can be reached and is in view of both "
            f"cameras{hidden}, in row {row}, trial {trial}: see its world"
        )

    def given(self, row: int, seed: int, trial: int, world: World, place: Array) -> Placed:
        """The same, with the thing at a given place (2,) or (3,): x and y in m, and its angle.

        Raises:
            ValueError: The arm stands there, or cannot grasp it there.
        """
        thing = draw_thing(self._shape, stream(seed, "thing", trial))
        angle = place[2] if len(place) > 2 else (2 * stream(seed, "place", trial).random() - 1) * np.pi
        pose = np.array([place[0], place[1], thing.height, angle])
        where = f"the object at {place[:2].tolist()}"
        if (near := float(np.hypot(*place[:2]))) < BASE:
            raise ValueError(
                f"{where} is inside the arm: {near:.2f} m from the waist; it must be {BASE} m or more"
            )
        reached, _, _ = self._judged(row, world, thing, pose[None])
        if not reached[0]:
            raise ValueError(
                f"{where} is out of reach in this world, whose motors and links do not bring the jaws there "
                f"from above; as built, things can be grasped about {BEFORE_IT}"
            )
        return Placed(thing, pose, self.goal(row, seed, trial, LIFTED))

    def serves(self, row: int, world: World) -> bool:
        """Whether enough of the table is graspable in a world, into which the row is put."""
        if self._in_sight is not None and not self._in_sight.gripper(row, self._workspaces.home(row)):
            return False
        thing = draw_thing("sphere", np.random.default_rng(0))
        poses = _poses(np.random.default_rng(0).random((CHECKED, 3)), thing.height)
        return len(list(self._graspable(row, world, thing, poses))) >= LEAST_GRASPABLE * CHECKED

    def _graspable(self, row: int, world: World, thing: Thing, poses: Array) -> Iterator[Array]:
        """Those poses (4,) of (k, 4) at which a thing can be grasped from above, and is seen before."""
        reached, seen, before = self._judged(row, world, thing, poses)
        if not self._keep_in_view:
            seen[:] = True
        home = self._workspaces.home(row)
        for i in np.flatnonzero(reached & seen):
            if self._in_sight is None or (
                self._in_sight.thing(row, thing, poses[i], home) == 1
                and self._in_sight.thing(row, thing, poses[i], before[i]) >= LEAST_SHARE
            ):
                yield poses[i]

    def _judged(self, row: int, world: World, thing: Thing, poses: Array) -> tuple[Flags, Flags, Array]:
        """Which poses (k, 4) the gripper reaches, and which are seen; and joints (k, j) one length before."""
        places = poses[:, :3]
        c, s, o = np.cos(poses[:, 3]), np.sin(poses[:, 3]), np.zeros(len(poses))
        ahead = np.column_stack([c, s, o]) * thing.axis[0] + np.array([0.0, 0.0, thing.axis[2]])
        seen, reached = np.ones(len(poses), bool), np.ones(len(poses), bool)
        for point in (places, places + ahead, places - ahead):
            seen &= self.seen_from_home(row, point)
        back = np.zeros_like(places)
        for _ in range(2):  # at the thing, then before it
            there = places + back
            angles, reaches = self.joints_at(row, world, there)
            reached &= reaches
            axis = self._robot.axis(angles)
            for point in (places, there, there - AXIS * axis):
                seen &= self.seen_from(row, point, angles)
            back = -AXIS * axis
        return reached, seen, angles

    def goal(self, row: int, seed: int, trial: int, height: float) -> Array:
        """An image point (4,) of the gripper, which is higher than that above the table (m)."""
        one = np.array([row])
        for block in range(ATTEMPTS):
            draws = stream(seed, "lifted", trial, block).random((1, BLOCK, len(self._robot.motors)))
            at = self._workspaces.candidates(draws, one)
            good = (at.seen & at.reached & (at.points[..., 2] > height))[0]
            if not self._keep_in_view:
                good = (at.within & at.reached & (at.points[..., 2] > height))[0]
            if good.any():
                first = good.argmax()
                angles = self._motors.angles(at.positions[:, first], one)
                images, _ = self._workspaces.images(at.points[:, first], angles, one)
                return images.reshape(4)
        raise ValueError(f"nothing can be lifted in view of both cameras, in row {row}: see its world")


def _poses(shares: Array, height: float) -> Array:
    """Poses (k, 4) of things on the table, from numbers in [0, 1) (k, 3)."""
    places = before_the_arm(shares, np.full(len(shares), height))
    return np.column_stack([places, (2 * shares[:, 2] - 1) * np.pi])


def before_the_arm(shares: Array, heights: Array) -> Array:
    """Places (k, 3) in m at heights (k,): how far off and how far round two numbers in [0, 1) (k, 2) say."""
    far, around = DISTANCE[0] + shares[:, 0] * (DISTANCE[1] - DISTANCE[0]), (2 * shares[:, 1] - 1) * WAIST
    return np.stack([far * np.cos(around), far * np.sin(around), heights], -1)
