"""A robot of your own, two cameras, and no calibration: write three functions, and agents reach.

Run as it is, the simulator stands in for the robot: it goes to registers and gives pictures, no more.
"""

import argparse
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import agents  # installed: calfree_agents
from calfree_gym.image import lengths_px
from calfree_gym.vision import Marks, StereoTracker

Array = NDArray[Any]


class OwnRobot(gym.Env[dict[str, Array], Array]):
    """Reaching, as agents know it: control words in, image points and registers out.

    Args:
        motors: How many.
        go_to: Sends the motors to registers (m,), waits until the arm stands still, and tells the registers
            at which it stands: others than those asked for where it met a stop. Registers are what a motor is
            set to, in units of your own: 0 at home, within -1 to 1. Nobody needs to know what they mean.
        take_pictures: What both cameras see now: two RGB images (h, w, 3), uint8. OpenCV's are BGR: turn
            their last axis round, `frame[..., ::-1]`.
        place_object: Has the next object placed, where both cameras see it; called before each trial.
        marks: The colours of your balls, as `python -m calfree_gym.vision pick` learns them from a picture.
        tolerance_px: Image distance of the rendezvous, where the longer side of an image is 512 px.
        most_motions: A trial is cut off after so many.
    """

    def __init__(
        self,
        motors: int,
        go_to: Callable[[Array], Array],
        take_pictures: Callable[[], tuple[Array, Array]],
        place_object: Callable[[], None],
        marks: Marks | None = None,
        tolerance_px: float = 4.0,
        most_motions: int = 60,
    ) -> None:
        def numbers(size: int) -> gym.spaces.Box[Any]:
            return gym.spaces.Box(-1.0, 1.0, (size,), np.float32)

        self.action_space = numbers(motors)
        self.observation_space = gym.spaces.Dict(
            achieved_goal=numbers(4), desired_goal=numbers(4), observation=numbers(4 + motors)
        )
        self._go_to, self._take_pictures, self._place_object = go_to, take_pictures, place_object
        self._tracker = StereoTracker(marks)
        self._tolerance_px, self._most_motions = tolerance_px, most_motions
        self._registers, self._motions = np.zeros(motors), 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, Any]]:
        """Goes home, where registers are 0, and begins the next trial."""
        super().reset(seed=seed)
        self._place_object()
        self._go_to(np.zeros_like(self._registers))
        self._registers, self._motions = np.zeros_like(self._registers), 0
        self._tracker.reset()
        observation, reached = self._look()
        return observation, {"is_success": reached}

    def step(self, action: Array) -> tuple[dict[str, Array], float, bool, bool, dict[str, Any]]:
        """One motion: control words (m,) are added to the registers."""
        self._registers = self._go_to(np.clip(self._registers + np.clip(action, -1, 1), -1, 1))
        self._motions += 1
        observation, reached = self._look()
        reward = 0.0 if reached else -1.0
        return observation, reward, reached, self._motions >= self._most_motions, {"is_success": reached}

    def _look(self) -> tuple[dict[str, Array], bool]:
        """The observation, and whether gripper and object are seen at one place in both images."""
        points, seen = self._tracker(*self._take_pictures())
        observation = {
            "achieved_goal": points[:2].ravel(),  # gripper, left and right
            "desired_goal": points[2:].ravel(),  # object
            "observation": np.concatenate([seen, self._registers]),
        }
        near = lengths_px(points[:2] - points[2:]) <= self._tolerance_px
        floats = {name: values.astype(np.float32) for name, values in observation.items()}
        return floats, bool(seen.all() and near.all())


class StandIn:
    """The simulator in place of a robot and its cameras."""

    def __init__(self, seed: int) -> None:
        self._env: Any = gym.make(
            "calfree_gym:CalFree/Reach-v0",
            observation="rgb",
            image_size=512,
            camera_mount="stand",
            dynamics="kinematic",
            terminate_on_success=False,
            max_episode_steps=10**6,
            disable_env_checker=True,
        )
        self._look, _ = self._env.reset(seed=seed)

    def place_object(self) -> None:
        """Puts the next object somewhere."""
        self._look, _ = self._env.reset()

    def go_to(self, registers: Array) -> Array:
        """Goes there, by motions of one word at most, and tells where the motors stand."""
        for _ in range(2):  # from one end to the other
            words = np.clip(registers - self._look["observation"], -1, 1)
            self._look, *_ = self._env.step(words.astype(np.float32))
        return np.asarray(self._look["observation"], float)

    def take_pictures(self) -> tuple[Array, Array]:
        """Of both cameras."""
        return self._look["left_image"], self._look["right_image"]


def main() -> None:
    """Lets an agent reach for objects, learning on, and tells in how many motions."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--agent", default="memory")
    parser.add_argument("--motions", type=int, default=60, help="in all")
    parser.add_argument("--seed", type=int, default=0, help="of the world, which nobody knows")
    arguments = parser.parse_args()
    robot = StandIn(arguments.seed)
    env = OwnRobot(3, robot.go_to, robot.take_pictures, robot.place_object)
    watched = gym.wrappers.RecordEpisodeStatistics(env)
    agents.make(arguments.agent, watched).learn(arguments.motions)
    print("motions of each reach:", *watched.length_queue)


if __name__ == "__main__":
    main()
