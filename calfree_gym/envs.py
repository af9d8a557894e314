"""The black box as Gymnasium environments: one arm, or many stepped together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from calfree_gym.arms import MOTORS, Perturbed, StereoArms, WorldChoice, _check_choice
from calfree_gym.tasks import reach
from calfree_gym.world import World

Observation = dict[str, NDArray[np.float32]]
REWARDS = {"sparse": reach.sparse_reward, "dense": reach.dense_reward}
OBSERVATIONS = ("points",)
RENDER_MODES = ("rgb_array",)


def _observation_space() -> spaces.Dict:
    unit = {"low": -1.0, "high": 1.0, "dtype": np.float32}
    return spaces.Dict(
        {
            "achieved_goal": spaces.Box(shape=(4,), **unit),  # type: ignore[arg-type]
            "desired_goal": spaces.Box(shape=(4,), **unit),  # type: ignore[arg-type]
            "observation": spaces.Box(shape=(4 + MOTORS,), **unit),  # type: ignore[arg-type]
        }
    )


def _action_space() -> spaces.Box:
    return spaces.Box(-1.0, 1.0, (MOTORS,), np.float32)


def _words(action: Any, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Control words from an action, clipped to [-1, 1].

    Raises:
        ValueError: The action has another shape, or is not finite.
    """
    words = np.asarray(action, np.float64)
    if words.shape != shape:
        raise ValueError(f"the action has shape {words.shape}; it must be {shape}, one word a motor")
    if np.abs(words).max() <= 1:
        return words
    if not np.isfinite(words).all():
        raise ValueError(f"the action is {words.tolist()}; control words must be finite, in [-1, 1]")
    return np.clip(words, -1.0, 1.0)


class _StereoArmGoal:
    """What the single and the batched environment share: arguments, observations, rewards."""

    def _build(
        self, rows: int, threads: int, reward: str, observation: str, render_mode: Any, **arms: Any
    ) -> None:
        _check_choice("reward", reward, tuple(REWARDS))
        _check_choice("observation", observation, OBSERVATIONS)
        if render_mode is not None:
            _check_choice("render_mode", render_mode, RENDER_MODES)
        self.arms = StereoArms(rows, threads=threads, **arms)
        self.render_mode = render_mode
        self._reward = REWARDS[reward]
        self._renderer: Any = None
        self._seen = np.zeros((rows, 4 + MOTORS), np.float32)

    def _goals(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        points = self.arms.points.astype(np.float32).reshape(-1, 8)
        return points[:, :4], points[:, 4:]

    def _flags_and_registers(self) -> NDArray[np.float32]:
        seen = self._seen.copy()
        seen[:, :4] = self.arms.visible
        seen[:, 4:] = self.arms.registers
        return seen

    def compute_reward(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """The reward (...) for sensor vectors (..., 4); pure, and what `step` returns."""
        distances = reach.image_distances(achieved_goal, desired_goal)
        return self._reward(distances, reach.rendezvous(distances, self.arms.tolerance))

    def compute_terminated(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """Whether a trial ends (...) at sensor vectors (..., 4); pure, and what `step` returns."""
        distances = reach.image_distances(achieved_goal, desired_goal)
        ended = reach.rendezvous(distances, self.arms.tolerance)
        return ended if self._ends else np.zeros_like(ended)

    def compute_truncated(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Any:
        """False: no goal cuts a trial short; the number of motions does (see `max_episode_steps`)."""
        return np.zeros(np.shape(achieved_goal)[:-1], bool)

    def _truth(self) -> dict[str, Any]:
        gripper, object_ = self.arms.simulation.positions()
        apart = gripper - object_
        return {
            "error_px": self.arms.error_px(),
            "distance_mm": 1000.0 * np.sqrt((apart * apart).sum(-1)),
            "points": self.arms.true_points.reshape(-1, 8),
            "gripper": gripper,
            "object": object_,
            "joints": self.arms.simulation.joints(),
        }

    def _frame(self, row: int) -> NDArray[np.uint8]:
        if self._renderer is None:
            from calfree_gym.rendering import SceneRenderer

            self._renderer = SceneRenderer()
        frame: NDArray[np.uint8] = self._renderer.draw(self.arms, row)
        return frame

    def close(self) -> None:
        """Frees the renderer, if an image was ever asked for."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


class StereoArmEnv(_StereoArmGoal, gym.Env[Observation, NDArray[np.float32]]):
    """## Description
    A robot arm of five joints, seen by two cameras, is to bring its gripper to an object. The controller
    sends one control word to each of three motors and gets image points back; it knows neither cameras nor
    arm nor motors. All of that is the hidden `World`. After V. Graefe, "Calibration-Free Robots" (1999).

    ## Action space
    `Box(-1, 1, (3,), float32)`: one control word each for the motors of waist, shoulder and elbow.

    | num | word | effect |
    |---|---|---|
    | 0 | waist | unknown sign and size, smooth, 0 moves nothing; words add up in a register that ends at +-1 |
    | 1 | shoulder | likewise |
    | 2 | elbow | likewise |

    One step is one motion, executed until the arm has settled. Words outside the box are clipped to it.

    ## Observation space
    A `Dict` of a goal environment. Image points are (x, y), x right and y down, +-1 the image border.

    | key | shape | content |
    |---|---|---|
    | achieved_goal | (4,) | the gripper's sensor vector: (xa, ya, xb, yb), cameras a (left) and b (right) |
    | desired_goal | (4,) | the object's sensor vector |
    | observation | (7,) | 1 where seen now: gripper left, right, object left, right; then the three registers |

    A point that is not seen keeps its last seen value (the centre, where it never was seen).

    ## Rewards
    `CalFree/Reach-v0`: 0 on the motion that reaches the rendezvous, -1 on every other.
    `CalFree/ReachDense-v0`: minus the mean of both image distances. Both follow from the observed points.

    ## Starting state
    The arm at home, registers zero; the object somewhere in the work space, seen by both cameras.
    `reset(seed=k)` draws the world (where `world` names a distribution), objects and noise from k;
    `reset()` places the next object in the same world; `reset(options={"object": (x, y, z)})` places it there.

    ## Episode end
    Terminated at the rendezvous: both observed image distances within `tolerance_px`, unless
    `terminate_on_success=False`. Truncated after `max_episode_steps` (60) motions.

    ## Information
    `is_success`: the observed rendezvous. `robot_seconds`: time that a real arm would take for the motion.
    `perturbed`: perturbations that struck before it. `truth`: for scoring only, never for a controller:
    `error_px` (larger noise-free image distance), `distance_mm`, `points` (8,), `gripper`, `object`, `joints`.

    ## Arguments
    Args:
        world: A `World`, or the distribution to draw from: "nominal", "coarse", "wild".
        camera_mount: "waist" (cameras on the arm's first link, turning with it: the object then moves in the
            images when the waist turns, so hindsight relabelling is not valid) or "stand" (fixed in the room).
        observation: "points".
        tolerance_px: Image distance of the rendezvous, in pixels of 512.
        dynamics: "physics", or "kinematic": the arm is put where physics would settle.
        perturbations: A schedule, `[{"at": {"motion": 2000}, "do": {"type": "camera_roll"}}]`.
        terminate_on_success: Whether the rendezvous ends the trial.
        reward: "sparse" or "dense".
        render_mode: None or "rgb_array".

    Raises:
        ValueError: An argument is not allowed, or the given world is not in view.

    ## Version history
    v0: first version.
    """

    metadata = {"render_modes": list(RENDER_MODES), "render_fps": 2}  # noqa: RUF012

    def __init__(
        self,
        *,
        world: WorldChoice = "wild",
        camera_mount: str = "waist",
        observation: str = "points",
        tolerance_px: float = 4.0,
        dynamics: str = "physics",
        perturbations: Any = None,
        terminate_on_success: bool = True,
        reward: str = "sparse",
        render_mode: str | None = None,
    ) -> None:
        self._build(
            1,
            1,
            reward,
            observation,
            render_mode,
            world=world,
            camera_mount=camera_mount,
            tolerance_px=tolerance_px,
            dynamics=dynamics,
            perturbations=perturbations,
        )
        self._ends = terminate_on_success
        self._seeded = False
        self.observation_space = _observation_space()
        self.action_space = _action_space()

    @property
    def world(self) -> World:
        """The hidden world. For experiments, not for controllers."""
        return self.arms.worlds[0]

    def set_world(self, world: World) -> None:
        """Puts the robot into `world`; later seeds draw objects and noise only."""
        self.arms.set_world(0, world)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins a trial, see the class."""
        super().reset(seed=seed)
        if seed is None and not self._seeded:
            seed = int(self.np_random.integers(2**31))
        if seed is not None:
            self.arms.seed(0, seed)
            self._seeded = True
        struck = self.arms.begin_trial(slice(None), _placed(options, 1))
        self.arms.look()
        achieved, desired = self._goals()
        distances = reach.image_distances(achieved, desired)
        ended = reach.rendezvous(distances, self.arms.tolerance)
        return self._observation(achieved, desired), self._info(bool(ended[0]), 0.0, struck)

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Executes one motion, see the class."""
        words = _words(action, (MOTORS,))
        seconds, struck = self.arms.move(slice(None), words)
        self.arms.look()
        achieved, desired = self._goals()
        distances = reach.image_distances(achieved, desired)
        rendezvous = reach.rendezvous(distances, self.arms.tolerance)
        reward = float(self._reward(distances, rendezvous)[0])
        success = bool(rendezvous[0])
        return (
            self._observation(achieved, desired),
            reward,
            success and self._ends,
            False,
            self._info(success, float(seconds[0]), struck),
        )

    def render(self) -> NDArray[np.uint8]:
        """The scene (H, W, 3), with both camera images inset.

        Raises:
            gymnasium.error.DependencyNotInstalled: No GL is there; says which package to install.
        """
        return self._frame(0)

    def _observation(self, achieved: Any, desired: Any) -> Observation:
        return {
            "achieved_goal": achieved[0],
            "desired_goal": desired[0],
            "observation": self._flags_and_registers()[0],
        }

    def _info(self, success: bool, seconds: float, struck: list[Perturbed]) -> dict[str, Any]:
        truth = {k: v[0] if v.ndim > 1 else float(v[0]) for k, v in self._truth().items()}
        return {
            "is_success": success,
            "robot_seconds": seconds,
            "perturbed": [perturbation for _, perturbation in struck],
            "truth": truth,
        }


class StereoArmVectorEnv(_StereoArmGoal, VectorEnv[Any, Any, Any]):
    """Many stereo arms stepped together by MuJoCo's threads; row i is `StereoArmEnv` reset with seed + i.

    A finished row begins its next trial at the next step, whatever its action (`AutoresetMode.NEXT_STEP`).

    Args:
        num_envs: Rows.
        max_episode_steps: Motions after which a trial is truncated.
        threads: Threads of the simulation (0: all cores); they change no number.
        world: As for `StereoArmEnv`, or a list of one a row.
        **arguments: As for `StereoArmEnv`.
    """

    metadata = {  # noqa: RUF012
        "render_modes": list(RENDER_MODES),
        "render_fps": 2,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        *,
        num_envs: int = 1,
        max_episode_steps: int = 60,
        threads: int = 0,
        world: WorldChoice | Sequence[WorldChoice] = "wild",
        camera_mount: str = "waist",
        observation: str = "points",
        tolerance_px: float = 4.0,
        dynamics: str = "physics",
        perturbations: Any = None,
        terminate_on_success: bool = True,
        reward: str = "sparse",
        render_mode: str | None = None,
    ) -> None:
        self._build(
            num_envs,
            threads,
            reward,
            observation,
            render_mode,
            world=world,
            camera_mount=camera_mount,
            tolerance_px=tolerance_px,
            dynamics=dynamics,
            perturbations=perturbations,
        )
        self._ends = terminate_on_success
        self.num_envs = num_envs
        self._max_episode_steps = max_episode_steps
        self.single_observation_space = _observation_space()
        self.single_action_space = _action_space()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._seeded = False
        self._steps = np.zeros(num_envs, np.int64)
        self._over = np.zeros(num_envs, bool)

    @property
    def worlds(self) -> list[World]:
        """The hidden world of each row. For experiments, not for controllers."""
        return list(self.arms.worlds)

    def set_world(self, world: World, row: int | None = None) -> None:
        """Puts one row, or every row, into `world`; later seeds draw objects and noise only."""
        for r in range(self.num_envs) if row is None else [row]:
            self.arms.set_world(r, world)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins a trial in every row.

        Args:
            seed: Row i is seeded with seed + i; or one seed a row, None where a row just goes on.
            options: {"object": (x, y, z)} or one object a row (num_envs, 3), in m.
        """
        for row, row_seed in enumerate(self._row_seeds(seed)):
            if row_seed is not None:
                self.arms.seed(row, row_seed)
        self._seeded = True
        self._steps[:] = 0
        self._over[:] = False
        struck = self.arms.begin_trial(slice(None), _placed(options, self.num_envs))
        self.arms.look()
        achieved, desired = self._goals()
        distances = reach.image_distances(achieved, desired)
        success = reach.rendezvous(distances, self.arms.tolerance)
        infos = self._infos(success, np.zeros(self.num_envs), struck)
        return self._observation(achieved, desired), infos

    def step(self, actions: Any) -> tuple[Observation, Any, Any, Any, dict[str, Any]]:
        """Executes one motion in every row whose trial is not over; the others begin the next trial."""
        words = _words(actions, (self.num_envs, MOTORS))
        over, seconds = self._over, np.zeros(self.num_envs)
        struck: list[Perturbed] = []
        if over.any():
            moving, beginning = np.flatnonzero(~over), np.flatnonzero(over)
            struck += self.arms.begin_trial(beginning)
            self._steps[beginning] = -1
            if len(moving):
                seconds[moving], more = self.arms.move(moving, words[moving])
                struck += more
        else:
            seconds, struck = self.arms.move(slice(None), words)
        self.arms.look()
        self._steps += 1
        achieved, desired = self._goals()
        distances = reach.image_distances(achieved, desired)
        success = reach.rendezvous(distances, self.arms.tolerance)
        rewards = np.where(over, 0.0, self._reward(distances, success))
        terminated = success & ~over if self._ends else np.zeros(self.num_envs, bool)
        truncated = self._steps >= self._max_episode_steps
        self._over = terminated | truncated
        infos = self._infos(success, seconds, struck)
        return self._observation(achieved, desired), rewards, terminated, truncated, infos

    def render(self) -> tuple[NDArray[np.uint8], ...]:
        """One frame a row, as `StereoArmEnv.render`."""
        return tuple(self._frame(row) for row in range(self.num_envs))

    def _row_seeds(self, seed: int | Sequence[int | None] | None) -> Sequence[int | None]:
        if isinstance(seed, int | np.integer):
            return [int(seed) + row for row in range(self.num_envs)]
        if seed is None:
            drawn = int(self.np_random.integers(2**31))
            return [None if self._seeded else drawn + row for row in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise ValueError(f"seed has {len(seed)} entries; it must have {self.num_envs}, one a row")
        return seed

    def _observation(self, achieved: Any, desired: Any) -> Observation:
        return {
            "achieved_goal": achieved,
            "desired_goal": desired,
            "observation": self._flags_and_registers(),
        }

    def _infos(self, success: Any, seconds: Any, struck: list[Perturbed]) -> dict[str, Any]:
        every = np.ones(self.num_envs, bool)
        truth = self._truth()
        truth |= {"_" + key: every for key in truth}
        perturbed = np.empty(self.num_envs, object)
        for row, perturbation in struck:
            perturbed[row] = [*(perturbed[row] or ()), perturbation]
        infos = {
            "is_success": success,
            "robot_seconds": seconds,
            "perturbed": perturbed,
            "truth": truth,
        }
        return infos | {"_" + key: every for key in infos}


def _placed(options: dict[str, Any] | None, rows: int) -> NDArray[np.float64] | None:
    """The object of reset's options (rows, 3) in m, where one is given."""
    if not options:
        return None
    if unknown := sorted(options.keys() - {"object"}):
        raise ValueError(f"reset has no option {', '.join(map(repr, unknown))}; allowed: 'object'")
    position = np.asarray(options["object"], np.float64)
    if position.shape not in ((3,), (rows, 3)) or not np.isfinite(position).all():
        raise ValueError(f"options['object'] is {options['object']!r}; it must be (x, y, z) in metres")
    return np.broadcast_to(position, (rows, 3))
