"""`python -m tests.soak [--hours 4]`: what loops, for hours on two cores. Does memory grow, is anything lost?

Agents live on in worlds that change, rows of images are drawn, and a runner is killed at random until its
results are whole, which must be those of a runner that was left alone.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import NamedTuple

import gymnasium as gym
import numpy as np
import psutil
import scipy.stats

import agents

REACH = "calfree_gym:CalFree/Reach-v0"
LIVES = "memory", "unified_servo", "jacobian_servo", "grid_table", "polynomial", "self_supervised"
TRIALS = 20_000
"""Of a life, at least."""
ROWS, PIXELS = 8, 84
CORES = 2
KILLED = "tests/experiments/execution/test_killed.py::test_killed_and_started_again_it_ends_with_the_same[50]"


class Found(NamedTuple):
    """What a task came to.

    Attributes:
        done: In words.
        hours: Of a core, when its process was looked at.
        megabytes: What that held in memory then.
    """

    done: str
    hours: list[float]
    megabytes: list[float]

    @property
    def growth(self) -> str:
        """Megabytes an hour of a core in the second half, with a 95 % interval (Theil 1950, Sen 1968)."""
        half = len(self.hours) // 2
        if len(self.hours) - half < 3:
            return "–"
        slope, _, low, high = scipy.stats.theilslopes(self.megabytes[half:], self.hours[half:])
        return f"{slope:+.1f} [{low:+.1f}, {high:+.1f}]"


def repeated(
    seconds: float, some: Callable[[], object], enough: Callable[[], bool] = lambda: True
) -> list[list[float]]:
    """Does it again and again until the time is used and it is enough: hours, and megabytes after each.

    The time is what this process and those that it began have had of a core.
    """
    process = psutil.Process()
    looks: list[list[float]] = [[], []]
    while not looks[0] or looks[0][-1] * 3600 < seconds or not enough():
        some()
        looks[0].append(sum(process.cpu_times()[:4]) / 3600)
        looks[1].append(process.memory_info().rss / 2**20)
    return looks


def life(name: str, seconds: float) -> Found:
    """An agent that meets another left camera after every 200 trials."""
    knocks = [{"every": {"trial": 200}, "do": {"type": "camera_replace", "camera": "left"}}]
    env = gym.make(REACH, world="wild", dynamics="kinematic", perturbations=knocks)
    agent = agents.make(name, env, seed=0)
    env.reset(seed=0)
    lived: np.ndarray = env.unwrapped.arms.trials
    looks = repeated(seconds, lambda: agent.learn(1_000), lambda: bool(lived[0] >= TRIALS))
    return Found(f"{lived[0]:,} trials", *looks)


def images(_: str, seconds: float) -> Found:
    """Rows in images, each of whose trials is in a world of its own."""
    envs = gym.make_vec(
        REACH, ROWS, observation="pixels", image_size=PIXELS, redraw="trial", dynamics="kinematic"
    )
    envs.action_space.seed(0)
    envs.reset(seed=0)

    def some() -> None:
        for _ in range(100):
            envs.step(envs.action_space.sample())

    looks = repeated(seconds, some)
    return Found(f"{100 * ROWS * len(looks[0]):,} pairs of images", *looks)


def killed(test: str, seconds: float) -> Found:
    """A test that kills a runner fifty times."""
    pytest = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", test]
    looks = repeated(seconds, lambda: subprocess.run(pytest, check=True, stdout=subprocess.DEVNULL))
    return Found(f"{50 * len(looks[0]):,} kills, and nothing lost", *looks)


TASKS = [*((life, name) for name in LIVES), (images, f"{ROWS} rows of images"), (killed, KILLED)]


def main() -> None:
    """Shares the time among the tasks, on two cores."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak", description=__doc__)
    parser.add_argument("--hours", type=float, default=4.0, help="of a core, for all tasks together")
    seconds = parser.parse_args().hours * 3600 / len(TASKS)
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(CORES, spawn, max_tasks_per_child=1) as pool:
        running = [(name, pool.submit(task, name, seconds)) for task, name in TASKS]
        print("| what | done | hours | MB at first, at last | MB an hour, second half |")
        print("| --- | --- | --- | --- | --- |")
        for name, future in running:
            found = future.result()
            memory = f"{found.megabytes[0]:.0f}, {found.megabytes[-1]:.0f}"
            hours = f"{found.hours[-1]:.2f}"
            print(f"| {name} | {found.done} | {hours} | {memory} | {found.growth} |", flush=True)


if __name__ == "__main__":
    main()
