"""How agents begin to move that were just switched on, where they can have an accident (paper, section 5)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import pandas as pd

import agents
from calfree_gym.geometry import Array
from experiments.benchmarks.arms.rendezvous import arms_of_tests
from experiments.benchmarks.trials import CAP
from experiments.reporting.tables import Table, beside
from experiments.statistics import mean_share

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

FORMATS = {
    **dict.fromkeys(("beyond 10°", "harmed", "rendezvous", "gave up"), ".1%"),
    **dict.fromkeys(("force, 99 %", "largest force"), ".0f"),
    **dict.fromkeys(("motions", "ratio"), ".2f"),
    "bound N": ".0f",
}
_READ = (
    f"gains × 0.25 to 8, a trial in each of at most {CAP} motions. Beyond 10°: a joint went farther in the "
    f"first motion. Forces (N): the largest of a trial. Motions: mean of all trials, {CAP} without a "
    "rendezvous. Brackets: 95 % intervals over worlds."
)
"""How every table is to be read."""
OTHERS = 100
"""Worlds of each arm that only `safe_start` is tried on."""


class Place(NamedTuple):
    """An arm of the benchmark.

    Attributes:
        worlds: How many.
        arguments: Of the environment.
    """

    worlds: int
    arguments: Mapping[str, Any]


COMPARED = {"so101": Place(300, {"force_bound": 20.0}), "panda": Place(200, {})}
"""Arms of `make arms` that all agents are tried on, beside the RV-M2; a small one with a smaller bound."""


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


def safe_start(
    places: Mapping[str, Place] | None = None, others: Mapping[str, Place] | None = None
) -> Iterator[Table]:
    """A table for each arm: what its first trials came to, by agent; and one of `safe_start` alone, by arm.

    Args:
        places: By the arm's name; by default the RV-M2, and two where `make arms` has fetched them.
        others: For the last table; by default the arms of the tests, and all others that are fetched.
    """
    for arm, place in (_usual() if places is None else places).items():
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
            FORMATS,
            f"Worlds {FIRST_WORLD} to {FIRST_WORLD + place.worlds - 1}, {_READ} "
            f"Harmed: a contact above {bound:g} N. Ratio: of motions to {SERVO}'s, in worlds where that was "
            "unharmed.",
        )
    rows = []
    for arm, place in (_others() if others is None else others).items():
        env = gym.make(SAFE, **place.arguments)
        trials = _trials(env, *AGENTS["safe_start"], place.worlds)
        env.close()
        arms = env.unwrapped.arms  # type: ignore[attr-defined]
        told = {"motors": len(arms.robot.motors), "worlds": place.worlds, "bound N": arms.force_bound}
        rows.append({"arm": arm, **told, **_row(trials)})
    note = (
        f"`safe_start` alone, worlds {FIRST_WORLD} and up, cameras in the room, {_READ} Harmed: a contact "
        "above the bound."
    )
    yield Table("safe_start_others", "First trials of other arms", pd.DataFrame(rows), FORMATS, note)


def _row(trials: list[FirstTrial], today: list[FirstTrial] | None = None) -> dict[str, Any]:
    """What trials came to; beside today's servo in the same worlds, where its trials are given."""
    columns = {name: np.array([getattr(each, name) for each in trials]) for name in FirstTrial._fields}
    row = {
        "beyond 10°": float((columns["first"] > AT_ONCE).mean()),
        **beside("harmed", mean_share(columns["harmed"]), ".1%"),
        "force, 99 %": float(np.quantile(columns["force"], 0.99)),
        "largest force": float(columns["force"].max()),
        **beside("rendezvous", mean_share(columns["reached"]), ".1%"),
        "gave up": float(columns["gave_up"].mean()),
        "motions": float(columns["motions"].mean()),
    }
    if today is None:
        return row
    unharmed = np.array([not each.harmed for each in today])
    of_today = np.array([each.motions for each in today])[unharmed]
    ratio = float(columns["motions"][unharmed].mean() / of_today.mean()) if len(of_today) else np.nan
    return row | {"ratio": ratio}


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
    """The arms on which agents are compared."""
    there = arms_of_tests()
    return {"movemaster": Place(500, {})} | {
        name: Place(worlds, {"arm": there[name], "camera_mount": "stand", **arguments})
        for name, (worlds, arguments) in COMPARED.items()
        if name in there
    }


def _others() -> dict[str, Place]:
    """The arms of the tests, and the fetched ones that `_usual` leaves."""
    return {
        name: Place(OTHERS, {"arm": arm, "camera_mount": "stand"})
        for name, arm in arms_of_tests().items()
        if name not in COMPARED
    }
