"""The calibrated robot that the paper argues against: it goes by its models (section 2.2)."""

from collections.abc import Generator
from typing import Any

import gymnasium as gym
import numpy as np

from calfree_gym.world import nominal

from ..base.observation import POINTS, Array, Observation
from ..base.prior_knowledge import PriorKnowledge
from ..base.procedure import Procedure, ProcedureAgent
from ..base.registration import agent
from ..servo.jacobian import linear_deviations_px
from ..servo.perception import ObservationFilter
from ..servo.trial import half_way_back
from .robot_model import RobotModel


@agent(
    "model_based",
    "The calibrated robot that the paper argues against: triangulates, solves, moves.",
    arms="movemaster",
)
class ModelBased(ProcedureAgent):
    """Stereo evaluation and inverse kinematics by the model of the robot as built.

    The traditional control of the paper's section 2.2: stereo evaluation delivers the location of the object,
    inverse kinematics the joint angles that bring the gripper there.

    It gets no privileged observations. Its prior knowledge is the simulator's nominal world in every
    number, that is, cameras, lens, link lengths, joint zeros and limits, the motors' gains, signs
    and curve; and what the cameras are fixed to. In other worlds it is as wrong as these differ from that.

    Args:
        camera_mount: What the cameras are fixed to: "waist" or "stand".
    """

    prior_knowledge = frozenset(
        {
            PriorKnowledge.IMAGE_SCALE,
            PriorKnowledge.CAMERA_MODEL,
            PriorKnowledge.ARM,
            PriorKnowledge.MOUNT,
            PriorKnowledge.MOTOR_ORDER,
            PriorKnowledge.WORD_LIMIT,
        }
    )
    DRIFT_PX = 1.0
    """By how much, seen in the images, the goal moves from motion to motion where the model is not true.
    Tuned on wild worlds 3000 and up."""

    def __init__(self, env: gym.Env[Any, Any], camera_mount: str = "waist", seed: int = 0) -> None:
        super().__init__(env, seed)
        self.camera_mount = camera_mount
        self.model = RobotModel.of(nominal(), camera_mount)

    @property
    def kind(self) -> str:
        return f"ModelBased(camera_mount={self.camera_mount!r})"

    def procedure(self, first: Observation, findings: None) -> Procedure:
        """Goes to where the object is by the model; where it misses, moves by what still lies between.

        The gripper is triangulated too, and only its difference to the object is used, so that errors which
        both share cancel (position-based look-and-move with the endpoint closed loop, after Hutchinson, Hager
        & Corke 1996). A scalar Kalman filter smooths the goal: this matters only in noise.
        """
        filter_, model = ObservationFilter(), self.model
        now = yield from filter_.first(first)
        goal, variance = np.zeros(3), np.inf
        while True:
            object_, measured_goal = self._evaluate_stereo(now)
            variance += self.DRIFT_PX**2
            gain = 1.0 if np.isinf(variance) else variance / (variance + filter_.noise.px**2)
            goal = goal + gain * (measured_goal - goal)
            variance = filter_.noise.px**2 * gain
            words = model.registers(goal) - now.registers
            now = (yield from move_by_model(model, object_, filter_, now, words))[-1]

    def _evaluate_stereo(self, now: Observation) -> tuple[Array, Array]:
        """The object's position (3,), and the goal for the inverse kinematics (3,), in m.

        At home the goal is the object's position. Later it is the gripper's position by the kinematic model,
        plus the vector from the triangulated gripper to the triangulated object.
        """
        joints = self.model.joints(now.registers[None])
        gripper, object_ = self.model.triangulate(np.stack([now.gripper, now.object]), joints)
        if not now.registers.any():
            return object_, object_
        return object_, self.model.gripper(joints)[0] + object_ - gripper


def move_by_model(
    model: RobotModel, object_: Array, filter_: ObservationFilter, before: Observation, words: Array
) -> Generator[Array, Observation, list[Observation]]:
    """Executes words (m,), and where that loses a point from view, goes half of the way back.

    Args:
        model: By which points are predicted.
        object_: Where it has the object (3,), in m.
        filter_: Tells which observations to trust, by what is predicted.
        before: The trusted observation before.
        words: Control words (m,).

    Returns:
        The trusted observation after each motion.
    """
    observations = [before]
    while True:
        now = yield words
        registers = np.stack([observations[-1].registers, now.registers])
        start, end = model.points(registers, np.stack([object_, object_]))
        deviations_px = linear_deviations_px(end - start, np.ones(POINTS, bool))
        expected = observations[-1].points + end - start
        settled = yield from filter_.settle(now, observations[-1], expected, deviations_px)
        observations.append(settled)
        if not filter_.lost.any():
            return observations[1:]
        words = half_way_back(before, observations[-1])
