"""SAC of stable-baselines3 with hindsight learns to reach in one wild world, from the sparse reward.

Hindsight (Andrychowicz et al. 2017) takes where the gripper came to for where it was to go. That is valid
where the object stands still in the images: on the stand mount. SAC explores all that its actions allow, so
they are made small words: a quarter of the range.
"""

import argparse
from typing import Any

import gymnasium as gym
import torch
from stable_baselines3 import SAC, HerReplayBuffer
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor

from calfree_gym.wrappers import ScaledWords

LONGEST_WORD = 0.25


def make_env(**arguments: Any) -> gym.Env[Any, Any]:
    """One arm on the stand mount, of small words."""
    env = gym.make("calfree_gym:CalFree/Reach-v0", camera_mount="stand", **arguments)
    return Monitor(ScaledWords(env, limit=LONGEST_WORD))


def success_rate(model: SAC, trials: int = 50, **arguments: Any) -> float:
    """Share of held-out trials that end at the rendezvous."""
    env = make_env(**arguments)
    env.reset(seed=1_000_000)
    successes: list[bool] = []
    evaluate_policy(
        model,
        env,
        n_eval_episodes=trials,
        callback=lambda now, _: successes.append(now["info"]["is_success"]) if now["done"] else None,
    )
    return sum(successes) / len(successes)


def main() -> None:
    """Learns with a tolerance of 8 px, and prints the success rate at another one before and after."""
    parser = argparse.ArgumentParser(description="SAC with hindsight in one wild world.")
    parser.add_argument("--motions", type=int, default=20_000)
    parser.add_argument("--tolerance-px", type=float, default=4.0)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    torch.set_num_threads(1)

    drawn = make_env(world="wild")
    drawn.reset(seed=arguments.seed)
    world = drawn.unwrapped.world  # type: ignore[attr-defined]
    model = SAC(
        "MultiInputPolicy",
        make_env(world=world, tolerance_px=8),
        replay_buffer_class=HerReplayBuffer,
        learning_rate=1e-3,
        gamma=0.9,
        learning_starts=1000,
        policy_kwargs={"net_arch": [128, 128]},
        seed=arguments.seed,
        device="cpu",
    )
    for motions in (0, arguments.motions):
        model.learn(motions)
        rate = success_rate(model, world=world, tolerance_px=arguments.tolerance_px)
        print(f"after {motions} motions: {rate:.0%} of held-out trials at {arguments.tolerance_px:g} px")


if __name__ == "__main__":
    main()
