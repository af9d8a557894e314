"""What tests of the learners of stable-baselines3 share."""

import gymnasium as gym
import torch
from gymnasium.vector import AutoresetMode

import agents
from tests.agents.neural.quick import QUICK


def make(name="sac", env=None, **settings):
    env = env or gym.make("CalFree/ReachDense-v0", dynamics="kinematic", camera_mount="stand")
    return agents.make(name, env, **{**QUICK[name], **settings})


def rows_of_one_world(rows=4):
    """As many rows of the nominal world; a single environment for one."""
    if rows == 1:
        return None
    same_step = AutoresetMode.SAME_STEP
    nominal = {"dynamics": "kinematic", "world": "nominal"}
    return gym.make_vec("CalFree/ReachDense-v0", num_envs=rows, autoreset_mode=same_step, **nominal)


def weights(agent):
    return torch.cat([parameter.detach().flatten() for parameter in agent._model.policy.parameters()])
