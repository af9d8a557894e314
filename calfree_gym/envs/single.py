"""The single environment: one arm as a Gymnasium environment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from calfree_gym.envs.arms.state import RowState
from calfree_gym.envs.reaching import Reaching
from calfree_gym.envs.shared import RENDER_MODES, ArmShared, Events, GoalRewards
from calfree_gym.envs.spaces import GOALS, Observation, control_words
from calfree_gym.errors import known_arguments
from calfree_gym.perturbations.application import Applied
from calfree_gym.perturbations.base import Perturbation
from calfree_gym.perturbations.undo import Undo
from calfree_gym.robot.arms.arm import ArmChoice
from calfree_gym.world import World, WorldChoice


class ArmEnv(ArmShared, gym.Env[Any, Any]):
    """One arm: what a single environment of any task has."""

    metadata = {"render_modes": list(RENDER_MODES), "render_fps": 2}  # noqa: RUF012
    applied: list[Perturbation | Undo]
    """The perturbations that were applied before the last motion, with all that they drew."""

    def _build_one(self, arguments: dict[str, Any]) -> None:
        del arguments["self"]
        self._build(1, 1, **arguments)
        self.observation_space, self.action_space = self._spaces()
        self._action_shape = tuple(self.action_space.shape or ())
        self.applied = []

    @property
    def world(self) -> World:
        """The hidden world. For experiments, not for controllers."""
        return self.arms.world(0)

    @world.setter
    def world(self, world: World) -> None:
        self.set_world(world)

    @property
    def home_seconds(self) -> float:
        """Robot time of the way home from here, as `info["robot_seconds"]` is of a motion."""
        return float(self.arms.home_seconds()[0])

    def set_world(self, world: World) -> None:
        """Puts the robot into `world`; later seeds draw objects and noise only.

        Raises:
            TypeError: It is no `World`.
            ValueError: It is that of another arm, or not in view.
        """
        self.arms.set_world(0, world)

    def get_state(self) -> RowState:
        """All that the next steps and resets follow from, apart from the arguments: for planners.

        It can be pickled, and shares nothing with the environment. Wrappers, such as `TimeLimit`, keep counts
        of their own.

        Raises:
            gymnasium.error.ResetNeeded: No trial has begun.
        """
        self.arms.check_begun()
        return self.arms.get_state(0)

    def set_state(self, state: RowState) -> None:
        """Goes back to a state that `get_state` gave here, or in an environment of the same arguments.

        Raises:
            ValueError: It is no state, or that of another arm.
        """
        self.arms.set_state(0, state)
        self.arms.simulation.refresh()
        self.applied = []

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins a trial, see the class.

        Raises:
            ValueError: An option is not allowed, or no world or object can be drawn; says which.
        """
        objects = self._placed(options)
        super().reset(seed=seed)
        if seed is None and self.arms.needs_seed(0):
            seed = int(self.np_random.integers(2**31))
        if seed is not None:
            self.arms.seed(0, seed)
        applied = self.arms.begin_trial(slice(None), objects)
        self.arms.observe()
        observation, _, success = self._outcome()
        info = self._info(success, np.float64(0.0), applied, self._events())
        self._show()
        return {key: value[0] for key, value in observation.items()}, info

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Executes one motion, see the class.

        Raises:
            gymnasium.error.ResetNeeded: No trial has begun.
            ValueError: Words are not finite, or have another shape.
        """
        seconds, applied = self.arms.move(slice(None), control_words(action, self._action_shape))
        self.arms.observe()
        observation, distances, success = self._outcome()
        events = self._events()
        self._show()
        return (
            {key: value[0] for key, value in observation.items()},
            float(self._reward(distances, success)[0]),
            self._ends and bool(success[0]),
            bool(self._cut_short(events)[0]),
            self._info(success, seconds[0], applied, events),
        )

    def render(self) -> NDArray[np.uint8] | None:
        """The scene, and at its side both camera images with the image points (height, width, 3).

        Coloured rings are the points as observed; a thin one was seen there last, and is not seen now. The
        white ring around the object's point is the tolerance. With render_mode="human" MuJoCo's viewer shows
        the arm, and nothing is returned.

        Raises:
            gymnasium.error.DependencyNotInstalled: OpenGL or a screen is missing; names what to install.
        """
        return self._frame(0)

    def _info(
        self, success: Any, seconds: np.float64, applied: list[Applied], events: Events
    ) -> dict[str, Any]:
        self.applied = [perturbation for _, perturbation in applied]
        info: dict[str, Any] = {
            "is_success": np.array(success[0]),  # a numpy.bool would become an object in vector infos
            "robot_seconds": seconds,
            "perturbed": np.int64(len(applied)),
        } | {key: value[0] for key, value in events.items()}
        if self._gives_truth:
            info["truth"] = {key: value[0] for key, value in self._truth().items()}
        return info

    def close(self) -> None:
        """Frees the renderer."""
        self._close()


class StereoArmEnv(Reaching, ArmEnv):
    """A robot arm with two cameras and no calibration, whose task is to reach an object.

    ## Description
    A robot arm is seen by two cameras. It must bring its gripper to an object. The controller sends one
    control word to each motor and gets image points back. Cameras, arm and motors are unknown to it: they are
    the hidden `World`. After V. Graefe, "Calibration-Free Robots" (1999).

    The tables below are those of the paper's arm, which has five joints and three motors. Any other, given as
    `arm`, has three to seven motors: so many words and registers.

    ## Action space
    `Box(-1, 1, (3,), float32)`: one control word each for the motors of waist, shoulder and elbow.

    | num | word | effect |
    |---|---|---|
    | 0 | waist | unknown sign and size, smooth, 0 moves nothing; adds up in a register, up to the stop |
    | 1 | shoulder | the same |
    | 2 | elbow | the same |

    One step is one motion, executed until the arm has settled. Words outside the box are clipped to it.

    ## Observation space
    A `Dict` of a goal environment. Image points are (x, y), x right and y down, +-1 the image border.

    | key | shape | content |
    |---|---|---|
    | achieved_goal | (4,) | the gripper's sensor vector: (xa, ya, xb, yb), cameras a (left) and b (right) |
    | desired_goal | (4,) | the object's sensor vector |
    | observation | (7,) | 1 where seen now: gripper left, right, object left, right; then 3 registers |

    Registers tell what was executed, as exactly as the world does. They are within +-1, or as far as words of
    the worlds that the environment is made with add up (`World.word_gain`).

    A point is seen if it is in front of a camera and inside its image; with `occlusion` also only where
    neither the arm nor a mark nor a thing in the way hides its marks. A point that is not seen keeps its last
    value of this trial; before it is first seen it is (0, 0), the centre. One that would show a rendezvous
    by that is moved to just beyond the tolerance.

    ## Images
    Other observations come from images, rendered through each camera's lens in the world's light.

    | observation | keys |
    |---|---|
    | "vision" | as above: the points that `calfree_gym.vision.StereoTracker` finds in images of 512 x 512 |
    | "pixels" | pixels (s, s, 6), uint8, left then right; observation (3,): the registers |
    | "rgb" | left_image, right_image (s, s, 3), uint8; observation (3,) |
    | "depth" | left_depth, right_depth (s, s), in m along the camera's axis; observation (3,) |

    s is `image_size`. With images, points are hidden as with `occlusion`; reward, end and `is_success` follow
    from the true points, where all are seen now, and there is no `compute_reward` (but with "vision").

    ## Rewards
    `CalFree/Reach-v0`: 0 on the motion that reaches the rendezvous, -1 on every other.
    `CalFree/ReachDense-v0`: minus the mean of both image distances, in image units. Both follow from the
    observed points, also where latency delivers them late.

    ## Starting state
    The arm is at home, with registers zero. The object is in the work space, and both cameras see it.
    `reset(seed=k)` draws the world (if `world` names a distribution), objects and noise from k.
    `reset()` places the next object in the same world. `reset(options={"object": (x, y, z)})` places it at
    this point (in m), seen or not, if it is within 2 m of the middle of the work space (of another arm:
    in proportion to its size).

    ## Episode end
    Terminated at the rendezvous: both observed image distances within `tolerance_px`, unless
    `terminate_on_success=False`. Truncated after `max_episode_steps` (60) motions.

    ## Information
    The same keys, shapes and types at every step and reset. `is_success`: the observed rendezvous (an array
    without axes). `robot_seconds`: the time that a real arm would need. `perturbed`: how many perturbations
    were applied before the motion (a drift counts once, at its first step); `env.unwrapped.applied` lists
    them, with all that they drew.
    `truth`, unless `truth=False`: for scoring only, never for a controller: `error_px` (larger noise-free
    image distance), `distance_mm`, `points` (8,) in image units, `gripper` and `object` (3,) in m, `joints`
    (5,) in rad (of another arm: its motors' joints).

    ## Arguments

    Args:
        world: A `World`, also as the dict of its `to_dict`, or the distribution to draw from: "nominal",
            "coarse", "wild", "rough".
        arm: "movemaster" (the paper's), a `calfree_gym.Arm`, or a mapping of its arguments.
        camera_mount: "waist" (cameras on the body that the first motor moves, turning with it: the object
            then moves in the images, and hindsight relabelling is not valid), "stand" (in the room), the name
            of a body, or a pair of these, left and right.
        observation: "points", "vision", "pixels", "rgb" or "depth", see above.
        tolerance_px: Image distance of the rendezvous, in pixels of 512.
        dynamics: "physics", or "kinematic": the arm is placed where physics would settle.
        perturbations: A schedule, `[{"at": {"motion": 2000}, "do": {"type": "camera_roll"}}]`, see
            `calfree_gym.perturbations.parse_schedule`; the types and their settings are the classes of
            `calfree_gym.perturbations`.
        redraw: "never", or "trial": every trial in a new world, if `world` is a distribution.
        terminate_on_success: Whether the rendezvous ends the trial.
        keep_in_view: Whether worlds, perturbations and objects that the cameras do not see are drawn again.
        tell: Privileged quantities, as further observation keys: "joint_angles" (5,) and "joint_zeros" (4,)
            in rad (of another arm: its motors' joints; m where they slide), "gripper_position" (3,) in m,
            "object_registers" (3,): those that reach the object.
        truth: Whether `info` holds `truth`. A step is faster without it.
        occlusion: Whether points can be hidden. Then both cameras see all of the marks at home and at the
            rendezvous: worlds and objects are drawn again until they do. Always so where images are rendered.
        image_size: Width and height in pixels of "pixels", "rgb" and "depth".
        reward: "sparse" or "dense".
        render_mode: None, "rgb_array", or "human": MuJoCo's viewer.
        width: Of a frame, in pixels.
        height: Of a frame, in pixels: even, and at most the width.

    Raises:
        ValueError: An argument is not allowed, the arm cannot be used, or the given world is not in view.

    ## Version history
    v0: first version.
    """

    @known_arguments
    def __init__(
        self,
        *,
        world: WorldChoice = "wild",
        arm: ArmChoice = "movemaster",
        camera_mount: str | Sequence[str] = "waist",
        observation: str = "points",
        tolerance_px: float = 4.0,
        dynamics: str = "physics",
        perturbations: Any = None,
        redraw: str = "never",
        terminate_on_success: bool = True,
        keep_in_view: bool = True,
        tell: Sequence[str] = (),
        truth: bool = True,
        occlusion: bool = False,
        image_size: int = 128,
        reward: str = "sparse",
        render_mode: str | None = None,
        width: int = 1080,
        height: int = 720,
    ) -> None:
        self._build_one(locals())


class StereoArmGoalEnv(GoalRewards, StereoArmEnv):
    """A `StereoArmEnv` that observes image points: hindsight relabelling can compute its reward."""


def make(**arguments: Any) -> StereoArmEnv:
    """The environment of these arguments; for `gymnasium.make`."""
    goals = arguments.get("observation", "points") in GOALS
    return StereoArmGoalEnv(**arguments) if goals else StereoArmEnv(**arguments)
