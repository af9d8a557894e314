"""What follows from an arm's MJCF, its gripper and its motors: names, ranges, home, and where things are."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from calfree_gym.geometry import Array, Flags
from calfree_gym.image import RANK, rounded
from calfree_gym.robot.arms.chain import SLIDE, Chain, transform
from calfree_gym.robot.arms.mjcf import Parts, compiled
from calfree_gym.robot.arms.movemaster import AIM as MOVEMASTER_TARGET
from calfree_gym.robot.arms.movemaster import CAMERA_POSITION as MOVEMASTER_POSITION
from calfree_gym.robot.arms.robot import HINGE_SPEED, SLIDE_SPEED, Furnish, Mounts, Places, Rig, Robot, Scene
from calfree_gym.robot.arms.scene import GripperMarks, best_axis, build

HINGE_MARGIN = 0.01
"""A hinge's motor stops this far (rad) before the joint does; where it hardly turns, before objects do."""
SLIDE_MARGIN = 0.005
"""A slide's, as a share of its span."""
WORK_SHARE = 0.4
"""Objects need no joint farther from home than this share of its span: so registers of 0.9 reach them also
with half of the built robot's gain."""
WORK_MARGIN = 0.04
"""Nor nearer to a stop than this share of its range, unless home is."""
POSTURES = 500
"""So many drawn postures tell where the work space is."""
MARK_POSTURES = 40
"""So many of them tell where the gripper's marks are seen best."""
SMALLEST = 1e-6
"""Root mean square distance (m) of objects from their middle, below which motors do not move the gripper."""
MOVEMASTER_SIZE = 0.23
"""Root mean square distance (m) of the RV-M2's objects from their middle."""


class ArmModel(Robot):
    """An arm as its model describes it.

    Attributes:
        spec: The model as given.
        model: The same, compiled.
        parts: What the arguments name in it.
        motors: Names of the motors' joints, m of them.
        links: Names of the bodies behind the base whose distance from the body before is a length, l of them.
        slides: Which motors (m,) slide.
        stops: Lowest and highest position (m, 2) of the motors' joints, in rad or m.
        home: Their positions at home (m,).
        home_qpos: Of all joints (nq,).
        joints: Names of the motors' joints: each has a zero.
        stop_margin, span, lowest, highest, rig, candidates, built_home, speeds: See `Robot`.

    Args:
        text: MJCF.
        gripper: Name of a site or body.
        motors, home, base: As in `Arm`.

    Raises:
        ValueError: As in `Arm`.
    """

    candidates = 400

    def __init__(
        self,
        text: str,
        gripper: str,
        motors: Sequence[str] | None,
        home: str | Mapping[str, float] | None,
        base: str | None,
    ) -> None:
        self.spec, self.model = compiled(text)
        model = self.model
        self.parts = parts = Parts(model, gripper, motors, base)
        self._motors, self._links = parts.motors, parts.links
        self.motors = tuple(parts.joints[joint] for joint in self._motors)
        self.slides: Flags = model.jnt_type[self._motors] == SLIDE
        self.links = tuple(parts.bodies[body] for body in self._links)
        self.lengths = np.linalg.norm(model.body_pos[self._links], axis=1)
        self.home_qpos = parts.home(home)
        self._chains: dict[int, Chain] = {}
        self._scenes: dict[tuple[Mounts, Furnish | None], Scene] = {}
        if home is None:
            self.home_qpos[self.qpos_of_motors] = self._best_posture()
        self.home = self.home_qpos[self.qpos_of_motors]
        self.stops = np.array(list(map(parts.stops, self._motors, self.home)))
        self.joints = self.motors
        self.span = np.maximum(self.home - self.stops[:, 0], self.stops[:, 1] - self.home)
        inner = WORK_MARGIN * (self.stops[:, 1] - self.stops[:, 0])
        hinge_margin = np.minimum(HINGE_MARGIN, inner)
        self.stop_margin = np.where(self.slides, SLIDE_MARGIN * self.span, hinge_margin)
        self.speeds = np.where(self.slides, SLIDE_SPEED, HINGE_SPEED)
        self.lowest = np.maximum(
            self.home - WORK_SHARE * self.span, np.minimum(self.stops[:, 0] + inner, self.home)
        )
        self.highest = np.minimum(
            self.home + WORK_SHARE * self.span, np.maximum(self.stops[:, 1] - inner, self.home)
        )
        self.rig = self._rig()

    @property
    def qpos_of_motors(self) -> Places:
        """Where the motors' positions stand in qpos (m,)."""
        return np.asarray(self.model.jnt_qposadr[self._motors])

    @property
    def home_by_name(self) -> dict[str, float]:
        """Positions at home of all hinges and slides, by name."""
        qpos = self.home_qpos
        return {name: float(qpos[self.model.joint(name).qposadr[0]]) for name in self.parts.turning}

    @property
    def built_home(self) -> Array:
        """See `Robot`: no other joint moves."""
        return self.home

    @property
    def bodies(self) -> list[str]:
        """See `Robot`."""
        first = int(self.model.jnt_bodyid[self._motors[0]])
        ids = [first, *(body for body in range(1, self.model.nbody) if body != first)]
        return [self.parts.bodies[body] for body in ids]

    def rest(self, zeros: Array) -> Array:
        """See `Robot`: nothing."""
        return np.zeros(0)

    def angles(self, positions: Array, rest: Array) -> Array:
        """See `Robot`: no other joint moves."""
        return positions

    def gripper_position(self, angles: Array, lengths: Array) -> Array:
        """See `Robot`."""
        return self._chain(self.parts.holder).carried(self.parts.at, angles, lengths / self.lengths)

    def within(self, points: Array) -> Flags:
        """See `Robot`: all that `lowest` and `highest` bound."""
        return np.ones(points.shape[:-1], bool)

    def frames(self, body: str, angles: Array, lengths: Array) -> tuple[Array, Array]:
        """See `Robot`."""
        return self._chain(self.parts.bodies.index(body)).frames(angles, lengths / self.lengths)

    def room_moved_with(self, body: str, angles: Array, lengths: Array) -> tuple[Array, Array]:
        """See `Robot`."""
        home, axes = self.home_frame(body)
        chain, room_at_home = self._chain(self.parts.bodies.index(body)), transform(axes.T, -axes.T @ home)
        return chain.frames(angles, lengths / self.lengths, room_at_home)

    def _chain(self, body: int) -> Chain:
        if body not in self._chains:
            self._chains[body] = Chain(self.model, body, self._motors, self._links, self.home_qpos)
        return self._chains[body]

    def scene(self, mounts: Mounts, furnish: Furnish | None = None) -> Scene:
        """See `Robot`."""
        if (key := (mounts, furnish)) not in self._scenes:
            gripper = self.parts.bodies[self.parts.holder], self.parts.at
            self._scenes[key] = build(
                self.spec, self.motors, gripper, mounts, self.home_qpos, self._marks, furnish
            )
        scene = self._scenes[key]
        return scene._replace(model=copy.copy(scene.model))

    def stretch(self, body_positions: Array, lengths: Array) -> None:
        """See `Robot`."""
        built = self.model.body_pos[self._links]
        body_positions[self._links] = built * (lengths / self.lengths)[:, None]

    @cached_property
    def _marks(self) -> GripperMarks:
        """Where cameras in the room see the gripper's marks best."""
        shares = np.random.default_rng(2).random((MARK_POSTURES, len(self.motors)))
        qpos = np.tile(self.home_qpos, (MARK_POSTURES, 1))
        qpos[:, self.qpos_of_motors] = self.postures(shares)
        holder, at, rig = self.parts.holder, self.parts.at, self.rig
        return GripperMarks(best_axis(self.model, qpos, holder, at, rig.position, rig.scale), rig.scale)

    def _rig(self) -> Rig:
        """Two cameras above and beside the work space, as far from it, for its size, as the RV-M2's."""
        shares = np.random.default_rng(1).random((POSTURES, len(self.motors)))
        reached = self.gripper_position(self.postures(shares), self.lengths)
        target = np.median(reached, axis=0)
        size = float(np.sqrt(np.square(reached - target).sum(-1).mean()))
        if size < SMALLEST:
            kind, name = self.parts.gripper
            raise ValueError(
                f"the motors {', '.join(self.motors)} turn the {kind} {name!r} and do not move it; gripper= "
                "names a site or body that is away from their axes"
            )
        base = self.frames(self.parts.base, self.home, self.lengths)[0]
        ahead = (target - base) * [1, 1, 0]
        far = float(np.linalg.norm(ahead))
        ahead = ahead / far if far > 0.1 * size else np.array([1.0, 0.0, 0.0])
        aside, up = np.array([-ahead[1], ahead[0], 0.0]), np.array([0.0, 0.0, 1.0])
        scale = size / MOVEMASTER_SIZE
        back, side, above = np.abs(MOVEMASTER_POSITION[0] - MOVEMASTER_TARGET)
        position = [target + scale * (above * up - back * ahead + sign * side * aside) for sign in (1, -1)]
        return Rig(np.array(position), target, scale)

    def _best_posture(self, draws: int = 2_000) -> Array:
        """Of drawn postures (m,) the one in which motors move the gripper most in its stiffest direction.

        Each motor's effect is that of its range, and counts less near a stop: so home is where the gripper
        can go anywhere, and no motor is near its end.
        """
        low, high = np.array([self.parts.stops(joint) for joint in self._motors]).T
        shares = np.random.default_rng(0).uniform(0.15, 0.85, (draws, len(low)))
        joints, step = low + shares * (high - low), 1e-4 * (high - low)
        at = self.gripper_position(joints, self.lengths)
        effects = [
            (self.gripper_position(joints + step * unit, self.lengths) - at) / 1e-4
            for unit in np.eye(len(low))
        ]
        room = 1 - np.abs(2 * shares - 1)
        singular = np.linalg.svd(np.stack(effects, -1) * room[:, None], compute_uv=False)
        ways = singular.max(0) >= RANK * singular.max()
        return np.asarray(joints[rounded(singular[:, ways][:, -1]).argmax()])
