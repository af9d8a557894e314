"""PPO in a single file, in the style of CleanRL, learning to reach in one wild world.

Autoreset is Gymnasium's default, NEXT_STEP, which its vector wrappers ask for. The step after a trial's end
resets: its action does nothing, so it is no transition and is masked out of the loss. The observation that it
begins from is the trial's last one, so that a truncated trial is bootstrapped from its own end, and a
terminated one from nothing.
"""

import argparse

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.wrappers.vector import FlattenObservation
from torch import Tensor, nn
from torch.distributions import Normal

NUM_ENVS, NUM_STEPS = 64, 32
BATCH = NUM_ENVS * NUM_STEPS
EVALUATE_EVERY = 50  # iterations
UPDATE_EPOCHS = 10
LEARNING_RATE = 1e-3
GAMMA, GAE_LAMBDA = 0.9, 0.95
CLIP, VALUE_WEIGHT, MAX_GRAD_NORM = 0.2, 0.5, 0.5
LOG_STD = -2.0  # small words: a standard deviation of the whole range never learns 4 px


def layer_init(layer: nn.Linear, std: float = 2**0.5) -> nn.Linear:
    """Orthogonal weights, zero biases."""
    nn.init.orthogonal_(layer.weight, std)
    nn.init.zeros_(layer.bias)
    return layer


def network(inputs: int, outputs: int, std: float) -> nn.Sequential:
    """Two hidden layers."""
    return nn.Sequential(
        layer_init(nn.Linear(inputs, 128)),
        nn.Tanh(),
        layer_init(nn.Linear(128, 128)),
        nn.Tanh(),
        layer_init(nn.Linear(128, outputs), std),
    )


class Agent(nn.Module):
    """A Gaussian policy and a value function."""

    def __init__(self, observations: int, actions: int) -> None:
        super().__init__()
        self.critic = network(observations, 1, std=1.0)
        self.actor_mean = network(observations, actions, std=0.01)
        self.actor_logstd = nn.Parameter(torch.full((actions,), LOG_STD))

    def policy(self, obs: Tensor) -> Normal:
        """The distribution of control words (..., 3)."""
        return Normal(self.actor_mean(obs), self.actor_logstd.exp())

    def value(self, obs: Tensor) -> Tensor:
        """The value (...)."""
        return self.critic(obs).squeeze(-1)


def make_envs(seed: int) -> VectorEnv:
    """Arms in the wild world of `seed`: a distribution would give each a world of its own."""
    drawn = gym.make("calfree_gym:CalFree/Reach-v0", world="wild")
    drawn.reset(seed=seed)
    envs = gym.make_vec(
        "calfree_gym:CalFree/ReachDense-v0",
        num_envs=NUM_ENVS,
        world=drawn.unwrapped.world,  # type: ignore[attr-defined]
        autoreset_mode=AutoresetMode.NEXT_STEP,
    )
    return FlattenObservation(envs)


def success_rate(agent: Agent, envs: VectorEnv) -> float:
    """Share of one held-out trial a row that ends at the rendezvous, by the policy's mean."""
    obs, _ = envs.reset(seed=1_000_000)
    success, over = np.zeros((2, NUM_ENVS), bool)
    while not over.all():
        with torch.no_grad():
            words = agent.actor_mean(torch.as_tensor(obs)).numpy()
        obs, _, terminations, truncations, _ = envs.step(words)
        success |= terminations & ~over
        over |= terminations | truncations
    return float(success.mean())


def advantages(rewards: Tensor, values: Tensor, terminated: Tensor, over: Tensor) -> Tensor:
    """Generalized advantage estimates (steps, envs).

    Args:
        rewards: Of each step (steps, envs).
        values: Of the observations before each step, and after the last (steps + 1, envs).
        terminated: Whether a trial ended at the rendezvous (steps, envs).
        over: Whether a trial ended, there or truncated (steps, envs).
    """
    estimates = torch.zeros_like(values)
    for t in reversed(range(len(rewards))):
        delta = rewards[t] + GAMMA * values[t + 1] * (1 - terminated[t]) - values[t]
        estimates[t] = delta + GAMMA * GAE_LAMBDA * (1 - over[t]) * estimates[t + 1]
    return estimates[:-1]


def main() -> None:
    """Learns, and prints the success rate on held-out trials as it goes."""
    parser = argparse.ArgumentParser(description="PPO in a single file, in one wild world.")
    parser.add_argument("--motions", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(arguments.seed)

    envs, held_out = make_envs(arguments.seed), make_envs(arguments.seed)
    agent = Agent(envs.single_observation_space.shape[0], envs.single_action_space.shape[0])  # type: ignore[index]
    optimizer = torch.optim.Adam(agent.parameters(), eps=1e-5)
    iterations = max(1, arguments.motions // BATCH)

    obs = torch.zeros(NUM_STEPS + 1, NUM_ENVS, *envs.single_observation_space.shape)  # type: ignore[misc]
    actions = torch.zeros(NUM_STEPS, NUM_ENVS, *envs.single_action_space.shape)  # type: ignore[misc]
    rewards, terminated, over = torch.zeros(3, NUM_STEPS, NUM_ENVS)
    transitions = torch.zeros(NUM_STEPS, NUM_ENVS, dtype=torch.bool)
    next_obs, _ = envs.reset(seed=arguments.seed)
    obs[-1] = torch.as_tensor(next_obs)
    ended = np.zeros(NUM_ENVS, bool)

    for iteration in range(iterations):
        if iteration % EVALUATE_EVERY == 0:
            print(f"{iteration * BATCH} motions: {success_rate(agent, held_out):.1%} of held-out trials")
        optimizer.param_groups[0]["lr"] = LEARNING_RATE * (1 - iteration / iterations)
        obs[0] = obs[-1]
        for t in range(NUM_STEPS):
            transitions[t] = torch.as_tensor(~ended)
            with torch.no_grad():
                actions[t] = agent.policy(obs[t]).sample()
            next_obs, reward, terminations, truncations, _ = envs.step(actions[t].numpy())
            ended = terminations | truncations
            obs[t + 1] = torch.as_tensor(next_obs)
            rewards[t], terminated[t], over[t] = map(torch.as_tensor, (reward, terminations, ended))

        with torch.no_grad():
            values = agent.value(obs)
            old_logprob = agent.policy(obs[:-1]).log_prob(actions).sum(-1)
        advantage = advantages(rewards, values, terminated, over)
        returns = advantage + values[:-1]
        mean, std = advantage[transitions].mean(), advantage[transitions].std()
        normalized = ((advantage - mean) / (std + 1e-8))[transitions]

        for _ in range(UPDATE_EPOCHS):
            logprob = agent.policy(obs[:-1][transitions]).log_prob(actions[transitions]).sum(-1)
            ratio = (logprob - old_logprob[transitions]).exp()
            policy_loss = -torch.min(normalized * ratio, normalized * ratio.clamp(1 - CLIP, 1 + CLIP)).mean()
            value_loss = (agent.value(obs[:-1][transitions]) - returns[transitions]).square().mean()
            optimizer.zero_grad()
            (policy_loss + VALUE_WEIGHT * value_loss).backward()
            nn.utils.clip_grad_norm_(agent.parameters(), MAX_GRAD_NORM)
            optimizer.step()

    print(f"{iterations * BATCH} motions: {success_rate(agent, held_out):.1%} of held-out trials")
    envs.close()


if __name__ == "__main__":
    main()
