"""The batched environment for stable-baselines3, which takes no Gymnasium vector environments."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv


def make_sb3_env(env_id: str = "CalFree/ReachDense-v0", n_envs: int = 64, **arguments: Any) -> VecEnv:
    """Makes `n_envs` arms, stepped together, as a stable-baselines3 `VecEnv`.

    Args:
        env_id: One of `calfree_gym.ENV_IDS`.
        n_envs: How many.
        **arguments: As for `gymnasium.make_vec`. Seed it as any `VecEnv`: row i gets seed + i.

    Raises:
        ImportError: stable-baselines3 is not installed.
    """
    from calfree_gym.sb3_vec_env import StereoArmVecEnv

    return StereoArmVecEnv(env_id, n_envs, **arguments)
