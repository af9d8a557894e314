"""A foreign MuJoCo model as a world of ours: read as it is built, and written as perturbations change it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, NamedTuple

import mujoco
import numpy as np

from calfree_gym.geometry import Array, quaternion_of, quaternion_product, rotation_matrix
from calfree_gym.image import IMAGE_SIZE
from calfree_gym.world import World

FOVY = 45.0
"""Assumed for it where there is no model: MuJoCo's own default, in degrees."""
_SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)
_MOVING = int(mujoco.mjtJoint.mjJNT_HINGE), _SLIDE
_FIXED, _TRACK, _TRACKCOM = (
    int(getattr(mujoco.mjtCamLight, f"mjCAMLIGHT_{name}")) for name in ("FIXED", "TRACK", "TRACKCOM")
)


class ModelParts(NamedTuple):
    """What perturbations must know of a robot; see `calfree_gym.robot.arms.robot.Robot`.

    Attributes:
        cameras: Names of those that images show.
        motors: Names of the numbers of an action.
        joints: Names of those that turn or slide.
        slides: Which joints slide.
        links: None has a length that could be changed.
    """

    cameras: tuple[str, ...]
    motors: tuple[str, ...]
    joints: tuple[str, ...] = ()
    slides: tuple[bool, ...] = ()
    links: tuple[str, ...] = ()


def names_of(model: Any, kind: str, count: int) -> tuple[str, ...]:
    """Names of all cameras, joints or actuators; one that has none is called by its kind and number."""
    number = getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}")
    return tuple(mujoco.mj_id2name(model, number, i) or f"{kind}{i}" for i in range(count))


def joints_of(model: Any) -> tuple[tuple[str, ...], tuple[bool, ...]]:
    """Names of the joints that turn or slide, and which slide."""
    names = names_of(model, "joint", model.njnt)
    found = [(names[i], kind == _SLIDE) for i, kind in enumerate(model.jnt_type.tolist()) if kind in _MOVING]
    return tuple(name for name, _ in found), tuple(slides for _, slides in found)


def plain_world(parts: ModelParts, **fields: Any) -> World:
    """A world without faults, in which `fields` are given."""
    cameras, motors = max(1, len(parts.cameras)), len(parts.motors)
    focal = IMAGE_SIZE / 2 / math.tan(math.radians(FOVY) / 2)
    plain: dict[str, Any] = {
        "camera_position": np.zeros((cameras, 3)),
        "camera_orientation": np.tile([1.0, 0, 0, 0], (cameras, 1)),
        "focal_length": np.full(cameras, focal),
        "principal_point": np.zeros((cameras, 2)),
        "lens_k1": np.zeros(cameras),
        "link_lengths": np.zeros(0),
        "joint_zeros": np.zeros(len(parts.joints)),
        "motor_sign": np.ones(motors),
        "motor_gain": np.ones(motors),
        "motor_curvature": np.zeros(motors),
        "point_noise": 0.0,
        "image_noise": 0.0,
    }
    return World(**plain | fields)


class PerturbedModel:
    """Writes worlds into a compiled model.

    What a world changes is written relative to the model as built: one that is built anew with other cameras,
    or whose cameras the environment itself moves at a reset, gets the same turns. What is as built gets its
    bits back.

    Attributes:
        model: The MjModel.
        data: Its MjData.
        built: The world in which the first model was built. Cameras are in the room, with their mounts where
            they are at MuJoCo's `qpos0`; focal lengths are in pixels of an image of 512 rows.

    Args:
        model: As built.
        data: Its data.
        parts: Of the robot. A camera that the model does not have is the viewer's.
    """

    _WRITTEN: ClassVar[tuple[str, ...]] = (
        *("cam_mode", "cam_pos", "cam_quat", "cam_pos0", "cam_poscom0", "cam_mat0", "cam_fovy"),
        *("cam_intrinsic", "qpos0", "light_mode", "light_pos", "light_dir", "light_diffuse"),
    )

    _written: World | None

    def __init__(self, model: Any, data: Any, parts: ModelParts) -> None:
        self._parts = parts
        self.attach(model, data)
        self.built = self._written = self._read()

    def attach(self, model: Any, data: Any) -> None:
        """Takes another model, as built."""
        self.find(model, data)
        self._as_built = self.copies()
        self._home = _Home(model)
        self._aims: dict[int, Array] = {}

    def find(self, model: Any, data: Any) -> None:
        """Takes an equal model, at another place in memory."""
        self.model, self.data = model, data
        names = {name: i for i, name in enumerate(names_of(model, "camera", model.ncam))}
        self._cameras = [(row, names[name]) for row, name in enumerate(self._parts.cameras) if name in names]
        self._joints = model.jnt_qposadr[np.isin(model.jnt_type, _MOVING)]
        self._lamp = next((i for i in range(model.nlight) if model.light_active[i]), None)
        self._written = None

    def follow(self, model: Any, data: Any, world: World, before: Mapping[str, Any]) -> None:
        """Where a reset has built another model, or changed this one, makes it what `world` says.

        `before` are the `copies` from before the reset.
        """
        if model is not self.model:
            self.attach(model, data)
            self.write(world)
            return
        now = self.copies()
        changed = {name: now[name] != then for name, then in before.items()}
        if any(each.any() for each in changed.values()):
            for name, field in self._fields().items():
                field[...] = np.where(changed[name], now[name], self._as_built[name])
            self.attach(model, data)
            self.write(world)

    def _fields(self) -> dict[str, Any]:
        """What is written, by name: views of the model."""
        head = self.model.vis.headlight
        fields = {name: getattr(self.model, name) for name in self._WRITTEN}
        return fields | {"ambient": head.ambient, "diffuse": head.diffuse}

    def copies(self) -> dict[str, Any]:
        """Of all that is written, by name."""
        return {name: field.copy() for name, field in self._fields().items()}

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name not in ("model", "data")}

    def write(self, world: World) -> None:
        """Makes the model what `world` says.

        Of what is computed from it, only cameras and lights are computed at once: physics stay as they are.
        """
        before, self._written = self._written, world
        stale = {
            writer: None
            for name, writer in self._WRITERS.items()
            if before is None or getattr(world, name) is not getattr(before, name)
        }
        for writer in stale:
            writer(self, world)
        if stale:
            mujoco.mj_camlight(self.model, self.data)

    def _read(self) -> World:
        model, home = self.model, self._home
        there = plain_world(self._parts)
        positions, turns, fovy = (
            there.camera_position.copy(),
            there.camera_orientation.copy(),
            np.full(len(there.focal_length), float(model.vis.global_.fovy)),
        )
        for row, camera in self._cameras:
            positions[row] = home.cam_xpos[camera]
            turns[row] = quaternion_of(home.cam_xmat[camera])
            fovy[row] = model.cam_fovy[camera]
        light = {"light_strength": self._as_built["diffuse"].mean()}
        if self._lamp is not None:
            way = home.light_xdir[self._lamp]
            light = {
                "light_direction": way / np.linalg.norm(way),
                "light_strength": model.light_diffuse[self._lamp].mean(),
            }
        return there.replace(
            camera_position=positions,
            camera_orientation=turns,
            focal_length=IMAGE_SIZE / 2 / np.tan(np.radians(fovy) / 2),
            light_ambient=self._as_built["ambient"].mean(),
            **light,
        )

    def _put(self, name: str, place: int, value: Any = None) -> None:
        """Writes a row of one of the model's arrays; None: as it was built."""
        getattr(self.model, name)[place] = self._as_built[name][place] if value is None else value

    def _write_poses(self, world: World) -> None:
        for row, camera in self._cameras:
            for name in ("cam_mode", "cam_pos", "cam_quat", "cam_pos0", "cam_poscom0", "cam_mat0"):
                self._put(name, camera)
            shift = world.camera_position[row] - self.built.camera_position[row]
            before, now = self.built.camera_orientation[row], world.camera_orientation[row]
            if not shift.any() and (before == now).all():
                self._aims.pop(camera, None)
                continue
            turn = quaternion_product(before * [1, -1, -1, -1], now)
            if self._as_built["cam_mode"][camera] in (_TRACK, _TRACKCOM):
                self.model.cam_pos0[camera] += shift
                self.model.cam_poscom0[camera] += shift
                axes = self._as_built["cam_mat0"][camera].reshape(3, 3) @ rotation_matrix(turn)
                self._put("cam_mat0", camera, axes.ravel())
                continue
            self.model.cam_pos[camera] += self._home.xmat[self.model.cam_bodyid[camera]].T @ shift
            self._put("cam_quat", camera, quaternion_product(self._aim(camera), turn))
            self._put("cam_mode", camera, _FIXED)

    def _aim(self, camera: int) -> Array:
        """How it is turned on its body (4,). One that looks at a body goes on as it is when it is knocked."""
        if self._as_built["cam_mode"][camera] == _FIXED:
            return np.array(self._as_built["cam_quat"][camera])
        if camera not in self._aims:
            body, here = self.model.cam_bodyid[camera], self._home
            axes, frame = here.cam_xmat[camera], here.xmat[body]
            if self.data.xmat.any():  # else nothing has been computed yet
                axes, frame = (
                    each.reshape(3, 3) for each in (self.data.cam_xmat[camera], self.data.xmat[body])
                )
            self._aims[camera] = quaternion_of(frame.T @ axes)
        return self._aims[camera]

    def _write_zooms(self, world: World) -> None:
        for row, camera in self._cameras:
            self._put("cam_fovy", camera)
            self._put("cam_intrinsic", camera)
            if (now := world.focal_length[row]) != (before := self.built.focal_length[row]):
                half = math.tan(math.radians(self._as_built["cam_fovy"][camera]) / 2) * before / now
                self._put("cam_fovy", camera, math.degrees(2 * math.atan(half)))
                self.model.cam_intrinsic[camera, :2] *= now / before

    def _write_zeros(self, world: World) -> None:
        for place, zero in zip(self._joints, world.joint_zeros, strict=True):
            self._put("qpos0", place, self._as_built["qpos0"][place] - zero if zero else None)

    def _write_light(self, world: World) -> None:
        built, head, lamp = self.built, self.model.vis.headlight, self._lamp
        more = world.light_ambient - built.light_ambient
        head.ambient[:] = self._as_built["ambient"] + more
        brighter = world.light_strength / built.light_strength if built.light_strength else 1.0
        if lamp is None:
            head.diffuse[:] = self._as_built["diffuse"] * brighter
            return
        self._put("light_diffuse", lamp, self._as_built["light_diffuse"][lamp] * brighter)
        for name in ("light_mode", "light_pos", "light_dir"):
            self._put(name, lamp)
        if (world.light_direction != built.light_direction).any():
            body = self.model.light_bodyid[lamp]
            place, axes = self._home.xpos[body], self._home.xmat[body]
            middle = self.model.stat.center
            far = np.linalg.norm(self._home.light_xpos[lamp] - middle)
            self._put("light_mode", lamp, _FIXED)
            self._put("light_pos", lamp, axes.T @ (middle - far * world.light_direction - place))
            self._put("light_dir", lamp, axes.T @ world.light_direction)

    _WRITERS: ClassVar[dict[str, Callable[[PerturbedModel, World], None]]] = {
        **dict.fromkeys(("camera_position", "camera_orientation"), _write_poses),
        "focal_length": _write_zooms,
        "joint_zeros": _write_zeros,
        **dict.fromkeys(("light_direction", "light_strength", "light_ambient"), _write_light),
    }


class _Home:
    """Where bodies, cameras and lights are at `qpos0`, in the room; axes as columns."""

    def __init__(self, model: Any) -> None:
        data = mujoco.MjData(model)
        for compute in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_camlight):
            compute(model, data)
        self.xpos, self.xmat = data.xpos.copy(), data.xmat.reshape(-1, 3, 3).copy()
        self.cam_xpos, self.cam_xmat = data.cam_xpos.copy(), data.cam_xmat.reshape(-1, 3, 3).copy()
        self.light_xpos, self.light_xdir = data.light_xpos.copy(), data.light_xdir.copy()
