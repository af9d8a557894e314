"""PPO of stable-baselines3 learns to reach in one wild world.

A policy has no memory, so it learns one world: all arms get the same. What makes it learnable is small words:
exploration begins at a standard deviation of exp(-2), where stable-baselines3's default is the whole range.
"""

import argparse

import gymnasium as gym
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.utils import LinearSchedule

from calfree_gym.sb3 import make_sb3_env


def success_rate(model: PPO, trials: int = 100, **environment: object) -> float:
    """Share of held-out trials that end at the rendezvous."""
    env = make_sb3_env("CalFree/Reach-v0", n_envs=trials, **environment)
    env.seed(1_000_000)
    successes: list[bool] = []
    evaluate_policy(
        model,
        env,
        n_eval_episodes=trials,
        callback=lambda now, _: successes.append(now["info"]["is_success"]) if now["done"] else None,
    )
    env.close()
    return sum(successes) / len(successes)


def main() -> None:
    """Learns, and prints the success rate on held-out trials before and after."""
    parser = argparse.ArgumentParser(description="PPO of stable-baselines3 in one wild world.")
    parser.add_argument("--motions", type=int, default=1_000_000)
    parser.add_argument("--tolerance-px", type=float, default=4.0)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    torch.set_num_threads(1)

    drawn = gym.make("calfree_gym:CalFree/Reach-v0", world="wild")
    drawn.reset(seed=arguments.seed)
    environment = {"world": drawn.unwrapped.world, "tolerance_px": arguments.tolerance_px}  # type: ignore[attr-defined]
    model = PPO(
        "MultiInputPolicy",
        make_sb3_env("CalFree/ReachDense-v0", n_envs=64, **environment),
        learning_rate=LinearSchedule(1e-3, 0.0, 1.0),
        n_steps=32,
        batch_size=2048,
        gamma=0.9,
        policy_kwargs={"log_std_init": -2.0, "net_arch": [128, 128]},
        seed=arguments.seed,
        device="cpu",
    )
    print(f"before: {success_rate(model, **environment):.1%} of held-out trials")
    model.learn(arguments.motions, progress_bar=False)
    print(f"after {model.num_timesteps} motions: {success_rate(model, **environment):.1%}")


if __name__ == "__main__":
    main()
