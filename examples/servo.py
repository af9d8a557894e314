"""A calibration-free visual servo in a dozen lines of numpy: test motions, least squares, Broyden's rule.

Nothing is known of cameras, arm and motors, and nothing is kept from one trial to the next. A test motion
of one motor shows one column of the sensor-control Jacobian. Broyden's rule (1965) reads it off, and corrects
the Jacobian by what every later motion shows.
"""

import argparse
from collections.abc import Generator
from itertools import count
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

TEST_WORD = 0.08
LONGEST_WORD = 0.2
LEAST_MOTION = 0.02  # shorter ones show more noise than motion

Look = dict[str, NDArray[np.float32]]
Servo = Generator[NDArray[np.float64], Look, None]


def image_distance_and_registers(look: Look) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """The gripper's sensor vector minus the object's (4,), and the executed sums of control words (3,)."""
    return look["achieved_goal"] - look["desired_goal"], look["observation"][4:]


def servo(look: Look) -> Servo:
    """Seeks the rendezvous: yields control words (3,), is sent the observation after them."""
    distance, registers = image_distance_and_registers(look)
    jacobian = np.zeros((4, 3))
    for motion in count():
        if motion < 3:
            words = TEST_WORD * np.eye(3)[motion]
        else:
            words = -np.linalg.lstsq(jacobian, distance)[0]
            words *= LONGEST_WORD / max(LONGEST_WORD, np.abs(words).max())
        distance_before, registers_before = distance, registers
        distance, registers = image_distance_and_registers((yield words))
        moved, changed = registers - registers_before, distance - distance_before
        if np.linalg.norm(moved) > LEAST_MOTION:
            jacobian += np.outer(changed - jacobian @ moved, moved) / (moved @ moved)


def reach(env: gym.Env[Any, Any], look: Look) -> list[dict[str, Any]]:
    """Lets a servo work on the trial that begins with `look`; returns the info of each of its motions."""
    running = servo(look)
    words, infos, over = next(running), [], False
    while not over:
        look, _, terminated, truncated, info = env.step(words)
        infos.append(info)
        over = terminated or truncated
        words = running.send(look)
    return infos


def main() -> None:
    """Reaches once in each of many wild worlds."""
    parser = argparse.ArgumentParser(description="A calibration-free visual servo, in wild worlds.")
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--mount", default="waist", help="where the cameras are fixed: waist or stand")
    arguments = parser.parse_args()

    env = gym.make("calfree_gym:CalFree/Reach-v0", world="wild", redraw="trial", camera_mount=arguments.mount)
    look, _ = env.reset(seed=0)
    successes, motions = [], []
    for trial in range(1, arguments.trials + 1):
        infos = reach(env, look)
        successes.append(infos[-1]["is_success"])
        motions.append(len(infos))
        outcome = "reached" if successes[-1] else "missed"
        print(f"world {trial}: {outcome} in {motions[-1]} motions")
        look, _ = env.reset()
    print(f"reached in {sum(successes)} of {len(successes)} worlds, median {np.median(motions):g} motions")


if __name__ == "__main__":
    main()
