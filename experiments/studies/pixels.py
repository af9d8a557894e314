"""What networks learn that see nothing but pixels: two images, and the registers."""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import partial
from itertools import chain
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import pandas as pd

from calfree_gym.sb3 import make_sb3_env
from calfree_gym.wrappers import ScaledWords
from experiments.evaluation import evaluate
from experiments.reporting.tables import Table
from experiments.studies.common import CAP, DENSE, side_by_side

WORLD: dict[str, Any] = {
    "world": "nominal",
    "camera_mount": "stand",
    "dynamics": "kinematic",
    "observation": "pixels",
    "image_size": 84,
    "tolerance_px": 16.0,
}
"""What all learn in. Of images of 84 pixels, the tolerance of 16 px of 512 is 2.6."""
ARMS, WORD_LIMIT = 16, 0.3
HELD_OUT = 10_000
"""Seeds the trials that are held out."""


class Algorithm(NamedTuple):
    """An algorithm of stable-baselines3: motions of all arms together, and settings."""

    motions: int
    settings: dict[str, Any]


LEARNERS = {
    "PPO": Algorithm(
        150_000,
        {
            "n_steps": 32,
            "batch_size": 256,
            "n_epochs": 4,
            "gamma": 0.33,
            "target_kl": 0.03,
            "policy_kwargs": {"log_std_init": -1.5},
        },
    ),
    "SAC": Algorithm(
        16_000,
        {
            "learning_starts": 500,
            "buffer_size": 16_000,
            "batch_size": 256,
            "gamma": 0.5,
            "learning_rate": 0.0005,
            "gradient_steps": 16,  # one for each motion; half as many of 128 learned next to nothing
            "ent_coef": "auto_0.01",
        },
    ),
}


def tables(share: float = 1.0, looks: int = 5, trials: int = 100) -> Iterator[Table]:
    """PPO and SAC, one run each over a share of their motions, side by side, looked at now and then."""
    learned = partial(_learned, share=share, looks=looks, trials=trials)
    with side_by_side(len(LEARNERS)) as each:
        frame = pd.DataFrame(chain.from_iterable(each(learned, LEARNERS.items())))
    yield Table(
        "pixels",
        "Networks that see pixels",
        frame,
        {"motions": ",.0f", **dict.fromkeys(("rendezvous", "true error ≤ 4 px"), ".0%")}
        | dict.fromkeys(("motions per reach", "CPU minutes"), ".1f"),
        f"The nominal world, cameras in the room, 84 x 84 pixels, tolerance 16 px of 512, {ARMS} arms, words "
        f"within {WORD_LIMIT}; one run each, {trials} held-out trials in the same world, so no interval over "
        f"worlds. A trial without a rendezvous counts as {CAP} motions. Networks ran on: {_device()}.",
    )


def _device() -> str:
    import torch

    return torch.cuda.get_device_name() if torch.cuda.is_available() else "one core"


def _learned(which: tuple[str, Algorithm], share: float, looks: int, trials: int) -> list[dict[str, Any]]:
    """A row of each look."""
    import stable_baselines3
    import torch

    name, learner = which
    torch.set_num_threads(1)
    envs = make_sb3_env(DENSE, ARMS, WORD_LIMIT, seed=0, **WORLD)
    held_out = ScaledWords(gym.make(DENSE, **WORLD), WORD_LIMIT)
    model = getattr(stable_baselines3, name)("MultiInputPolicy", envs, seed=0, **learner.settings)
    seconds, rows = 0.0, []
    for _ in range(looks):
        since = time.process_time()
        model.learn(round(share * learner.motions / looks), reset_num_timesteps=False)
        seconds += time.process_time() - since
        records = evaluate(model, held_out, trials, HELD_OUT)
        rows.append(
            {
                "learner": name,
                "motions": model.num_timesteps,
                "rendezvous": np.mean([record.rendezvous for record in records]),
                "motions per reach": np.mean([record.motions_per_reach(CAP) for record in records]),
                "true error ≤ 4 px": np.mean([record.error_px <= 4 for record in records]),
                "CPU minutes": seconds / 60,
            }
        )
    envs.close()
    held_out.close()
    return rows
