"""How long a pair of images takes, against the first wave's renderer in the same run."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial

import gymnasium as gym
import numpy as np
import pandas as pd

from calfree_gym.image import IMAGE_SIZE
from calfree_gym.rendering.stereo_images import StereoImages
from experiments.benchmarks.speed.first_renderer import FirstRenderer
from experiments.reporting.tables import Table

ROUNDS = 15
WARM_UP = 2
PAIRS = (("stereo pair, with shadow", 512, True, 8.0), ("stereo pair, without shadow", 84, False, 12.0))
LOOK = "a look of vision: pair, sensors, tracker"
LOOK_REQUIRED = 7.0


def pictures() -> Iterator[Table]:
    """CPU milliseconds of both, in turns, in a wild world of the RV-M2 (kinematic, waist mount)."""
    env = gym.make(
        "calfree_gym:CalFree/Reach-v0",
        dynamics="kinematic",
        observation="vision",
        terminate_on_success=False,
        disable_env_checker=True,
    )
    env.reset(seed=0)
    arms = env.unwrapped.arms  # type: ignore[attr-defined]
    world = arms.world(0)
    rng = np.random.default_rng(0)
    rows = []
    for name, size, shadows, required in PAIRS:
        ours = StereoImages(arms.simulation, arms.robot.rig, size, shadows)
        first = FirstRenderer(arms.simulation.show(0, arms.simulation.picture()), size)
        then = partial(first.pair, world)
        rows.append((name, size, *_in_turns(partial(ours.colours, 0, world), then), required))
        if size == IMAGE_SIZE:
            look = _in_turns(lambda: env.step(rng.uniform(-0.1, 0.1, 3)), then)
            rows.append((LOOK, size, *look, LOOK_REQUIRED))
        ours.close()
        first.close()
    env.close()
    columns = ["what", "pixels", "ms", "ms then", "required"]
    frame = pd.DataFrame(rows, columns=columns)
    frame.insert(4, "ratio", frame["ms then"] / frame["ms"])
    formats = {"ms": ".1f", "ms then": ".0f", "ratio": ".1f", "required": ".0f"}
    note = (
        f"Medians of {ROUNDS} rounds in turns, CPU time of one process. Then: the first wave's renderer, "
        "frozen (experiments.benchmarks.speed.first_renderer.py); without shadow, it had its own all the same"
    )
    yield Table("pictures", "Pictures", frame, formats, note)


def _in_turns(*functions: Callable[[], object]) -> list[float]:
    """Median CPU milliseconds of each."""
    spent = np.zeros((ROUNDS, len(functions)))
    for turn in range(-WARM_UP, ROUNDS):
        for i, function in enumerate(functions):
            since = time.process_time()
            function()
            if turn >= 0:
                spent[turn, i] = 1000 * (time.process_time() - since)
    return [float(each) for each in np.median(spent, axis=0)]
