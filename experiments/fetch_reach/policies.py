"""FetchReach, somebody else's environment, with two cameras of which one is turned, and policies for it.

It runs where gymnasium-robotics does: with MuJoCo below 3.11, which has no `mujoco.batch`. Policies: one that
is calibrated as built, and networks that were shown the way.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np

from calfree_gym.geometry import Array, looking_at, rotation_matrix
from calfree_gym.perturb import FixedCamera, StereoPoints, Words

CAMERA, FOVY = "external_camera_0", 60.0
"""The camera that is turned, and the field of view of both (degrees): by 20°, it still sees most goals."""
BESIDE, GRIPPER_AT_HOME = np.array([1.35, 1.75, 0.9]), np.array([1.34, 0.75, 0.53])
SIDE = FixedCamera(BESIDE, looking_at(BESIDE, GRIPPER_AT_HOME), FOVY)
"""The camera that stands still."""
WORDS = Words((0, 1, 2), steps=5, settle=4)
REACH = 0.05 * WORDS.steps
"""Metres that a word of 1 moves the gripper."""
NOISE_PX = 0.5
GRIPPER = "robot0:grip"
SUCCESS = 0.02
"""Within so many metres when the 50 steps of the environment are over."""
MIDDLE = 25
"""Steps of the environment."""


def aim(degrees: float, step: int = 0) -> list[dict[str, Any]]:
    """A schedule that turns the camera after so many steps, each time towards another side."""
    return [{"at": {"step": step}, "do": {"type": "camera_aim", "camera": CAMERA, "degrees": degrees}}]


SCHEDULES = {
    "as built": [],
    "5°": aim(5),
    "10°": aim(10),
    "20°": aim(20),
    "10° in mid-episode": aim(10, MIDDLE),
}


def fetch() -> gym.Env[Any, Any]:
    """FetchReach, with a wider lens."""
    import gymnasium_robotics

    gym.register_envs(gymnasium_robotics)
    env = gym.make("FetchReach-v4")
    env.unwrapped.model.camera(CAMERA).fovy = FOVY  # type: ignore[attr-defined]
    return env


def draw_goal(env: gym.Env[Any, Any]) -> None:
    """Puts the red ball at the goal, as FetchReach's own `render` does; physics know nothing of it."""
    made: Any = env.unwrapped
    made.data.site("target0").xpos[:] = made.goal


def points_of(env: gym.Env[Any, Any]) -> gym.Env[Any, Any]:
    """As policies see it that go by image points."""
    return StereoPoints(
        env,
        GRIPPER,
        lambda env: env.unwrapped.goal,  # type: ignore[attr-defined]
        (CAMERA, SIDE),
        WORDS,
        registers=_registers,
        noise_px=NOISE_PX,
        terminate_on_success=False,
    )


def _registers(env: gym.Env[Any, Any]) -> Array:
    """Where the gripper stands, as joints tell it, in words from home (3,); words fall short by a third."""
    made: Any = env.unwrapped
    return np.asarray((made.data.site(GRIPPER).xpos - made.initial_gripper_xpos) / REACH)


def succeeded(env: gym.Env[Any, Any], info: Mapping[str, Any]) -> bool:
    """Whether the gripper is at the goal."""
    made: Any = env.unwrapped
    return bool(np.linalg.norm(made.data.site(GRIPPER).xpos - made.goal) < SUCCESS)


class Calibrated:
    """Hand-eye calibrated as built: finds the goal by stereo; its registers tell where the gripper is."""

    def __init__(self) -> None:
        env: Any = fetch()
        env.reset(seed=0)
        built = env.unwrapped.data.camera(CAMERA)
        self._home = env.unwrapped.initial_gripper_xpos.copy()
        self._poses = (
            (built.xpos.copy(), built.xmat.reshape(3, 3).copy()),
            (np.array(SIDE.position), rotation_matrix(np.array(SIDE.orientation))),
        )
        self._half = np.tan(np.radians(FOVY) / 2)
        env.close()

    def __call__(self, observation: Mapping[str, Array]) -> Array:
        """Words (3,) that lead to the goal."""
        here = self._home + REACH * observation["observation"][4:]
        return np.asarray(np.clip((self._goal(observation["desired_goal"]) - here) / REACH, -1, 1))

    def _goal(self, points: Array) -> Array:
        """The place (3,) that is nearest to both lines of sight."""
        normal, right = np.zeros((3, 3)), np.zeros(3)
        for (position, axes), (x, y) in zip(self._poses, points.reshape(2, 2).astype(float), strict=True):
            sight = axes @ [self._half * x, -self._half * y, -1]
            across = np.eye(3) - np.outer(sight, sight) / (sight @ sight)
            normal, right = normal + across, right + across @ position
        return np.asarray(np.linalg.solve(normal, right), float)


DEMONSTRATED = 150
"""Episodes."""
FIRST_DEMONSTRATION = 10_000
"""Seed of the first one; those of the episodes that count are below."""
EXPLORED = 0.3
"""Standard deviation of what leads demonstrations astray, so that ways back are shown, too (choice)."""


def demonstrations(env: gym.Env[Any, Any], seed: int) -> tuple[list[Any], Array]:
    """What is observed (n), and the words (n, 3) that lead to the goal from there."""
    rng = np.random.default_rng(seed)
    observed, shown = [], []
    for episode in range(DEMONSTRATED):
        observation, _ = env.reset(seed=FIRST_DEMONSTRATION + episode)
        over = False
        while not over:
            made: Any = env.unwrapped
            words = (made.goal - made.data.site(GRIPPER).xpos) / REACH
            observed.append(observation)
            shown.append(words)
            observation, _, terminated, truncated, _ = env.step(words + rng.normal(0, EXPLORED, 3))
            over = terminated or truncated
    env.close()
    return observed, np.array(shown)


class Cloned:
    """A network that was shown which way to go from what both images and the registers tell, as built."""

    UNITS, EPOCHS = 64, 2000
    """Choice: the training error no longer falls."""

    def __init__(self, seed: int = 1) -> None:
        import torch

        observations, shown = demonstrations(points_of(fetch()), seed)
        seen = np.array([_flat(each) for each in observations])
        torch.manual_seed(seed)
        units = self.UNITS
        self._net = torch.nn.Sequential(
            *(torch.nn.Linear(seen.shape[1], units), torch.nn.Tanh()),
            *(torch.nn.Linear(units, units), torch.nn.Tanh(), torch.nn.Linear(units, 3)),
        )
        inputs, targets = (torch.as_tensor(each, dtype=torch.float32) for each in (seen, shown))
        optimizer = torch.optim.Adam(self._net.parameters(), lr=3e-3)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, self.EPOCHS)
        for _ in range(self.EPOCHS):
            optimizer.zero_grad()
            torch.nn.functional.mse_loss(self._net(inputs), targets).backward()
            optimizer.step()
            schedule.step()

    def __call__(self, observation: Mapping[str, Array]) -> Array:
        """Words (3,) as they would have been shown."""
        import torch

        with torch.no_grad():
            words = self._net(torch.as_tensor(_flat(observation), dtype=torch.float32))
        return np.clip(words.numpy(), -1, 1)


def _flat(observation: Mapping[str, Array]) -> Array:
    return np.concatenate([observation[key] for key in ("achieved_goal", "desired_goal", "observation")])


SIZE = 64
"""Pixels along a side of an image."""
CELLS = SIZE // 2
"""Along a side of the map that a network makes of an image."""


class FetchImages(gym.ObservationWrapper[Any, Any, Any]):
    """What both cameras show (64, 64, 6), the goal as a red ball of 2 cm, and registers (3,)."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self._model: Any = env.unwrapped.model  # type: ignore[attr-defined]
        self._renderer = mujoco.Renderer(self._model, SIZE, SIZE)
        self._cameras = CAMERA, self._beside()

    def observation(self, observation: Mapping[str, Array]) -> dict[str, Array]:
        """Images and registers, and the goal's image points (4,), which only teachers may tell."""
        draw_goal(self.env)
        made: Any = self.env.unwrapped
        images = []
        for camera in self._cameras:
            self._renderer.update_scene(made.data, camera)
            images.append(self._renderer.render())
        return {
            "images": np.concatenate(images, -1),
            "registers": observation["observation"][4:],
            "goal": observation["desired_goal"],
        }

    def close(self) -> None:
        """Closes the renderer, too."""
        self._renderer.close()
        super().close()

    def _beside(self) -> Any:
        """The camera that stands still, for MuJoCo's renderer."""
        self._model.vis.global_.fovy = FOVY
        camera = mujoco.MjvCamera()
        camera.type = mujoco.mjtCamera.mjCAMERA_FREE
        x, y, z = GRIPPER_AT_HOME - BESIDE
        camera.lookat[:], camera.distance = GRIPPER_AT_HOME, np.linalg.norm([x, y, z])
        camera.azimuth, camera.elevation = np.degrees([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))])
        return camera


def images_of(env: gym.Env[Any, Any]) -> gym.Env[Any, Any]:
    """As policies see it that go by images."""
    return FetchImages(points_of(env))


class ClonedFromImages:
    """A convolutional network that was shown the way in both images and by the registers, as built.

    Each camera has layers of its own, which end in a map of the image. Its mean place (spatial softmax,
    Levine et al. 2016) and the registers tell the words. That the map is to be brightest where the goal is,
    it was shown, too: the words alone do not teach so small a network to find a ball of a pixel.
    """

    CHANNELS, UNITS, EPOCHS, BATCH, RATE, SHARE = 8, 64, 40, 16, 6e-3, 0.1
    """Choice; the last one is how much the maps count beside the words."""

    def __init__(self, seed: int = 1) -> None:
        import torch

        observed, shown = demonstrations(images_of(fetch()), seed)
        torch.manual_seed(seed)
        channels, units = 2 * self.CHANNELS, self.UNITS
        self._maps = torch.nn.Sequential(
            *(torch.nn.Conv2d(6, channels, 5, stride=2, padding=2, groups=2), torch.nn.ReLU()),
            *(torch.nn.Conv2d(channels, channels, 3, padding=1, groups=2), torch.nn.ReLU()),
            torch.nn.Conv2d(channels, 2, 3, padding=1, groups=2),
        )
        self._head = torch.nn.Sequential(
            *(torch.nn.Linear(2 * 2 + 3, units), torch.nn.Tanh(), torch.nn.Linear(units, 3))
        )
        images, registers, goals = (
            torch.as_tensor(np.stack([each[key] for each in observed]))
            for key in ("images", "registers", "goal")
        )
        spread, words = shares_around(goals), torch.as_tensor(shown, dtype=torch.float32)
        optimizer = torch.optim.Adam([*self._maps.parameters(), *self._head.parameters()])
        batches = self.EPOCHS * len(words) // self.BATCH
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, self.RATE, batches)
        for _ in range(batches):
            some = torch.randint(len(words), (self.BATCH,))
            told, maps = self._tell(images[some], registers[some])
            of_maps = -(spread[some] * maps).sum(-1).mean()
            optimizer.zero_grad()
            (torch.nn.functional.mse_loss(told, words[some]) + self.SHARE * of_maps).backward()
            optimizer.step()
            schedule.step()

    def __call__(self, observation: Mapping[str, Array]) -> Array:
        """Words (3,) as they would have been shown."""
        import torch

        images, registers = (torch.as_tensor(observation[key])[None] for key in ("images", "registers"))
        with torch.no_grad():
            words, _ = self._tell(images, registers)
        return np.clip(words[0].numpy(), -1, 1)

    def _tell(self, images: Any, registers: Any) -> tuple[Any, Any]:
        """Words (n, 3), and the logarithm of the share that each cell has of its map (n, 2, CELLS²).

        By images (n, 64, 64, 6) and registers (n, 3).
        """
        import torch

        maps = self._maps(images.permute(0, 3, 1, 2) / 255 - 0.5).flatten(2).log_softmax(-1)
        shares = maps.exp().unflatten(-1, (CELLS, CELLS))
        places = [shares.sum(2) @ _middles(), shares.sum(3) @ _middles()]
        return self._head(torch.cat([*places, registers], 1)), maps


def _middles() -> Any:
    """Of the cells along a side, in image units."""
    import torch

    return (torch.arange(CELLS) + 0.5) * 2 / CELLS - 1


def shares_around(points: Any) -> Any:
    """Shares of cells whose mean place is a point: of the four around it. From (n, 4) to (n, 2, CELLS²)."""
    near = (1 - (points.unflatten(1, (2, 2, 1)) - _middles()).abs() * CELLS / 2).clamp(min=0)
    columns, rows = near.unbind(2)
    return (rows[..., None] * columns[..., None, :]).flatten(2)
