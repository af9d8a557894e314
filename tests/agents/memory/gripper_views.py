"""What a robot sees in a world before and after a known change, and of a smooth view of three registers."""

import gymnasium as gym
import numpy as np

from agents.base.observation import Observation
from agents.memory.pairs import Pairs
from agents.memory.remembered import Remembered
from calfree_gym.image import IMAGE_UNIT


def wild(seed):
    """The wild world of that seed."""
    env = gym.make("CalFree/Reach-v0", camera_mount="stand", dynamics="kinematic")
    env.reset(seed=seed)
    return env.unwrapped.world


def trial(world, number, places=4):
    """Pairs of one trial: at home, then at random registers where both cameras see the gripper."""
    endless = {"terminate_on_success": False, "keep_in_view": False, "max_episode_steps": 1_000}
    env = gym.make("CalFree/Reach-v0", world=world, camera_mount="stand", dynamics="kinematic", **endless)
    observation, _ = env.reset(seed=number)
    rng, looks = np.random.default_rng(number), []
    while len(looks) <= places:
        now = Observation.of(observation)
        if now.visible[:2].all():
            shown = now.visible & np.repeat([True, bool((looks or [now])[0].visible[2:].all())], 2)
            looks.append(now.estimated(now.points, shown))
        words = rng.uniform(-0.4, 0.4, 3) - now.registers
        observation, *_ = env.step((words if looks else np.zeros(3)).astype(np.float32))
    return Pairs.of_trial(looks, 0.5, number)


def known(world, trials=30, learn=None):
    """What is remembered of a world after so many trials; `learn` is given each of them first."""
    remembered = Remembered(3)
    for number in range(trials):
        pairs = trial(world, number)
        if learn is not None:
            learn(pairs, remembered)
        remembered.learn(pairs)
    return remembered


def view(registers):
    """A smooth stereo view of three registers."""
    a, b, c = np.moveaxis(np.asarray(registers), -1, 0)
    return 0.5 * np.stack(
        [np.sin(a + 0.3 * b), np.sin(b - 0.4 * c), np.sin(a - 0.3 * c) + 0.2 * b * c, np.cos(c) + b], -1
    )


def seen_at(registers, sensors, noise_px=0.5):
    """Pairs of gripper points alone."""
    count = len(registers)
    nothing = np.full((count, 4), np.nan)
    noises = np.full(count, noise_px)
    return Pairs(registers, sensors, nothing, np.zeros((count, 4)), noises, np.arange(count))


def noisy(rng, sensors, noise_px=0.5):
    """Sensor vectors (n, 4) as they are measured."""
    return sensors + rng.normal(0, noise_px * IMAGE_UNIT, np.shape(sensors))


def taught(count, seed=0, noise_px=0.5, **settings):
    """What is remembered after so many looks at `view`."""
    rng, remembered = np.random.default_rng(seed), Remembered(3, **settings)
    registers = rng.uniform(-0.7, 0.7, (count, 1, 3))
    for there, seen in zip(registers, noisy(rng, view(registers), noise_px), strict=True):
        remembered.learn(seen_at(there, seen, noise_px))
    return remembered
