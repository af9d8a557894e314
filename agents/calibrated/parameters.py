"""What may be off with a robot, as one vector of parameters; and what is to be seen if it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from agents.base.observation import Array
from agents.calibrated.image_derivatives import image_derivatives
from agents.calibrated.model import CalibratedModel
from agents.calibrated.observations import Looks
from agents.calibrated.rotations import rotation, rotation_axes

PARAMETERS = (
    ("camera_position", (2, 3), 0.05, 0.15),
    ("camera_turn", (2, 3), (0.15, 0.15, 10.0), (0.6, 0.6, 20.0)),
    ("focal_length", (2, 1), 0.25, 0.8),
    ("lens_k1", (2, 1), 0.05, 0.15),
    ("link_lengths", (5,), 0.06, 0.2),
    ("joint_zeros", (4,), 0.10, 0.3),
    ("motor_gain", (3,), 0.4, 0.9),
    ("motor_curvature", (3,), 0.2, 0.43),
)
"""What may be off from the robot as built: name, shape, by how much as a rule, and at most. Positions are in
m, angles in rad (two of tilt, and the roll, which is left open), focal lengths and gains logarithms of a
factor, link lengths shares."""
_SIZES = [int(np.prod(shape)) for _, shape, _, _ in PARAMETERS]
_ENDS = np.cumsum(_SIZES)
COUNT = int(_ENDS[-1])
_CAMERAS = int(_ENDS[3])
"""The parameters before are the cameras', those behind the arm's."""
_CAMERA_COLUMNS = [[*range(3 * i, 3 * i + 3), *range(6 + 3 * i, 9 + 3 * i), 12 + i, 14 + i] for i in range(2)]
RULE, MOST = (
    np.concatenate([np.broadcast_to(row[which], row[1]).ravel() for row in PARAMETERS]) for which in (2, 3)
)
_STEP = 1e-6


def model_of(built: CalibratedModel, signs: Array, parameters: Array) -> CalibratedModel:
    """A robot that is off as `built` by `parameters` (..., COUNT), with motors of these signs (..., 3)."""
    off = named(parameters)
    return replace(
        built,
        camera_position=built.camera_position + off["camera_position"],
        camera_axes=built.camera_axes @ rotation(off["camera_turn"]),
        focal_length=built.focal_length * np.exp(off["focal_length"][..., 0]),
        lens_k1=built.lens_k1 + off["lens_k1"][..., 0],
        link_lengths=built.link_lengths * (1 + off["link_lengths"]),
        joint_zeros=built.joint_zeros + off["joint_zeros"],
        motor_gain=built.motor_gain * signs * np.exp(off["motor_gain"]),
        motor_curvature=built.motor_curvature + off["motor_curvature"],
    )


def named(parameters: Array) -> dict[str, Array]:
    """The parameters (..., COUNT) as views of their shapes (..., *shape), by name."""
    parts = np.split(parameters, _ENDS[:-1], -1)
    shapes = [(name, parameters.shape[:-1] + shape) for name, shape, *_ in PARAMETERS]
    return {name: part.reshape(shape) for part, (name, shape) in zip(parts, shapes, strict=True)}


def predicted(looks: Looks, built: CalibratedModel, signs: Array, x: Array) -> tuple[Array, Array]:
    """Coordinates (s, 8 n) that are to be seen, and their derivatives by x, (s, 8 n, COUNT + 3 trials)."""
    starts, count = len(x), len(looks.trial)
    objects = x[:, COUNT:].reshape(starts, -1, 3)
    model = model_of(built, signs, x[:, :COUNT])
    mounted = _mounted(looks, model, objects)
    seen, by_place, by_camera = image_derivatives(model, mounted.reshape(starts, -1, 3))
    axes = rotation_axes(named(x[:, :COUNT])["camera_turn"])
    by_camera[..., 3:6] = by_camera[..., 3:6] @ axes[:, None]

    further = x[:, None, :COUNT] + _STEP * np.eye(COUNT)[_CAMERAS:]
    moved = _mounted(looks, model_of(built, signs[:, None], further), objects[:, None])
    by_arm = np.moveaxis(moved - mounted[:, None], 1, -1) / _STEP
    joints = model.joints(looks.registers)
    units = np.eye(3)[:, None, None] * np.ones((starts, count, 1))
    by_object = np.stack([model.mounted(unit, joints) for unit in units], -1)

    by_place = by_place.reshape(starts, count, 2, 4, 3)
    slopes = np.zeros((starts, count, 2, 4, x.shape[1]))
    for camera, columns in enumerate(_CAMERA_COLUMNS):
        rows = slice(2 * camera, 2 * camera + 2)
        slopes[..., rows, columns] = by_camera[..., camera, :, :].reshape(starts, count, 2, 2, -1)
    slopes[..., _CAMERAS:COUNT] = by_place @ by_arm
    for look, trial in enumerate(looks.trial):
        own = slice(COUNT + 3 * trial, COUNT + 3 * trial + 3)
        slopes[:, look, 1, :, own] = by_place[:, look, 1] @ by_object[:, look]
    return seen.reshape(starts, -1), slopes.reshape(starts, 8 * count, -1)


def _mounted(looks: Looks, model: CalibratedModel, objects: Array) -> Array:
    """Gripper and objects (..., n, 2, 3) in the frame of the cameras' mount."""
    joints = model.joints(looks.registers)
    both = np.broadcast_arrays(model.gripper(joints), objects[..., looks.trial, :])
    return np.stack([model.mounted(points, joints) for points in both], -2)
