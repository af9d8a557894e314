"""N arms in N worlds, stepped together by MuJoCo: the only file that touches MuJoCo's state."""

from __future__ import annotations

from importlib.resources import files

import mujoco
import numpy as np
from mujoco.batch import Batch

from calfree_gym.geometry import Array, Rows
from calfree_gym.image import CAMERAS, IMAGE_SIZE
from calfree_gym.robot.motors import MotorMap
from calfree_gym.world import World

SUBSTEPS = 100
"""Physics substeps of 5 ms in a motion: enough to settle to 0.1 pixels (a test measures it)."""
DYNAMICS = ("physics", "kinematic")
POINTS = ("gripper", "object")
RIG_GROUP = 2
"""Group of the cameras' rods and housings, which their own images leave out."""

_SENSOR_SIZE = 0.01
_HAND_TO_GRIPPER_POINT = 0.18
_NO_SENSORS = int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
_NO_CONSTRAINTS = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
_POSITION_STAGE = int(mujoco.mjtStage.mjSTAGE_POS)


def build_model(mount: str) -> mujoco.MjModel:
    """The arm with two cameras on thin rods, fixed to its first link or in the room."""
    spec = mujoco.MjSpec.from_file(str(files("calfree_gym") / "assets" / "arm.xml"))
    fixed_to = spec.body("waist") if mount == "waist" else spec.worldbody
    for name in CAMERAS:
        fixed_to.add_camera(
            name=name,
            resolution=[IMAGE_SIZE, IMAGE_SIZE],
            sensor_size=[_SENSOR_SIZE, _SENSOR_SIZE],
            focal_length=[_SENSOR_SIZE, _SENSOR_SIZE],
        )
        for part, kind in (
            ("rod", mujoco.mjtGeom.mjGEOM_CAPSULE),
            ("housing", mujoco.mjtGeom.mjGEOM_BOX),
        ):
            fixed_to.add_geom(
                name=f"{name}_{part}",
                type=kind,
                size=[0.006, 0.1, 0.1],
                rgba=[0.25, 0.27, 0.30, 1],
                group=RIG_GROUP,
                mass=0.0,
                contype=0,
                conaffinity=0,
            )
    for kind in (mujoco.mjtSensor.mjSENS_CAMPROJECTION, mujoco.mjtSensor.mjSENS_FRAMEPOS):
        for point in POINTS:
            for camera in CAMERAS:
                spec.add_sensor(
                    type=kind,
                    objtype=mujoco.mjtObj.mjOBJ_SITE,
                    objname=point + "_point",
                    reftype=mujoco.mjtObj.mjOBJ_CAMERA,
                    refname=camera,
                )
    return spec.compile()


class Simulation:
    """N arms in N worlds.

    Args:
        rows: N.
        mount: Where the cameras are fixed, see `cameras.MOUNTS`.
        dynamics: "physics", or "kinematic": the arm is placed where physics would settle.
        threads: Threads that step the worlds; they change no number.
    """

    def __init__(self, rows: int, mount: str, dynamics: str, threads: int) -> None:
        self._model = build_model(mount)
        self._kinematic = dynamics == "kinematic"
        if self._kinematic:
            self._model.opt.disableflags |= _NO_CONSTRAINTS  # motors stop before joints do
        self._batch = Batch(self._model, rows, nthread=threads)
        self._current = False
        self.motors = MotorMap(rows)
        self._camera_position = self._batch.expand("cam_pos")
        self._camera_orientation = self._batch.expand("cam_quat")
        self._intrinsic = self._batch.expand("cam_intrinsic")
        self._body_position = self._batch.expand("body_pos")
        self._disabled = self._batch.expand("opt.disableflags")
        self._flags = int(self._model.opt.disableflags)
        self._qpos, self._qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        self._ctrl, self._act = self._batch.bind("ctrl"), self._batch.bind("act")
        self._object = self._batch.bind("mocap_pos")
        sensors = self._batch.bind("sensordata")
        self._pixels = sensors[:, :8].reshape(rows, 4, 2)
        self._minus_depth = sensors[:, 10::3]
        self._sites = self._batch.bind("site_xpos")
        bodies = [self._model.body(name).id for name in ("upper_arm", "forearm", "hand", "gripper")]
        self._upper_arm, self._forearm, self._hand, self._gripper = bodies
        self._site = [self._model.site(point + "_point").id for point in POINTS]

    def set_world(self, row: int, world: World) -> None:
        """Puts `row` into `world`; its joints stay where they are until it moves or goes home."""
        self._current = False
        self.motors.set_world(row, world)
        self._camera_position[row] = world.camera_position
        self._camera_orientation[row] = world.camera_orientation
        pixel = _SENSOR_SIZE / IMAGE_SIZE
        self._intrinsic[row, :, 0] = self._intrinsic[row, :, 1] = world.focal_length * pixel
        base, shoulder, upper_arm, forearm, hand = world.link_lengths
        self._body_position[row, self._upper_arm] = (shoulder, 0, base)
        self._body_position[row, self._forearm] = (upper_arm, 0, 0)
        self._body_position[row, self._hand] = (forearm, 0, 0)
        self._body_position[row, self._gripper] = (hand - _HAND_TO_GRIPPER_POINT, 0, 0)

    def place(self, rows: Rows, registers: Array, objects: Array) -> None:
        """Puts the arms of `rows` at rest at `registers` (n, 3), and their objects (n, 3) in m."""
        self._rest_at(rows, self.motors.joints(registers, rows))
        self._object[rows, 0] = objects

    def move(self, rows: Rows, registers: Array) -> Array:
        """Moves the arms of `rows` until they have settled at `registers` (n, 3).

        Returns:
            The largest joint angle travelled (n,) in rad.
        """
        joints = self.motors.joints(registers, rows)
        travel = np.maximum.reduce(np.abs(joints - self._ctrl[rows]), axis=-1)
        if self._kinematic:
            self._qpos[rows] = self._ctrl[rows] = joints
            self._current = False
        else:
            self._ctrl[rows] = joints
            self._disabled.fill(self._flags | _NO_SENSORS)  # only `refresh` needs them
            self._batch.step(None if isinstance(rows, slice) else rows, SUBSTEPS)
            self._disabled.fill(self._flags)
            self._current = False
        return travel

    def travel_home(self) -> Array:
        """The largest joint angle (N,) in rad between where the arms are and home."""
        home = self.motors.joints(np.zeros((len(self._ctrl), len(self.motors.lowest[0]))), slice(None))
        return np.asarray(np.abs(self._ctrl - home).max(-1))

    def refresh(self) -> None:
        """Brings image points and positions up to date with where everything is."""
        if not self._current:
            self._batch.forward(stage=_POSITION_STAGE)

    def _rest_at(self, rows: Rows, joints: Array) -> None:
        self._qpos[rows] = self._ctrl[rows] = self._act[rows] = joints
        self._qvel[rows] = 0.0
        self._current = False

    def pinhole_pixels(self) -> tuple[Array, Array]:
        """Image points at the last refresh, of cameras without lens distortion and principal point offset.

        Returns:
            pixels: (N, 4, 2), from the image's upper left corner, x right and y down, of the gripper left
                and right, and of the object left and right.
            depth: (N, 4) in m; positive in front of the camera.
        """
        return self._pixels, -self._minus_depth

    def positions(self) -> tuple[Array, Array]:
        """Gripper points and object points (N, 3) in m at the last refresh."""
        return self._sites[:, self._site[0]].copy(), self._sites[:, self._site[1]].copy()

    def joints(self) -> Array:
        """True joint angles (N, 5) of J1-J5 in rad."""
        return self._qpos.copy()

    def snapshot(self, row: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
        """Model and data of one row, for rendering."""
        model, data = self._batch.get_model(row), self._batch.get_data(row)
        mujoco.mj_forward(model, data)
        return model, data
