"""FetchReach, somebody else's environment, whose camera is turned: what that costs five policies.

It runs where gymnasium-robotics does: with MuJoCo below 3.11, which has no `mujoco.batch`. Images need
OpenGL.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import agents
from calfree_gym.perturb import paired
from experiments.fetch_reach.policies import (
    CAMERA,
    DEMONSTRATED,
    FOVY,
    MIDDLE,
    NOISE_PX,
    SCHEDULES,
    SIZE,
    SUCCESS,
    Calibrated,
    Cloned,
    ClonedFromImages,
    fetch,
    images_of,
    points_of,
    succeeded,
)
from experiments.reporting.tables import Table

EPISODES = 100


class Policy(NamedTuple):
    """One that is tried: made with what it knows beforehand, in an environment that shows it what it sees.

    One that learns in the episodes that count is made by what `make` makes.
    """

    make: Callable[[], Any]
    learns: bool = False
    sees: Callable[[gym.Env[Any, Any]], gym.Env[Any, Any]] = points_of


def _lives(name: str) -> Callable[[gym.Env[Any, Any]], Any]:
    return lambda env: agents.make(name, env)


SERVO, MEMORY = "unified_servo", "memory"
PIXELS = "cloned, pixels"
POLICIES = {
    "calibrated": Policy(Calibrated),
    "cloned": Policy(Cloned),
    PIXELS: Policy(ClonedFromImages, sees=images_of),
    SERVO: Policy(lambda: _lives(SERVO), learns=True),
    MEMORY: Policy(lambda: _lives(MEMORY), learns=True),
}


def tables(episodes: int = EPISODES, policies: Sequence[str] = tuple(POLICIES)) -> Iterator[Table]:
    """Success of each policy under each change; and what each change cost it."""
    found = {}
    for name in policies:
        policy = POLICIES[name]
        found[name] = paired(
            fetch,
            policy.make(),
            SCHEDULES,
            episodes=episodes,
            learns=policy.learns,
            success=succeeded,
            wrap=policy.sees,
            images={CAMERA: None},
            per="episode",
        ).rows
    shares = [[name, *(rows[i].success for rows in found.values())] for i, name in enumerate(SCHEDULES)]
    yield Table(
        "knocked",
        "FetchReach, one of two cameras turned: success",
        pd.DataFrame(shares, columns=["camera turned by", *found]),
        dict.fromkeys(found, ".0%"),
        f"Success: within {100 * SUCCESS:g} cm when {2 * MIDDLE} steps are over. {episodes} episodes, the "
        f"same for all; in each the camera turns another way, in mid-episode after {MIDDLE} steps. "
        f"Two cameras of {FOVY:g}°, noise {NOISE_PX:g} px of 512. Cloned: from {DEMONSTRATED} episodes; "
        f"pixels: of two images of {SIZE} x {SIZE}. "
        f"`{SERVO}` and `{MEMORY}` begin knowing nothing, and live through all episodes of a row.",
    )
    rows = [
        {
            "policy": name,
            "camera turned by": row.schedule,
            "won, lost": f"{row.won}, {row.lost}",
            "p": row.p,
            "difference": f"{row.difference:+.0%} [{row.low:+.0%}, {row.high:+.0%}]",
        }
        for name, rows in found.items()
        for row in rows[1:]
    ]
    yield Table(
        "knocked_pairs",
        "What each change cost, episode by episode",
        pd.DataFrame(rows),
        {"p": ".2g"},
        "Against the same policy in the same episodes as built. p: McNemar's exact test. Brackets: Tango's "
        "95 % score interval, corrected for continuity.",
    )


def figure(tables: Sequence[Table]) -> Figure:
    """Success of each policy under each change."""
    shares = next(table for table in tables if table.name == "knocked").frame
    drawn = Figure(figsize=(7.0, 3.2), layout="constrained")
    axes = drawn.subplots()
    policies = list(shares.columns[1:])
    step = 0.8 / len(policies)
    for place, name in enumerate(policies):
        at = np.arange(len(shares)) + (place - (len(policies) - 1) / 2) * step
        axes.bar(at, 100 * shares[name].astype(float), 0.9 * step, label=name)
    axes.set_xticks(range(len(shares)), shares.iloc[:, 0])
    axes.set_ylim(0, 100)
    axes.set_ylabel("success (%)")
    axes.legend(ncols=len(policies), loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
    return drawn
