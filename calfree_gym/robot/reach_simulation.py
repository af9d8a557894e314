"""Arms that reach: nothing touches anything, and the object is a mark."""

from __future__ import annotations

import mujoco

from calfree_gym.geometry import Array, Rows
from calfree_gym.robot.arms.robot import Furnish, Mounts, Robot
from calfree_gym.robot.arms.scene import POINTS
from calfree_gym.robot.simulation import Picture, Simulation, columns, write

SUBSTEPS = 100
"""Physics substeps of 5 ms in a motion: enough to settle to 0.1 pixels (a test measures it)."""
DYNAMICS = ("physics", "kinematic")
_NO_SENSORS = int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
_NO_CONSTRAINTS = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)


class ReachSimulation(Simulation):
    """Arms that touch nothing; the object is a mark.

    Args:
        rows, robot, mounts, threads: See `Simulation`.
        dynamics: "physics", or "kinematic": the arm is placed where physics would settle.
        furnish: See `Robot.scene`.
    """

    def __init__(
        self,
        rows: int,
        robot: Robot,
        mounts: Mounts,
        dynamics: str,
        threads: int,
        furnish: Furnish | None = None,
    ) -> None:
        scene = robot.scene(mounts, furnish)
        self._kinematic = dynamics == "kinematic"
        if self._kinematic:
            scene.model.opt.disableflags |= _NO_CONSTRAINTS  # motors stop before joints do
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
        self._object[rows, self._mocap] = objects

    def move(self, rows: Rows, joints: Array) -> Array:
        """Moves the arms of `rows` until they have settled with joints at (n, j).

        Returns:
            How long the joint that takes longest travels (n,), in seconds.
        """
        travel = self.travel(rows, joints)
        write(self._all_ctrl, rows, self._ctrl, joints)
        if self._kinematic:
            write(self._all_qpos, rows, self._qpos, joints)
        else:
            self._disabled.fill(self._flags | _NO_SENSORS)  # only `refresh` needs them
            self._batch.step(None if isinstance(rows, slice) else rows, SUBSTEPS)
            self._disabled.fill(self._flags)
        return travel

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

    def show_object(self, row: int, picture: Picture, object_: Array | None) -> None:
        """See `Simulation`."""
        data = picture[1]
        data.mocap_pos[:] = self._object[row]
        if object_ is not None:
            data.mocap_pos[self._mocap] = object_
