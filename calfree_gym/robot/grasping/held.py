"""Things that are held in the air at any orientation (paper, 3.5): how to grasp them, and their physics."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import Array, Rows, rotation_matrix
from calfree_gym.robot.arms.movemaster import BEFORE_IT, DISTANCE, WAIST
from calfree_gym.robot.arms.robot import Mounts
from calfree_gym.robot.grasping.gripping_arm import AXIS, BEYOND, HOLDER, OPENING, PAD, STROKE, TiltingArm
from calfree_gym.robot.grasping.placing import LEAST_GRASPABLE, Placed, Placing, before_the_arm
from calfree_gym.robot.grasping.shapes import BOX, CYLINDER, LARGEST, SPHERE, Part, Thing, draw_thing
from calfree_gym.robot.grasping.simulation import GraspSimulation
from calfree_gym.robot.workspace import ATTEMPTS
from calfree_gym.streams import stream

if TYPE_CHECKING:
    from calfree_gym.world.value import World

ROLLS = np.radians(np.arange(0.0, 180.0, 7.5))
"""Of the jaws about the gripper's axis, that are tried (rad)."""
ROOM = 0.002
"""Open jaws pass by a thing at this distance (m), at least."""
OF_FRICTION = 0.8
"""Of the angle of friction, so much counts. Choice: the rest is for what is not exact."""
PALM = (0.082, 0.026, 0.058)
"""What lies so far behind the gripper point, and within so much of its axis along edge and line, is where
the palm is (m), see `jaws`."""
SPACING = 0.004
"""Between sampled points of a thing (m)."""


class Way(NamedTuple):
    """A way in which the jaws hold a thing.

    Attributes:
        pitch: Of the gripper (rad).
        roll: Of the jaws about its axis (rad), from where their edge is level.
        square: How squarely the jaws press: the cosine of the angle between their line and the thing's face.
    """

    pitch: float
    roll: float
    square: float


def ways_to_hold(thing: Thing, turned: Array, pitch: float, waist: float, friction: float) -> list[Way]:
    """All rolls in which jaws at a pitch (rad), and before a waist (rad), hold a thing.

    Two flat jaws hold what they press on within the angle of friction (Nguyen 1988) once it has turned flush,
    what fits between them when open, and what leaves room for the palm.

    Args:
        thing: The thing, the gripper point at its origin.
        turned: Its rotation (3, 3).
        pitch: Of the gripper (rad).
        waist: Which way it points, about the vertical (rad).
        friction: Between jaws and thing.
    """
    level, up = np.cos(pitch), np.sin(pitch)
    axis = np.array([level * np.cos(waist), level * np.sin(waist), up])
    side = np.array([-np.sin(waist), np.cos(waist), 0.0])
    other = np.cross(axis, side)
    points, least = surface(thing) @ turned.T, np.cos(OF_FRICTION * np.arctan(friction))
    ahead = points @ axis
    found = []
    for roll in ROLLS:
        edge = np.cos(roll) * side + np.sin(roll) * other
        line = np.cross(axis, edge)
        square, flush = pressed(thing, turned.T @ line)
        if flush >= least and _fits(ahead, points @ edge, points @ line):
            found.append(Way(float(pitch), float(roll), square))
    return found


def pressed(thing: Thing, line: Array) -> tuple[float, float]:
    """How squarely jaws press that close along a line (3,), in the thing's own frame: cosines.

    On the pair of faces on which they do so best, of those that are not too far apart: first as the thing is,
    then after it has turned between the jaws until such faces lie flush, as what is loose does.
    """
    part = thing.parts[0]
    if part.kind == SPHERE:
        return 1.0, 1.0
    if part.kind == CYLINDER:
        apart, along = 2 * part.size[:2], np.array([np.hypot(line[0], line[1]), abs(line[2])])
    else:
        apart, along = 2 * part.size, np.abs(line)
    along = along[apart <= LARGEST * OPENING]
    return float(along.max(initial=0.0)), float(np.linalg.norm(along))


def _fits(ahead: Array, along: Array, across: Array) -> bool:
    """Whether open jaws and the palm have room, by sampled points (k,) along axis, edge and line."""
    between = (np.abs(along) < PAD[1] + ROOM) & (ahead < BEYOND + ROOM)
    palm = (ahead < -PALM[0]) & (np.abs(along) < PALM[1]) & (np.abs(across) < PALM[2])
    touched = between & (ahead > -AXIS) & (np.abs(across) > STROKE - ROOM)
    held = between & (np.abs(ahead + PAD[0] - BEYOND) < PAD[0])
    return bool(held.any() and not touched.any() and not palm.any())


def surface(thing: Thing) -> Array:
    """Points (k, 3) in and on a thing, in its own frame."""
    return np.concatenate([part.place + _filled(part) for part in thing.parts])


def _filled(part: Part) -> Array:
    radius, half, _ = part.size
    sides = {SPHERE: (radius, radius, radius), CYLINDER: (radius, radius, half), BOX: tuple(part.size)}
    curved = {SPHERE: 3, CYLINDER: 2, BOX: 0}[part.kind]
    ticks = [np.linspace(-side, side, max(3, int(2 * side / SPACING))) for side in sides[part.kind]]
    points = np.stack(np.meshgrid(*ticks, indexing="ij"), -1).reshape(-1, 3)
    far = np.linalg.norm(points[:, :curved], axis=1, keepdims=True)
    points[:, :curved] *= radius / np.maximum(far, radius)  # what lies beyond is brought to the surface
    return points


HEIGHT = (0.10, 0.13)
"""Things are held at these heights (m). Choice: clear of the table, and lifted they are still in view."""
RAISED = 0.11
"""They are to be lifted by so much (m) at least. Derived: 50 mm, and what 24 pixels are."""
CLEAR = 0.06
"""A wrist and a tip so high above the table are clear of it (m). Derived: the hand is 55 mm to a side."""
PITCHES = np.radians(np.arange(-165.0, 61.0, 7.5))
"""Of the gripper, that are tried (rad); -90 degrees points straight down."""
CHECKED = 24
"""So many things tell whether a world serves. Choice: it takes a tenth of a second."""


class HeldSimulation(GraspSimulation):
    """N arms that grasp things which are held in the air, and let go as soon as jaws have closed on them."""

    state_names: ClassVar[tuple[str, ...]] = (*GraspSimulation.state_names, "_holder")

    def __init__(self, rows: int, robot: TiltingArm, mounts: Mounts, threads: int) -> None:
        super().__init__(rows, robot, mounts, threads)
        self._holder = self._batch.expand("dof_frictionloss")

    def _put(self, rows: Rows, objects: Array) -> None:
        """Puts things at their poses (n, 7): a place in m, and a quaternion."""
        self._all_qpos[rows, self._free : self._free + 7] = objects
        self._holder[rows, self._dof : self._dof + 6] = HOLDER

    def wait(self, rows: NDArray[np.intp]) -> tuple[Array, Array]:
        """See `GraspSimulation`: with something between the jaws; so the holder lets go."""
        self._holder[rows, self._dof : self._dof + 6] = 0.0
        return super().wait(rows)


class HeldPlacing(Placing):
    """Draws things that are held in the air, each at any orientation in which it can be grasped."""

    def draw(self, row: int, seed: int, trial: int, world: World) -> Placed:
        """See `Placing`: a pose is (7,), a place in m and a quaternion."""
        thing = draw_thing(self._shape, stream(seed, "thing", trial))
        for attempt in range(ATTEMPTS):
            pose = drawn_pose(stream(seed, "place", trial, attempt))
            if self.in_view(row, thing, pose) and any(self.ways(row, world, thing, pose)):
                return Placed(thing, pose, self.goal(row, seed, trial, pose[2] + RAISED))
        raise ValueError(
            f"no {thing.shape} in {ATTEMPTS} drawn poses can be grasped and is in view of both cameras, in "
            f"row {row}, trial {trial}: see its world"
        )

    def given(self, row: int, seed: int, trial: int, world: World, place: Array) -> Placed:
        """See `Placing`: with the thing at a given pose (7,), whether it can be grasped or not.

        Raises:
            ValueError: Its quaternion is none, or it is where no thing is held.
        """
        far, around = float(np.hypot(*place[:2])), float(np.arctan2(place[1], place[0]))
        within = DISTANCE[0] <= far <= DISTANCE[1] and abs(around) <= WAIST
        if not (within and HEIGHT[0] <= place[2] <= HEIGHT[1]):
            raise ValueError(
                f"the object at {place[:3].tolist()} is where no thing is held: they are {BEFORE_IT}, and "
                f"{HEIGHT[0]} to {HEIGHT[1]} m above the table"
            )
        if not np.isclose(size := float(np.linalg.norm(place[3:])), 1.0, atol=1e-3):
            raise ValueError(f"the object's quaternion has length {size:.3f}; it must be 1")
        pose = np.concatenate([place[:3], place[3:] / size])
        thing = draw_thing(self._shape, stream(seed, "thing", trial))
        return Placed(thing, pose, self.goal(row, seed, trial, pose[2] + RAISED))

    def serves(self, row: int, world: World) -> bool:
        """See `Placing`."""
        rng = np.random.default_rng(0)
        thing, poses = draw_thing("sphere", rng), [drawn_pose(rng) for _ in range(CHECKED)]
        good = [self.in_view(row, thing, each) and any(self.ways(row, world, thing, each)) for each in poses]
        return sum(good) >= LEAST_GRASPABLE * CHECKED

    def ways(self, row: int, world: World, thing: Thing, pose: Array) -> Iterator[Way]:
        """How the jaws can hold a thing at a pose (7,), as geometry tells."""
        turned = rotation_matrix(pose[3:])
        for pitch in PITCHES:
            if (postures := self.postures(row, world, pose[:3], pitch)) is not None:
                waist, friction = float(postures[0][0]), float(world.object_friction)
                yield from ways_to_hold(thing, turned, pitch, waist, friction)

    def postures(self, row: int, world: World, place: Array, pitch: float) -> tuple[Array, Array] | None:
        """Joints (5,) with the gripper at a place (3,), and one gripper length before it, at a pitch (rad).

        None where it does not get there, or the cameras do not see it.
        """
        axis, found = np.zeros((1, 3)), []
        for back in (0.0, AXIS):
            there = place[None] - back * axis
            angles, reached = self.joints_at(row, world, there, np.array([pitch]))
            axis = self._robot.axis(angles)
            wrist = there - world.link_lengths[-1] * axis
            if not reached[0] or min(wrist[0, 2], there[0, 2]) < CLEAR:
                return None
            both = np.concatenate([there, there - AXIS * axis])
            if self._keep_in_view and not self.seen_from(row, both, angles.repeat(2, 0)).all():
                return None
            found.append(angles[0])
        return found[0], found[1]

    def in_view(self, row: int, thing: Thing, pose: Array) -> bool:
        """Whether both cameras see a thing at a pose (7,) from home, if they must."""
        if not self._keep_in_view:
            return True
        ahead = rotation_matrix(pose[3:]) @ thing.axis
        return bool(self.seen_from_home(row, pose[:3] + np.outer([0, 1, -1], ahead)).all())


def drawn_pose(rng: np.random.Generator) -> Array:
    """A pose (7,) before the arm: a place in m, and a quaternion, all orientations alike."""
    shares, quaternion = rng.random(3), rng.normal(size=4)
    place = before_the_arm(shares[None], HEIGHT[0] + shares[2:] * (HEIGHT[1] - HEIGHT[0]))[0]
    return np.concatenate([place, quaternion / np.linalg.norm(quaternion)])
