"""N arms that grasp. Both environments step them."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from calfree_gym.envs.arms.contact_arms import ContactArms
from calfree_gym.envs.arms.sight import Seen
from calfree_gym.envs.arms.state import RowState
from calfree_gym.geometry import Array, Flags, Rows
from calfree_gym.image import IMAGE_SIZE, PIXELS_PER_UNIT
from calfree_gym.robot.grasping.gripping_arm import GrippingArm
from calfree_gym.robot.grasping.held import HeldPlacing, HeldSimulation
from calfree_gym.robot.grasping.in_sight import InSight
from calfree_gym.robot.grasping.jaws import STROKE
from calfree_gym.robot.grasping.placing import Placed, Placing
from calfree_gym.robot.grasping.shapes import ShapeChoice
from calfree_gym.robot.grasping.simulation import OBJECT, GraspSimulation
from calfree_gym.robot.grasping.tilting_arm import TiltingArm
from calfree_gym.tasks import grasp
from calfree_gym.world import World

TABLE = np.array([[-0.32, -0.62], [0.92, 0.62]])
"""From where to where the table goes (m): (x, y)."""
LYING, ANY = "lying", "any"
ORIENTATIONS: dict[str, tuple[type[GrippingArm], Any, type[Placing]]] = {
    LYING: (GrippingArm, GraspSimulation, Placing),
    ANY: (TiltingArm, HeldSimulation, HeldPlacing),
}
"""Of things, as they lie on the table or held in the air: the arm, the physics, and where they are."""
GRIPPER, HELD = slice(0, 2), slice(2 * OBJECT, 2 * OBJECT + 2)
"""Where the points of the gripper and of the object stand among the image points."""


class GraspingArms(ContactArms):
    """N arms, whose cameras see `robot.grasping.simulation.POINTS`.

    Attributes:
        jaws: Registers of the jaws (N,), from 0, open, to 1, closed.
        openings: How far jaws are open (N,), as a share.
        held: Whether the object is held (N,), as jaws and images tell.
        goals: Image points (N, 4) to which objects are to be lifted.
        forces: Largest force (N, 2) of the gripper on table and object in the last motion, in N.
        lifted: How high above where it lay the object stayed (N,) for a second, with something between the
            jaws, in m; else 0.
        off_table: Whether the object has left the table (N,).

    Args:
        rows: N.
        shape: Of things, see `robot.grasping.shapes`.
        orientation: Of things, of `ORIENTATIONS`.
        threads: Threads of the simulation; they change no number.
        camera_mount, keep_in_view, observation, image_size, **shared: See `ContactArms`.

    Raises:
        ValueError: See `Arms`.
    """

    shown_points: ClassVar[tuple[int, int, int, int]] = (0, 1, 2 * OBJECT, 2 * OBJECT + 1)
    state_names: ClassVar[tuple[str, ...]] = (
        *ContactArms.state_names,
        *("jaws", "openings", "held", "goals", "forces", "lifted", "placed", "_waited"),
    )

    def __init__(
        self,
        rows: int,
        *,
        camera_mount: str | tuple[str, ...],
        keep_in_view: bool,
        shape: ShapeChoice,
        orientation: str,
        threads: int,
        observation: str = "points",
        image_size: int = IMAGE_SIZE,
        **shared: Any,
    ) -> None:
        arm, simulation_of, placing_of = ORIENTATIONS[orientation]
        robot = arm()
        super().__init__(
            simulation_of(rows, robot, robot.mounts(camera_mount), threads),
            robot,
            camera_mount=camera_mount,
            keep_in_view=keep_in_view,
            observation=observation,
            image_size=image_size,
            **shared,
        )
        in_sight = InSight(self.simulation) if self._sight.renders else None
        self.placing = placing_of(robot, self._workspaces, self.motors, shape, keep_in_view, in_sight)
        self.jaws, self.openings = np.zeros(rows), np.ones(rows)
        self.held, self._waited = np.zeros(rows, bool), np.zeros(rows, bool)
        self.goals, self.forces, self.lifted = np.zeros((rows, 4)), np.zeros((rows, 2)), np.zeros(rows)
        self.placed: list[Placed | None] = [None] * rows
        self._lay = np.zeros(rows)  # the height of what was placed
        self.delivered: Seen = (self.points, self.visible, self.held, *self._sight.images)

    def enter(self, row: int, world: World) -> None:
        """See `Arms`: a thing keeps its shape, and gets the mass and the friction of the world."""
        super().enter(row, world)
        if (placed := self.placed[row]) is not None:
            self._weigh(row, placed)

    def serves(self, row: int, world: World) -> bool:
        """See `ContactArms`: things can be grasped there."""
        return self.placing.serves(row, world)

    def _weigh(self, row: int, placed: Placed) -> None:
        world = self.world(row)
        self.simulation.set_thing(row, placed.thing, float(world.object_mass), float(world.object_friction))
        self._lay[row] = placed.pose[2]

    def next_objects(self, rows: NDArray[np.intp], given: Array | None) -> Array:
        """See `Arms`: poses (n, 4) or (n, 7); given are places (n, 2), or with an angle (n, 3), or poses."""
        poses = []
        for i, row in enumerate(rows.tolist()):
            which = row, self._seeds[row] or 0, int(self.trials[row]), self.world(row)
            placed = self.placing.draw(*which) if given is None else self.placing.given(*which, given[i])
            self.placed[row] = placed
            self._weigh(row, placed)
            self.goals[row] = np.clip(placed.goal, -1, 1)
            poses.append(placed.pose)
        return np.array(poses)

    def begun(self, rows: Rows) -> None:
        """See `Arms`: the jaws are open."""
        self.jaws[rows], self.openings[rows], self.held[rows] = 0.0, 1.0, False
        self.forces[rows], self.lifted[rows], self._waited[rows] = 0.0, 0.0, False
        super().begun(rows)

    def execute(self, rows: Rows, words: Array) -> Array:
        """See `Arms`: with something between its jaws, an arm waits for a second after each motion."""
        indices, simulation = self._all[rows], self.simulation
        words = words.reshape(len(indices), -1)
        self.jaws[rows] = jaws = np.minimum(np.maximum(self.jaws[rows] + words[:, -1], 0.0), 1.0)
        seconds, motion = self.travelled(rows, words[:, :-1], STROKE * (1 - jaws))
        self.forces[rows] = motion.forces
        self.openings[rows] = simulation.openings()[rows] / STROKE
        self._waited[rows] = False
        heights = simulation.heights()
        holding = indices[grasp.blocked(self.openings[rows], jaws) & ~simulation.diverged[rows]]
        if len(holding):
            forces, heights[holding] = simulation.wait(holding)
            simulation.recover()
            self.forces[holding] = np.maximum(self.forces[holding], forces)
            self.openings[holding] = simulation.openings()[holding] / STROKE
            self._waited[holding] = True
        waited = self._waited[rows] & ~simulation.diverged[rows]
        self.lifted[rows] = np.where(waited, heights[rows] - self._lay[rows], 0.0)
        return seconds + self._waited[rows]

    def observe(self) -> None:
        """See `Arms`."""
        motions = self.motions_of_trial
        way, both, images = self.look()
        self.held = grasp.held(
            grasp.blocked(self.openings, self.jaws) & (motions > 0),
            self.held,
            way[:, GRIPPER],
            way[:, HELD],
            np.logical_and.reduce(both[:, GRIPPER] & both[:, HELD], 1),
        )
        seen_now = self.points, self.visible, self.held, *images
        self.delivered = self._latency.deliver(motions, *seen_now)

    def set_state(self, row: int, state: RowState) -> None:
        """See `Arms`."""
        super().set_state(row, state)
        if (placed := self.placed[row]) is not None:
            self._weigh(row, placed)

    def shown(self, row: int) -> tuple[Array, Flags, Array]:
        """See `Arms`: the target is where the object is to be lifted to."""
        return *super().shown(row)[:2], self.goals[row].reshape(1, 2, 2)

    @property
    def off_table(self) -> Flags:
        """Whether the object of a row has left the table (N,)."""
        place = self.simulation.positions()[1][:, :2]
        outside = (place < TABLE[0]) | (place > TABLE[1])
        return outside[:, 0] | outside[:, 1]

    def error_px(self) -> Array:
        """Noise-free image distances (N,) in pixels of objects from where they are to be lifted to."""
        away = self.true_points[:, HELD] - self.goals.reshape(-1, 2, 2)
        return np.asarray(PIXELS_PER_UNIT * np.sqrt(np.square(away).sum(-1)).max(1))
