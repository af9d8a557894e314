"""Anybody's MuJoCo environment as agents know it: control words in, image points and registers out."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import gymnasium as gym
import mujoco
import numpy as np
from gymnasium.utils import RecordConstructorArgs, seeding
from numpy.typing import ArrayLike

from calfree_gym.errors import check_choice, check_positive, check_whole
from calfree_gym.geometry import Array, rotation_matrix
from calfree_gym.image import IMAGE_SIZE, IMAGE_UNIT, inside
from calfree_gym.perturb.actions import bounded
from calfree_gym.perturb.simulation import find_simulation
from calfree_gym.reaching import reaching_observation, reaching_spaces
from calfree_gym.streams import stream
from calfree_gym.vision.cameras import pinhole

Env = gym.Env[Any, Any]
Place = str | Callable[[Env], Array]
"""A site, by its name, or a function that gives a position (3,) in m."""


class FixedCamera(NamedTuple):
    """A camera in the room that the model has not. No perturbation moves it.

    Attributes:
        position: In m (3,).
        orientation: Unit quaternion (4,), as MuJoCo's; `calfree_gym.geometry.looking_at` gives one.
        fovy: Field of view in degrees.
    """

    position: ArrayLike
    orientation: ArrayLike
    fovy: float


@dataclass(frozen=True)
class Words:
    """How control words become actions of an environment whose actions are a box.

    Attributes:
        entries: Which number of the action each motor is.
        steps: So many steps of the environment a word of 1 takes, smaller ones fewer, at least one.
        settle: So many more steps a motion takes, in which nothing is moved.
        absolute: Whether actions are positions, of which a word of 1 is half of the range. By default they
            are displacements, and a word of 1 is `steps` of the largest ones.
        rest: The action that moves nothing; of positions, the one at home. By default the middle of the box.
    """

    entries: Sequence[int]
    steps: int = 5
    settle: int = 0
    absolute: bool = False
    rest: Sequence[float] | None = None

    def __post_init__(self) -> None:
        check_whole("steps", self.steps, 1, 10**6)
        check_whole("settle", self.settle, 0, 10**6)
        if not len(self.entries) or len({*self.entries}) < len(self.entries):
            raise ValueError(f"entries is {self.entries!r}; it must be different places in the action")

    def actions(self, box: gym.spaces.Box[Any], registers: Array, words: Array) -> Iterator[Array]:
        """The actions of one motion, by words (m,), from registers (m,) on."""
        high, low = np.asarray(box.high, float), np.asarray(box.low, float)
        rest = (low + high) / 2 if self.rest is None else np.asarray(self.rest, float)
        half = ((high - low) / 2)[list(self.entries)]
        moving = max(1, math.ceil(self.steps * np.abs(words).max()))
        for step in range(1, moving + self.settle + 1):
            action = rest.copy()
            if self.absolute:
                action[list(self.entries)] += half * (registers + words * min(1, step / moving))
            elif step <= moving:
                action[list(self.entries)] += half * words * self.steps / moving
            yield np.clip(action, low, high).astype(box.dtype)


class StereoPoints(gym.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """Reaching in an environment with two cameras, with the spaces of `CalFree/Reach-v0`.

    A step is one motion. Observed are the points of gripper and object in both images, each 512 x 512, and
    registers; reward is 0 at the rendezvous, which ends an episode, and -1 elsewhere. The environment's own
    end ends it, too. `info` is the environment's; where it does not tell `is_success`, the rendezvous does.
    Points are of the model: what `Perturb` does to observations, such as `latency`, does nothing here.

    Args:
        env: An environment behind which a MuJoCo model is found, such as one in `Perturb`. It says how long
            an episode is.
        gripper: What is moved.
        object: Where it is to go.
        cameras: Two of the model, by name, or `FixedCamera`s.
        words: How control words become actions.
        registers: Tells where motors stand (m,), within -1 to 1 and 0 at home, where the environment knows.
            By default words are summed.
        noise_px: Standard deviation of image points, drawn from the seed of `reset`.
        tolerance_px: Of the rendezvous.
        terminate_on_success: Whether the rendezvous ends an episode.

    Raises:
        ValueError: There is no such camera or site, which are named; or actions are no box of numbers.
    """

    def __init__(
        self,
        env: Env,
        gripper: Place,
        object: Place,
        cameras: Sequence[str | FixedCamera],
        words: Words,
        registers: Callable[[Env], Array] | None = None,
        noise_px: float = 0.0,
        tolerance_px: float = 4.0,
        terminate_on_success: bool = True,
    ) -> None:
        RecordConstructorArgs.__init__(
            self,
            gripper=gripper,
            object=object,
            cameras=cameras,
            words=words,
            registers=registers,
            noise_px=noise_px,
            tolerance_px=tolerance_px,
            terminate_on_success=terminate_on_success,
        )
        gym.Wrapper.__init__(self, env)
        self._places, self._cameras, self._words = (gripper, object), tuple(cameras), words
        self._tell, self._noise_px, self._tolerance_px = registers, noise_px, tolerance_px
        self._terminate = terminate_on_success
        self._check()
        self._rng, _ = seeding.np_random()
        motors = len(words.entries)
        self.observation_space, self.action_space = reaching_spaces(motors)
        self._registers, self._points = np.zeros(motors), np.zeros((2, 2, 2))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, Any]]:
        """Begins the next episode, with registers zero."""
        _, info = self.env.reset(seed=seed, options=options)
        if seed is not None:
            self._rng = stream(seed, "image points")
        self._registers[:], self._points[:] = 0, 0
        observation, reached = self._observe()
        return observation, {"is_success": reached, **info}

    def step(self, action: Array) -> tuple[dict[str, Array], float, bool, bool, dict[str, Any]]:
        """One motion: control words (m,), clipped to [-1, 1], are added to the registers.

        Raises:
            ValueError: The words are no finite numbers (m,).
        """
        words = np.asarray(action, float)
        if words.shape != self._registers.shape or not np.isfinite(words).all():
            raise ValueError(f"the action is {action!r}; it must be {len(self._registers)} finite numbers")
        asked = np.clip(self._registers + np.clip(words, -1, 1), -1, 1)
        box: Any = self.env.action_space
        for each in self._words.actions(box, self._registers.copy(), asked - self._registers):
            *_, terminated, truncated, info = self.env.step(each)
            if terminated or truncated:
                break
        self._registers[:] = asked
        observation, reached = self._observe()
        info = {"is_success": reached, **info}
        ends = bool(terminated or (reached and self._terminate))
        return observation, 0.0 if reached else -1.0, ends, bool(truncated), info

    def _observe(self) -> tuple[dict[str, Array], bool]:
        """The observation, and whether gripper and object are seen at one place in both images."""
        found, seen = self._look()
        self._points[seen] = found[seen]  # a lost point keeps its last value
        if self._tell is not None:
            self._registers[:] = np.clip(self._tell(self.env), -1, 1)
        points = self._points.reshape(4, 2)
        return reaching_observation(points, seen.ravel(), self._registers, self._tolerance_px)

    def _look(self) -> tuple[Array, Any]:
        """Image points (2, 2, 2) of gripper and object, left and right, and which (2, 2) are seen."""
        model, data = find_simulation(self.env)
        positions = [
            data.site(place).xpos if isinstance(place, str) else np.asarray(place(self.env), float)
            for place in self._places
        ]
        points, depths = np.zeros((2, 2, 2)), np.zeros((2, 2))
        for side, camera in enumerate(self._cameras):
            position, rotation, focal, centre = _camera(camera, model, data)
            flat, depths[:, side] = pinhole(np.array(positions), position, rotation)
            points[:, side] = focal * flat + centre
        points += self._noise_px * IMAGE_UNIT * self._rng.normal(size=points.shape)
        return points, (depths > 0) & inside(points)

    def _check(self) -> None:
        """See the class."""
        box: Any = self.env.action_space
        if not bounded(box):
            raise ValueError(f"actions are {box}; words need a box of finite numbers (n,)")
        if not isinstance(self._words, Words):
            raise ValueError(f"words is {self._words!r}; it must be Words")
        rest = self._words.rest
        if rest is not None and (np.shape(rest) != box.shape or not np.isfinite(rest).all()):
            raise ValueError(f"rest is {rest!r}; it must be {box.shape[0]} finite numbers")
        check_positive("tolerance_px", self._tolerance_px, IMAGE_SIZE)
        if not 0 <= self._noise_px <= IMAGE_SIZE:
            raise ValueError(f"noise_px is {self._noise_px!r}; allowed: 0 to {IMAGE_SIZE}")
        for entry in self._words.entries:
            check_whole("an entry of words", entry, 0, box.shape[0] - 1)
        if len(self._cameras) != 2:
            raise ValueError(f"cameras is {self._cameras!r}; there must be two")
        for camera in self._cameras:
            if isinstance(camera, FixedCamera):
                check_positive("fovy", camera.fovy, 180)
                if not np.isclose(np.linalg.norm(camera.orientation), 1, atol=1e-3):
                    raise ValueError(f"orientation is {camera.orientation!r}; it must be a unit quaternion")
        model, _ = find_simulation(self.env)
        for what, names, kind, count in (
            ("a site", self._places, mujoco.mjtObj.mjOBJ_SITE, model.nsite),
            ("a camera", self._cameras, mujoco.mjtObj.mjOBJ_CAMERA, model.ncam),
        ):
            known = [name for i in range(count) if (name := mujoco.mj_id2name(model, kind, i))]
            for name in names:
                if isinstance(name, str):
                    check_choice(what, name, known)


def _camera(camera: str | FixedCamera, model: Any, data: Any) -> tuple[Array, Array, Array, Array]:
    """Position (3,), axes (3, 3), focal length and principal point (2,) in image units."""
    if isinstance(camera, FixedCamera):
        rotation = rotation_matrix(np.asarray(camera.orientation, float))
        return np.asarray(camera.position, float), rotation, _focal(camera.fovy), np.zeros(2)
    number = model.camera(camera).id
    pose = data.cam_xpos[number], data.cam_xmat[number].reshape(3, 3)
    if not (size := model.cam_sensorsize[number]).any():
        return *pose, _focal(model.cam_fovy[number]), np.zeros(2)
    focal, centre = np.split(2 * model.cam_intrinsic[number] / size.max(), 2)
    return *pose, focal, -centre


def _focal(fovy: float) -> Array:
    return np.full(2, 1 / math.tan(math.radians(fovy) / 2))
