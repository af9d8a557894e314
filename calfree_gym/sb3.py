"""The batched environment for stable-baselines3, which takes no Gymnasium vector environments."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv


def make_sb3_env(env_id: str = "CalFree/ReachDense-v0", n_envs: int = 64, **arguments: Any) -> VecEnv:
    """Makes `n_envs` arms, stepped together, as a monitored stable-baselines3 `VecEnv`.

    Control words of the full range make 4 px hard to learn. Limit them to a quarter, as
    `configs/agents/sac.yaml` does, or start with a larger `tolerance_px`.

    Args:
        env_id: One of `calfree_gym.ENV_IDS`, with or without "calfree_gym:" before it.
        n_envs: How many.
        **arguments: As for `gymnasium.make_vec`. Seed it as any `VecEnv`: row i gets seed + i.

    Raises:
        ImportError: stable-baselines3 is not installed.
    """
    try:
        from stable_baselines3.common.vec_env import VecMonitor
    except ImportError as error:
        raise ImportError(
            "make_sb3_env needs stable-baselines3: pip install 'calfree-gym[agents]'"
        ) from error
    from calfree_gym.envs.sb3_vec_env import StereoArmVecEnv

    return VecMonitor(StereoArmVecEnv(env_id.removeprefix("calfree_gym:"), n_envs, **arguments))
