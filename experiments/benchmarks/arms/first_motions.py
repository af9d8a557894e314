"""How agents begin to move that were just switched on, where they can have an accident (paper, section 5)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import pandas as pd

import agents
from calfree_gym.geometry import Array
from experiments.benchmarks.trials import CAP
from experiments.reporting.tables import Table

SAFE = "CalFree/SafeReach-v0"
FIRST_WORLD = 40_000
"""The agent was tuned on worlds below 5000."""
AT_ONCE = np.radians(10.0)
"""No joint is to go farther in the first motion that is one (rad)."""
SERVO = "unified_servo"
"""Today's servo."""
AGENTS: dict[str, tuple[str, dict[str, Any]]] = {
    "safe_start": ("safe_start", {}),
    "safe_start over jacobian_servo": ("safe_start", {"servo": "jacobian_servo"}),
    SERVO: (SERVO, {}),
    "random": ("random", {}),
}


class Place(NamedTuple):
    """An arm of the benchmark.

    Attributes:
        worlds: How many.
        arguments: Of the environment.
    """

    worlds: int
    arguments: Mapping[str, Any]


class FirstTrial(NamedTuple):
    """What an agent's first trial came to.

    Attributes:
        first: How far the joint went that went farthest in the first motion that is one (rad).
        force: Largest contact force of the trial (N).
        harmed: Whether it was above the bound.
        reached: Whether there was a rendezvous.
        motions: Until then; `CAP` without.
        gave_up: Whether the agent said that nothing could be done.
    """

    first: float
    force: float
    harmed: bool
    reached: bool
    motions: int
    gave_up: bool


def safe_start(places: Mapping[str, Place] | None = None) -> Iterator[Table]:
    """A table for each arm: what its first trials came to, by agent.

    Args:
        places: By the arm's name; by default the RV-M2, and two where `make arms` has fetched them.
    """
    for arm, place in (places or _usual()).items():
        env = gym.make(SAFE, **place.arguments)
        found = {name: _trials(env, *AGENTS[name], place.worlds) for name in AGENTS}
        env.close()
        today = found[SERVO]
        rows = [{"agent": name, **_row(trials, today)} for name, trials in found.items()]
        bound = env.unwrapped.arms.force_bound  # type: ignore[attr-defined]
        yield Table(
            f"safe_start_{arm}",
            f"First trials of {arm}, {place.worlds} worlds",
            pd.DataFrame(rows),
            {
                **dict.fromkeys(("beyond 10°", "harmed", "rendezvous", "gave up"), ".1%"),
                **dict.fromkeys(("force, 99 %", "largest force"), ".0f"),
                **dict.fromkeys(("motions", "ratio"), ".2f"),
            },
            f"Worlds {FIRST_WORLD} to {FIRST_WORLD + place.worlds - 1}, gains × 0.25 to 8, a trial in each "
            f"of at most {CAP} motions. Beyond 10°: a joint went farther in the first motion. "
            f"Harmed: a contact above {bound:g} N. Forces (N): the largest of a trial. Motions: mean of all "
            f"trials, {CAP} without a rendezvous. Ratio: of motions to {SERVO}'s, in worlds where that was "
            "unharmed.",
        )


def _row(trials: list[FirstTrial], today: list[FirstTrial]) -> dict[str, Any]:
    columns = {name: np.array([getattr(each, name) for each in trials]) for name in FirstTrial._fields}
    unharmed = np.array([not each.harmed for each in today])
    of_today = np.array([each.motions for each in today])[unharmed]
    return {
        "beyond 10°": float((columns["first"] > AT_ONCE).mean()),
        "harmed": float(columns["harmed"].mean()),
        "force, 99 %": float(np.quantile(columns["force"], 0.99)),
        "largest force": float(columns["force"].max()),
        "rendezvous": float(columns["reached"].mean()),
        "gave up": float(columns["gave_up"].mean()),
        "motions": float(columns["motions"].mean()),
        "ratio": float(columns["motions"][unharmed].mean() / of_today.mean()) if len(of_today) else np.nan,
    }


def _trials(env: gym.Env[Any, Any], name: str, settings: dict[str, Any], worlds: int) -> list[FirstTrial]:
    return [
        first_trial(agents.make(name, env, seed=seed, **settings), env, seed)
        for seed in range(FIRST_WORLD, FIRST_WORLD + worlds)
    ]


def first_trial(agent: Any, env: gym.Env[Any, Any], seed: int) -> FirstTrial:
    """One trial of an agent that knows nothing, in the world of `seed`."""
    observation, _ = env.reset(seed=seed)
    state, first, force, motions, over = None, 0.0, 0.0, 0, False
    while not over:
        words, state = agent.predict(observation, state)
        observation, _, terminated, truncated, info = env.step(words)
        first = first or (float(info["joint_travel"]) if moves(words) else 0.0)
        force, motions = max(force, float(info["peak_force"])), motions + 1
        over = terminated or truncated
    gave_up = bool(any(agent.gave_up(state))) if hasattr(agent, "gave_up") else False
    reached = bool(info["is_success"]) and not info["harmed"]
    return FirstTrial(first, force, bool(info["harmed"]), reached, motions if reached else CAP, gave_up)


def moves(words: Array) -> bool:
    """Whether these words (m,) are more than a look."""
    return bool(np.any(words))


def _usual() -> dict[str, Place]:
    """Arms of which two stand in `build/arms` alone; of small force, where the arm is small."""
    from tests.arms.fetched import fetched_arms

    others = {"so101": Place(300, {"force_bound": 20.0}), "panda": Place(200, {})}
    there = {name: arm for name, arm in fetched_arms().items() if name in others}
    return {"movemaster": Place(500, {})} | {
        name: Place(others[name].worlds, {"arm": arm, "camera_mount": "stand", **others[name].arguments})
        for name, arm in there.items()
    }
