"""Arms that grasp: gravity, contacts, smooth motions, and a guard that stops an arm that presses."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from calfree_gym.geometry import Array, Rows
from calfree_gym.image import PIXELS_PER_UNIT
from calfree_gym.robot.arms.robot import Mounts
from calfree_gym.robot.grasping.gripping_arm import JAWS, SENSORS, GrippingArm
from calfree_gym.robot.grasping.shapes import Thing
from calfree_gym.robot.simulation import Picture, Simulation, columns
from calfree_gym.vision.cameras import pinhole

CHUNK = 10
"""Substeps after which the guard looks at the forces."""
LEAST_CHUNKS, SETTLING = 7, 3
"""Chunks of the ramp at least, and after it."""
RETREAT = 0.5
"""An arm that presses goes back by this share of the way that it had come when the chunk began."""


class Ramp(NamedTuple):
    """Where arms and jaws are meant to be on their ways.

    Attributes:
        arms: Shares of the arms' ways (n, k) after each substep.
        jaws: The same of the jaws, which go on.
        substeps: After which all is over (n,).
        executed: Of the arms' ways (n,), in the end.
    """

    arms: Array
    jaws: Array
    substeps: NDArray[np.int64]
    executed: Array


def onward(chunks: NDArray[np.int64]) -> Ramp:
    """Ways that take so many chunks (n,), to their ends."""
    substeps = CHUNK * (chunks + SETTLING)
    shares = _shares(chunks, substeps)
    return Ramp(shares, shares, substeps, np.ones(len(chunks)))


def turning_back(chunks: NDArray[np.int64], turns: NDArray[np.int64]) -> Ramp:
    """The same, with arms that turn back: the guard saw them press in chunk `turns` (n,), from 0."""
    back = np.maximum(LEAST_CHUNKS, turns)
    substeps = CHUNK * (np.maximum(chunks, turns + back) + SETTLING)
    shares = _shares(chunks, substeps)
    since = np.arange(1.0, shares.shape[1] + 1) - CHUNK * turns[:, None]
    there = smooth(np.minimum(turns / chunks, 1.0))
    returning = there[:, None] * (1 - RETREAT * smooth(np.clip(since / (CHUNK * back[:, None]), 0, 1)))
    arms = np.where(since <= CHUNK, shares, returning)
    return Ramp(arms, shares, substeps, there * (1 - RETREAT))


def _shares(chunks: NDArray[np.int64], substeps: NDArray[np.int64]) -> Array:
    """Of ways that take so many chunks (n,), as far as the longest lasts (n, k)."""
    count = np.arange(1.0, np.maximum.reduce(substeps) + 1)
    return smooth(np.minimum(count / (CHUNK * chunks[:, None]), 1.0))


def smooth(times: Array) -> Array:
    """The way of least jerk: shares of it (...) at shares (...) of the time."""
    return np.asarray(times * times * times * (10 + times * (6 * times - 15)))


POINTS = (
    *("gripper_point", "gripper_base", "jaw_1_tip", "jaw_2_tip", "edge_1", "edge_2"),
    *("object_point", "axis_1", "axis_2"),
)
"""What cameras see: the gripper's point and base, tips and edges, the object and the ends of its axis."""
OBJECT = POINTS.index("object_point")
SPEED, TURNING = 0.4, 2.0
"""The gripper's speed (m/s), along the chord of its way, and that of joints (rad/s) at most. Choice: about
the RV-M2's."""
PEAK = 1.875
"""Of a motion of least jerk: its speed at most, relative to the mean."""
GUARD, RISES = 12.0, 1.0
"""An arm stops that presses by this force (N) more than when its motion began, and ever more: by this (N)."""
PINNED = 24.0
"""Of what it pressed with then, so much counts (N). Choice: it gets away with what jaws have closed on."""
GRAVITY = 9.81
"""Of things (m/s²): the arm's own controller carries its weight, see `arm.xml`."""
SECOND = 200
"""Substeps of a second."""
_OF_GEOMS = ("geom_type", "geom_size", "geom_pos", "geom_rbound", "geom_aabb")
_OF_BODIES = (
    *("body_mass", "body_subtreemass", "body_inertia", "body_ipos", "body_iquat", "body_invweight0"),
)
_OF_DOFS = ("dof_invweight0", "dof_M0", "dof_length")


Control = Callable[[Rows, slice], Array]
"""Of the arms at some places (m,) of those that move, in some substeps: (m, k, nu)."""


class Motion(NamedTuple):
    """What became of a motion.

    Attributes:
        shares: Of the way (n,), in joints: less than 1 where the guard stopped the arm.
        forces: Largest force of a contact (n, 2), of the gripper with the table and with the object (N).
    """

    shares: Array
    forces: Array


class GraspSimulation(Simulation):
    """N arms that grasp things.

    Attributes:
        diverged: Whether the physics of a row (N,) has diverged since it was placed.

    Args:
        rows, robot, mounts, threads: See `Simulation`.
    """

    state_names: ClassVar[tuple[str, ...]] = (*Simulation.state_names, "_pressing", "diverged")
    seen: ClassVar[tuple[str, ...]] = POINTS
    """What cameras see; `OBJECT` is the place of what the task is about."""
    told: ClassVar[slice] = slice(0, 2)
    """Which of `SENSORS` a `Motion` tells the largest forces of."""
    pinned: ClassVar[float] = PINNED
    """Of what an arm pressed with when a motion began, so much counts (N)."""

    def __init__(self, rows: int, robot: GrippingArm, mounts: Mounts, threads: int) -> None:
        super().__init__(rows, robot, robot.scene(mounts), mounts, threads)
        model = self._model
        self._camera_places, self._camera_axes = self._batch.bind("cam_xpos"), self._batch.bind("cam_xmat")
        self._site = [model.site(name).id for name in self.seen]
        self._in_view, self._both = np.array(self._site), columns(np.array(self._cameras))
        self._jaw = int(model.joint(JAWS[0]).qposadr[0])
        self._gripper = [int(model.joint(name).qposadr[0]) for name in (*JAWS, "wrist_spring")]
        self._body = int(model.body("object").id)
        self._fields = {name: self._batch.expand(name) for name in self._bind_object(model)}
        self._weights = self._batch.bind("xfrc_applied")[:, self._body, 2]
        self._warm = self._batch.bind("qacc_warmstart")
        self._at_rest = self._physics[0].copy()
        self._pressing = np.zeros(rows)
        self.diverged = np.zeros(rows, bool)

    def _bind_object(self, model: mujoco.MjModel) -> tuple[str, ...]:
        """Finds the object in the model; names the fields that make it another one in each row."""
        self._free = int(model.joint("object").qposadr[0])
        self._dof = int(model.joint("object").dofadr[0])
        self._geoms = [model.geom(f"object_{part}").id for part in (1, 2)]
        self._pads = [model.geom(f"{name}_pad").id for name in JAWS]
        own = ("site_pos", "geom_friction", "geom_condim", "geom_contype", "geom_conaffinity")
        return (*_OF_GEOMS, *_OF_BODIES, *_OF_DOFS, *own)

    def set_thing(self, row: int, thing: Thing, mass: float, friction: float) -> None:
        """Gives `row` a thing of this mass (kg), and this friction between it and the jaws."""
        fields, alone = self._fields, _alone(thing, mass)
        self._weights[row] = -mass * GRAVITY
        for name in _OF_BODIES:
            fields[name][row, self._body] = getattr(alone, name)[1]
        for name in _OF_DOFS:
            fields[name][row, self._dof : self._dof + 6] = getattr(alone, name)
        for part, geom in enumerate(self._geoms):
            there = part < alone.ngeom
            for name in _OF_GEOMS:
                fields[name][row, geom] = getattr(alone, name)[part if there else 0]
            fields["geom_contype"][row, geom] = fields["geom_conaffinity"][row, geom] = int(there)
            rolls = thing.shape in ("sphere", "cylinder")
            fields["geom_condim"][row, geom] = 6 if rolls else 3
            fields["geom_friction"][row, geom] = [0.6, 0.005, 0.002 if rolls else 0.0001]
        fields["geom_friction"][row, self._pads] = [friction, 0.01, 0.0001]
        for name, end in (("axis_1", thing.axis), ("axis_2", -thing.axis)):
            fields["site_pos"][row, self._site[POINTS.index(name)]] = end

    def place(self, rows: Rows, joints: Array, objects: Array) -> None:
        """See `Simulation`: objects are (n, 4), their place in m, and their angle about the vertical."""
        self._all_qpos[rows], self._all_ctrl[rows], self._qvel[rows] = self._scene.home, self._scene.ctrl, 0.0
        self._all_qpos[rows, self._qpos] = joints
        self._all_ctrl[rows, self._ctrl] = joints
        self._put(rows, objects)
        self._pressing[rows], self.diverged[rows], self._warm[rows] = 0.0, False, 0.0

    def _put(self, rows: Rows, objects: Array) -> None:
        """Puts objects at their places, see `place`."""
        free = np.zeros((len(objects), 7))
        free[:, :3], half = objects[:, :3], objects[:, 3] / 2
        free[:, 3], free[:, 6] = np.cos(half), np.sin(half)
        self._all_qpos[rows, self._free : self._free + 7] = free

    def move(self, rows: NDArray[np.intp], joints: Array, openings: Array) -> Motion:
        """Moves the arms of `rows` to joints at (n, j), and each jaw to an opening (n,) in m.

        Targets travel with least jerk, and not faster than `SPEED`. An arm that presses goes back half of the
        way that it has come; its jaws go on.
        """
        before = self._all_ctrl[rows]
        way = np.empty_like(before)
        way[:, :-1], way[:, -1] = joints, openings
        way -= before
        chunks = self._chunks(rows, before[:, :-1], way[:, :-1])
        start, pressed = self._physics[rows], self._pressing[rows]
        passed = len(self.way or ())
        ramp = onward(chunks)
        executed, (largest, pressing) = ramp.executed, self._follow(rows, before, way, ramp)
        back, turns = _turns(pressing, np.minimum(pressed, self.pinned))
        if len(back):
            self._physics[rows[back]] = start[back]
            if self.way is not None and back[0] == 0:
                del self.way[passed:]
            ramp = turning_back(chunks[back], turns)
            executed[back] = ramp.executed
            largest[back], _ = self._follow(rows[back], before[back], way[back], ramp)
        self._see_diverged(rows)
        return Motion(executed, largest)

    def wait(self, rows: NDArray[np.intp]) -> tuple[Array, Array]:
        """Lets a second pass in `rows`.

        Returns:
            Largest forces (n, 2) as in `Motion`, and the lowest height (n,) of the objects meanwhile, in m.
        """
        before = self.heights()[rows]
        largest, _ = self._step(rows, np.full(len(rows), SECOND))
        self._see_diverged(rows)
        return largest, np.minimum(before, self.heights()[rows])

    def _follow(self, rows: NDArray[np.intp], before: Array, way: Array, ramp: Ramp) -> tuple[Array, Array]:
        """Moves `rows` along their ways (n, nu) from where controls were before: see `_step`."""

        def control(on: Rows, when: slice) -> Array:
            there = ramp.arms[on, when, None] * way[on, None]
            if ramp.jaws is not ramp.arms:
                there[..., -1] = ramp.jaws[on, when] * way[on, -1:]
            there += before[on, None]
            return there

        return self._step(rows, ramp.substeps, control)

    def _step(
        self, rows: NDArray[np.intp], substeps: NDArray[np.int64], control: Control | None = None
    ) -> tuple[Array, Array]:
        """Steps `rows`, each by its number (n,) of substeps.

        Args:
            rows: Which (n,).
            substeps: Of each.
            control: Of some of these rows in some of the substeps; None leaves it as it is.

        Returns:
            Largest forces (n, 2) as in `Motion`, and what the arms press with (n, chunks) after each chunk.
        """
        fields = ("sensordata",) if self.way is None else ("sensordata", "qpos")
        largest, pressing = np.zeros((len(rows), 2)), np.zeros((len(rows), int(substeps.max()) // CHUNK))
        since = 0
        for until in sorted(set(substeps.tolist())):
            on: Rows = (substeps >= until).nonzero()[0] if since else slice(None)
            ids = rows[on]
            recorded = self._batch.rollout(
                until - since,
                None if control is None else control(on, slice(since, until)),
                record=fields,
                ids=None if len(ids) == self.rows else ids,
            )
            felt = recorded["sensordata"]
            if felt.any():
                forces = felt.reshape(len(ids), until - since, len(SENSORS), 3)
                told, ends = forces[:, :, self.told], forces[:, CHUNK - 1 :: CHUNK]
                squares = np.einsum("nkfc,nkfc->nfk", told, told, order="C")
                largest[on] = np.maximum(largest[on], np.sqrt(np.maximum.reduce(squares, -1)))
                net = ends[:, :, 2] + ends[:, :, 3]
                pressing[on, since // CHUNK : until // CHUNK] = np.sqrt(np.add.reduce(net * net, -1))
            if self.way is not None and substeps[0] >= until:
                self.way.extend(recorded["qpos"][0, CHUNK - 1 :: CHUNK])
            since = until
        self._pressing[rows] = pressing[np.arange(len(rows)), substeps // CHUNK - 1]
        return largest, pressing

    def _chunks(self, rows: NDArray[np.intp], joints: Array, way: Array) -> NDArray[np.int64]:
        """How many chunks a ramp takes (n,)."""
        lengths, both = self._lengths[rows], np.concatenate([joints + way, joints])
        places = self._robot.gripper_position(both, np.concatenate([lengths, lengths]))
        apart = places[: len(rows)] - places[len(rows) :]
        far, turn = np.sqrt(np.add.reduce(apart * apart, -1)), np.maximum.reduce(np.abs(way), -1)
        seconds = np.maximum(far / SPEED, turn / TURNING) * (PEAK / (CHUNK * self._model.opt.timestep))
        return np.maximum(np.ceil(seconds), LEAST_CHUNKS).astype(np.int64)

    def _see_diverged(self, rows: NDArray[np.intp]) -> None:
        """Notes which of `rows` have diverged."""
        self.diverged[rows] |= ~np.logical_and.reduce(np.isfinite(self._all_qpos[rows]), 1)

    def recover(self) -> None:
        """Puts rows whose physics has diverged at rest at home, the object out of the way: all is finite."""
        if not self.diverged.any():
            return
        rows = (self.diverged & ~np.isfinite(self._physics).all(1)).nonzero()[0]
        weights = self._weights[rows]
        self._physics[rows], self._weights[rows] = self._at_rest, weights

    def openings(self) -> Array:
        """How far each jaw of a row is open (N,), in m."""
        return self._all_qpos[:, self._jaw].copy()

    def heights(self) -> Array:
        """Of the objects above the table (N,), in m."""
        return self._all_qpos[:, self._free + 2].copy()

    def pinhole_pixels(self) -> tuple[Array, Array]:
        """See `Simulation`: of all `POINTS`."""
        points = self._sites.take(self._in_view, 1)[:, :, None]
        places, axes = self._camera_places[:, self._both], self._camera_axes[:, self._both]
        flat, depth = pinhole(points, places[:, None], axes.reshape(-1, 1, 2, 3, 3))
        pixels = flat * self._focal[:, None] + PIXELS_PER_UNIT
        return pixels.reshape(self.rows, -1, 2), depth.reshape(self.rows, -1)

    def positions(self) -> tuple[Array, Array]:
        """See `Simulation`."""
        return self._sites[:, self._site[0]].copy(), self._sites[:, self._site[OBJECT]].copy()

    def show_object(self, row: int, picture: Picture, object_: Array | None) -> None:
        """See `Simulation`: where it would be, the gripper is open and unloaded."""
        model, data = picture
        for name, values in self._fields.items():
            getattr(model, name)[:] = values[row]
        model.geom_rgba[self._geoms, 3] = self._fields["geom_contype"][row, self._geoms]
        if object_ is not None:
            data.qpos[self._gripper] = self._scene.home[self._gripper]
            data.qpos[self._free : self._free + 3] = object_


def _turns(pressing: Array, pressed: Array) -> tuple[NDArray[np.intp], NDArray[np.int64]]:
    """Which arms (b,) of n the guard stops, and in which chunk (b,).

    Args:
        pressing: With what force (n, chunks) the arms press at the end of each chunk, in N.
        pressed: With what they did before (n,), as far as it counts.
    """
    if not (pressing > GUARD).any():
        return np.empty(0, np.intp), np.empty(0, np.int64)
    before = np.empty_like(pressing)
    before[:, 0], before[:, 1:] = pressed, pressing[:, :-1]
    stops = (pressing > GUARD + pressed[:, None]) & (pressing > before + RISES)
    back = np.logical_or.reduce(stops, 1).nonzero()[0]
    return back, stops[back].argmax(1)


def _alone(thing: Thing, mass: float) -> mujoco.MjModel:
    """A model of nothing but a thing: MuJoCo reckons its inertia, bounds and weights."""
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(name="object")
    body.add_freejoint()
    volumes = np.array([_volume(part.kind, part.size) for part in thing.parts])
    for part, share in zip(thing.parts, volumes / volumes.sum(), strict=True):
        body.add_geom(type=part.kind, size=part.size, pos=part.place, mass=mass * share)
    return spec.compile()


def _volume(kind: object, size: Array) -> float:
    """In m³."""
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return float(4 / 3 * np.pi * size[0] ** 3)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return float(2 * np.pi * size[0] ** 2 * size[1])
    return float(8 * size.prod())
