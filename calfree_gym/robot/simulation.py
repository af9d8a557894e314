"""N arms in N worlds, stepped together by MuJoCo, and what is shown of them; arms that reach."""

from __future__ import annotations

import copy
import os
import weakref
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, ClassVar

import gymnasium
import mujoco
import numpy as np

from calfree_gym.geometry import Array, Rows, quaternion_of, quaternion_product
from calfree_gym.image import CAMERAS, IMAGE_SIZE
from calfree_gym.pool import OfWorlds
from calfree_gym.robot.arms.robot import Furnish, Mounts, Places, Robot, Scene
from calfree_gym.robot.arms.scene import POINTS, SENSOR_SIZE

try:
    from mujoco.batch import Batch
except ModuleNotFoundError as error:
    raise gymnasium.error.DependencyNotInstalled(
        f"CalFree environments need MuJoCo from 3.17 on; this is {mujoco.__version__}: "
        "pip install 'mujoco>=3.17'. Perturb does with 3.3"
    ) from error

if TYPE_CHECKING:
    from calfree_gym.world.value import World

Picture = tuple[mujoco.MjModel, mujoco.MjData]
_POSITION_STAGE = int(mujoco.mjtStage.mjSTAGE_POS)
_has_threads: weakref.WeakSet[Any] = weakref.WeakSet()
_kept: list[Any] = []


class Simulation(OfWorlds, ABC):
    """N arms in N worlds.

    Attributes:
        rows: N.
        prefix: Of the names of all that is added to the arm's model.
        covers: Names of the textures that cover table and room.
        cameras: Names of the cameras.
        way: Where a list is put here, it gets the configurations (q,) that the first row passes; arms that
            are placed at once pass none.

    Args:
        rows: N.
        robot: Their arm.
        scene: Of the arm.
        mounts: Where the cameras are fixed.
        threads: Threads that step the worlds; they change no number.
    """

    state_names: ClassVar[tuple[str, ...]] = ("_physics",)
    of_world: ClassVar[tuple[str, ...]] = (
        *("_camera_position", "_camera_orientation", "_intrinsic", "_body_position", "_occluders"),
        *("_lengths", "_focal"),
    )
    way: list[Array] | None = None
    cameras: tuple[str, ...] = CAMERAS

    def __init__(self, rows: int, robot: Robot, scene: Scene, mounts: Mounts, threads: int) -> None:
        self.rows = rows
        self._robot = robot
        self._model, self.prefix, self.covers = scene.model, scene.prefix, scene.covers
        self._batch = Batch(scene.stepped, rows, nthread=threads)
        keep_in_copies(self._batch)
        self._physics = self._batch.state  # all that MuJoCo integrates, the solver's warm start included
        self._occluder = self._model.geom(self.prefix + "occluder").id
        self._occluders = np.zeros((rows, 5))
        self._lengths, self._focal = np.tile(robot.lengths, (rows, 1)), np.ones((1, 2, rows)).T
        self._camera_position = self._batch.expand("cam_pos")
        self._camera_orientation = self._batch.expand("cam_quat")
        self._intrinsic = self._batch.expand("cam_intrinsic")
        self._body_position = self._batch.expand("body_pos")
        self._all_qpos, self._qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        self._all_ctrl = self._batch.bind("ctrl")
        self._sites = self._batch.bind("site_xpos")
        self._cameras = [self._model.camera(self.prefix + name).id for name in CAMERAS]
        self._scene = scene
        self._qpos, self._ctrl = columns(scene.qpos), columns(scene.actuators)
        self._speeds = robot.speeds
        homes = [robot.home_frame(mount) for mount in mounts]
        self._mounts = [(position, axes, quaternion_of(axes)) for position, axes in homes]
        self._all_qpos[:], self._all_ctrl[:] = scene.home, scene.ctrl

    @abstractmethod
    def place(self, rows: Rows, joints: Array, objects: Array) -> None:
        """Puts the arms of `rows` at rest with joints at (n, j), and their objects at (n, ...)."""

    @abstractmethod
    def pinhole_pixels(self) -> tuple[Array, Array]:
        """Image points at the last refresh, of cameras without lens and offset, whose pixels are square.

        Returns:
            pixels: (N, p, 2), from the image's upper left corner, x right and y down, left and right of each
                point in turn.
            depth: (N, p) in m; positive in front of the camera.
        """

    @abstractmethod
    def positions(self) -> tuple[Array, Array]:
        """Gripper points and object points (N, 3) in m at the last refresh."""

    def set_world(self, row: int, world: World) -> None:
        """Puts `row` into `world`; its joints stay where they are until it moves or goes home."""
        for camera, (position, axes, turn) in enumerate(self._mounts):
            place = self._cameras[camera]
            self._camera_position[row, place] = (world.camera_position[camera] - position) @ axes
            self._camera_orientation[row, place] = quaternion_product(
                turn * [1, -1, -1, -1], world.camera_orientation[camera]
            )
            self._intrinsic[row, place, :2] = world.focal_length[camera] * (SENSOR_SIZE / IMAGE_SIZE)
        self._lengths[row], self._focal[row, :, 0] = world.link_lengths, world.focal_length
        self._robot.stretch(self._body_position[row], world.link_lengths)
        self._occluders[row] = world.occluder

    def travel(self, rows: Rows, joints: Array) -> Array:
        """How long the arms of `rows` would travel (n,), in seconds, from here to joints at (n, j)."""
        far = np.abs(joints - self._all_ctrl[rows][:, self._ctrl])
        return np.asarray(np.maximum.reduce(far / self._speeds, axis=-1))

    def refresh(self) -> None:
        """Brings image points and positions up to date with where everything is."""
        self._batch.forward(stage=_POSITION_STAGE)

    def joints(self) -> Array:
        """True joint positions (N, j) in rad or m; of the RV-M2 J1-J5."""
        return self._all_qpos[:, self._qpos].copy()

    def configuration(self, row: int) -> Array:
        """All that moves in a row (q,), as MuJoCo has it: the arm's joints, and what else there is."""
        return self._all_qpos[row].copy()

    def between(self, before: Array, after: Array, share: float) -> Array:
        """A configuration (q,) as `after`, but for the arm, which has come so far along its way."""
        there = after.copy()
        there[self._qpos] = before[self._qpos] + share * (after - before)[self._qpos]
        return there

    def picture(self) -> Picture:
        """A model and its state of their own, for pictures and rays, on which `show` puts a row."""
        model = copy.copy(self._model)
        model.geom_sameframe[self._occluder] = 0
        model.body_bvhadr[0] = -1  # else rays miss what was compiled smaller or elsewhere
        return model, mujoco.MjData(model)

    @abstractmethod
    def show_object(self, row: int, picture: Picture, object_: Array | None) -> None:
        """Puts the object of a row on a picture, where it is or would be."""

    def show(
        self,
        row: int,
        picture: Picture,
        joints: Array | None = None,
        object_: Array | None = None,
        configuration: Array | None = None,
    ) -> Picture:
        """Puts a row on a picture: where everything is at the last refresh, or would be.

        Args:
            row: The row.
            picture: See `picture`; it is changed, and returned.
            joints: Joint positions (j,), where they are to be others than now.
            object_: Where the object would be (3,).
            configuration: All that moves (q,), where it is to be other than now.
        """
        model, data = picture
        model.cam_pos[:], model.cam_quat[:] = self._camera_position[row], self._camera_orientation[row]
        model.cam_intrinsic[:] = self._intrinsic[row]
        model.body_pos[:] = self._body_position[row]
        data.qpos[:] = self._all_qpos[row] if configuration is None else configuration
        if joints is not None:
            data.qpos[self._qpos] = joints
        self.show_object(row, picture, object_)
        place, (*middle, radius, half_height) = self._occluder, self._occluders[row]
        model.geom_pos[place], model.geom_size[place, :2] = middle, (radius, half_height)
        model.geom_rbound[place] = np.hypot(radius, half_height)
        model.geom_rgba[place, 3] = radius > 0
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_camlight(model, data)
        return picture


def columns(places: Places) -> slice | Places:
    """Places as a slice, where they follow each other: numpy reads and writes that faster."""
    first = int(places[0])
    in_a_row = np.array_equal(places, np.arange(first, first + len(places)))
    return slice(first, first + len(places)) if in_a_row else places


def write(array: Array, rows: Rows, columns: slice | Places, values: Array) -> None:
    """Writes values (n, k) into these columns of these rows of an array."""
    both_listed = not (isinstance(rows, slice) or isinstance(columns, slice))
    array[rows[:, None] if both_listed else rows, columns] = values  # type: ignore[index]


def keep_in_copies(thing: Any) -> None:
    """Lets no process that is forked from this one free a thing, whose threads are not there."""
    _has_threads.add(thing)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=lambda: _kept.extend(_has_threads))


SUBSTEPS = 100
"""Physics substeps of 5 ms in a motion: enough to settle to 0.1 pixels (a test measures it)."""
DYNAMICS = ("physics", "kinematic")
NOT_STEPPED = int(mujoco.mjtDisableBit.mjDSBL_SENSOR | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
"""Off while arms move that touch nothing: only `refresh` needs sensors; and motors, not joints, stop, so that
arms settle where kinematics places them, also where motions do not repeat exactly."""


class ReachSimulation(Simulation):
    """Arms that touch nothing; the object is a mark.

    Args:
        rows, robot, mounts, threads: See `Simulation`.
        furnish: See `Robot.scene`.
    """

    def __init__(
        self, rows: int, robot: Robot, mounts: Mounts, threads: int, furnish: Furnish | None = None
    ) -> None:
        scene = robot.scene(mounts, furnish)
        super().__init__(rows, robot, scene, mounts, threads)
        self._disabled = self._batch.expand("opt.disableflags")
        self._flags = int(self._model.opt.disableflags)
        self._all_act = self._batch.bind("act")
        self._object = self._batch.bind("mocap_pos")
        self._mocap = int(self._model.body_mocapid[self._model.body(self.prefix + "object").id])
        sensors = self._batch.bind("sensordata")[:, scene.sensors :]
        self._pixels = sensors[:, :8].reshape(rows, 4, 2)
        self._minus_depth = sensors[:, 10:20:3]
        self._site = [self._model.site(f"{self.prefix}{point}_point").id for point in POINTS]
        self._act = columns(self._model.actuator_actadr[scene.actuators])
        self._all_act[:] = scene.act

    def place(self, rows: Rows, joints: Array, objects: Array) -> None:
        """Puts the arms of `rows` at rest with joints at (n, j), and their objects at (n, 3) in m."""
        self._all_qpos[rows], self._all_act[rows] = self._scene.home, self._scene.act
        write(self._all_qpos, rows, self._qpos, joints)
        write(self._all_ctrl, rows, self._ctrl, joints)
        write(self._all_act, rows, self._act, joints)
        self._qvel[rows] = 0.0
        self.place_objects(rows, objects)

    def move(self, rows: Rows, joints: Array) -> Array:
        """Moves the arms of `rows` until they have settled with joints at (n, j).

        Returns:
            How long the joint that takes longest travels (n,), in seconds.
        """
        travel = self.travel(rows, joints)
        write(self._all_ctrl, rows, self._ctrl, joints)
        self._settle(rows, joints)
        return travel

    def _settle(self, rows: Rows, joints: Array) -> None:
        """Lets the arms of `rows` follow their servos to joints at (n, j)."""
        self._disabled.fill(self._flags | NOT_STEPPED)
        self._batch.step(None if isinstance(rows, slice) else rows, SUBSTEPS)
        self._disabled.fill(self._flags)

    def place_objects(self, rows: Rows, objects: Array) -> None:
        """Puts the objects of `rows` at (n, 3) in m."""
        self._object[rows, self._mocap] = objects

    def pinhole_pixels(self) -> tuple[Array, Array]:
        """Image points at the last refresh, of cameras without lens and offset, whose pixels are square.

        Returns:
            pixels: (N, 4, 2), from the image's upper left corner, x right and y down, of the gripper left
                and right, and of the object left and right.
            depth: (N, 4) in m; positive in front of the camera.
        """
        return self._pixels, -self._minus_depth

    def positions(self) -> tuple[Array, Array]:
        """Gripper points and object points (N, 3) in m at the last refresh."""
        return self._sites[:, self._site[0]].copy(), self._sites[:, self._site[1]].copy()

    def show_object(self, row: int, picture: Picture, object_: Array | None) -> None:
        """See `Simulation`."""
        data = picture[1]
        data.mocap_pos[:] = self._object[row]
        if object_ is not None:
            data.mocap_pos[self._mocap] = object_
