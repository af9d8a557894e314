"""The batched environment for stable-baselines3, which takes no Gymnasium vector environments."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import gymnasium as gym
from gymnasium.vector import AutoresetMode, VectorEnv

from calfree_gym.errors import to_install
from calfree_gym.wrappers import VectorScaledWords

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv


def make_sb3_env(
    env_id: str = "CalFree/ReachDense-v0",
    n_envs: int = 64,
    word_limit: float = 1.0,
    word_curvature: float = 1.0,
    seed: int | None = None,
    **arguments: Any,
) -> VecEnv:
    """Makes `n_envs` arms, stepped together, as a monitored stable-baselines3 `VecEnv`.

    Control words of the full range make 4 px hard to learn: limit them, or start with a larger
    `tolerance_px`.

    Args:
        env_id: One of `calfree_gym.ENV_IDS`, with or without "calfree_gym:" before it.
        n_envs: How many.
        word_limit: The largest word, see `calfree_gym.wrappers.ScaledWords`.
        word_curvature: Above 1, small words get finer.
        seed: Of the first reset, as `VecEnv.seed` sets it: row i gets seed + i.
        **arguments: As for `gymnasium.make_vec`.

    Raises:
        ImportError: stable-baselines3 is not installed.
        TypeError: `num_envs` or `autoreset_mode` is among the arguments, or one that is unknown.
        ValueError: The value of an argument is not allowed.
    """
    import calfree_gym

    for name in arguments.keys() & {"num_envs", "autoreset_mode"}:
        raise TypeError(
            f"make_sb3_env() got an unexpected keyword argument {name!r}; n_envs says how many, and trials "
            "begin as stable-baselines3 wants them to"
        )
    env_id = env_id.removeprefix("calfree_gym:")
    if env_id not in calfree_gym.ENV_IDS:
        raise ValueError(f"unknown env_id {env_id!r}; allowed: {', '.join(calfree_gym.ENV_IDS)}")
    settings = {"truth": False, **arguments}
    made = gym.make_vec(env_id, num_envs=n_envs, autoreset_mode=AutoresetMode.SAME_STEP, **settings)
    envs = as_sb3_env(VectorScaledWords(made, word_limit, word_curvature))
    if seed is not None:
        envs.seed(seed)
    return envs


def as_sb3_env(envs: VectorEnv[Any, Any, Any]) -> VecEnv:
    """Presents a batched environment, as a monitored stable-baselines3 `VecEnv`.

    Wrappers of actions and rewards may be around it; observations are wrapped by those of stable-baselines3.

    Args:
        envs: Made by `gymnasium.make_vec(..., autoreset_mode=AutoresetMode.SAME_STEP)`.

    Raises:
        ImportError: stable-baselines3 is not installed.
        ValueError: Its next trials do not begin at once, it is not CalFree's own, or its observations are
            wrapped.
    """
    try:
        from stable_baselines3.common.vec_env import VecMonitor
    except ImportError as error:
        raise ImportError(f"make_sb3_env needs stable-baselines3: {to_install('agents')}") from error
    from calfree_gym.engine.sb3_vec_env import StereoArmVecEnv

    return VecMonitor(StereoArmVecEnv(envs))
