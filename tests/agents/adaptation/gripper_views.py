"""What a robot sees of its gripper in a world before and after a known change."""

import gymnasium as gym
import numpy as np

from agents.adaptation.knowledge_with_views import KnowledgeWithViews
from agents.adaptation.pairs import Pairs
from agents.knowledge.gaussian_process import GaussianProcess


def wild(seed):
    """The wild world of that seed."""
    env = gym.make("CalFree/Reach-v0", camera_mount="stand", dynamics="kinematic")
    env.reset(seed=seed)
    return env.unwrapped.world


def trial(world, number, places=4, reach=0.4):
    """Pairs of one trial on the stand mount: at home, then at random registers where both cameras see it."""
    env = gym.make(
        "CalFree/Reach-v0",
        world=world,
        camera_mount="stand",
        dynamics="kinematic",
        terminate_on_success=False,
        keep_in_view=False,
        max_episode_steps=1_000,
    )
    observation, _ = env.reset(seed=number)
    rng, registers, sensors = np.random.default_rng(number), [], []
    while len(sensors) <= places:
        visible, now = observation["observation"][:2], observation["observation"][4:]
        if visible.all():
            registers.append(now)
            sensors.append(observation["achieved_goal"])
        observation, *_ = env.step((rng.uniform(-reach, reach, 3) - now).astype(np.float32))
    return Pairs(np.array(registers, float), np.array(sensors, float), np.full(len(sensors), number))


def known(world, trials=30, learn=None):
    """What a Gaussian process knows of a world after so many trials; `learn` is given each of them first."""
    knowledge = KnowledgeWithViews(GaussianProcess(3), 3)
    for number in range(trials):
        pairs = trial(world, number)
        if learn is not None:
            learn(pairs, knowledge)
        knowledge.learn(pairs)
    return knowledge
