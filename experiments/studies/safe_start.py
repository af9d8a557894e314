"""How agents begin to move that were just switched on, where they can have an accident (paper, section 5)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import pandas as pd

from experiments.reporting.tables import Table, beside
from experiments.statistics import mean_share
from experiments.studies.common import CAP, FirstTrial, arms_of_tests, first_trials

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
    """Where agents begin: so many worlds, and the arguments of the environment."""

    worlds: int
    arguments: Mapping[str, Any]


COMPARED = {"so101": Place(300, {"force_bound": 20.0}), "panda": Place(200, {})}
"""Arms of `make arms` that all agents are tried on, beside the RV-M2; a small one with a smaller bound."""


def tables(
    places: Mapping[str, Place] | None = None, others: Mapping[str, Place] | None = None
) -> Iterator[Table]:
    """A table for each arm: what its first trials came to, by agent; and one of `safe_start` alone, by arm.

    By default those are the RV-M2, and two where `make arms` has fetched them; these all others.
    """
    for arm, place in (_usual() if places is None else places).items():
        env = gym.make(SAFE, **place.arguments)
        found = {name: _of_trials(_trials(env, *AGENTS[name], place.worlds)) for name in AGENTS}
        rows = [{"agent": name, **_row(trials, found[SERVO])} for name, trials in found.items()]
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
        arms = env.unwrapped.arms  # type: ignore[attr-defined]
        told = {"motors": len(arms.robot.motors), "worlds": place.worlds, "bound N": arms.force_bound}
        trials = _of_trials(_trials(env, *AGENTS["safe_start"], place.worlds))
        rows.append({"arm": arm, **told, **_row(trials)})
    note = (
        f"`safe_start` alone, worlds {FIRST_WORLD} and up, cameras in the room, {_READ} Harmed: a contact "
        "above the bound."
    )
    yield Table("safe_start_others", "First trials of other arms", pd.DataFrame(rows), FORMATS, note)


def _trials(env: gym.Env[Any, Any], name: str, settings: dict[str, Any], worlds: int) -> list[FirstTrial]:
    return first_trials(name, env, range(FIRST_WORLD, FIRST_WORLD + worlds), **settings)


def _of_trials(trials: list[FirstTrial]) -> pd.DataFrame:
    """One row a trial: how far the first motion went (rad), the largest force (N), and how it ended."""
    rows = []
    for trial in trials:
        travels = [float(info["joint_travel"]) for info in trial.infos]
        moved = [travel for travel, words in zip(travels, trial.words, strict=True) if travel and words.any()]
        harmed = bool(trial.infos[-1]["harmed"])
        reached = trial.told and not harmed
        rows.append(
            {
                "first": moved[0] if moved else 0.0,  # words of zero are a look
                "force": max(float(info["peak_force"]) for info in trial.infos),
                "harmed": harmed,
                "reached": reached,
                "motions": trial.motions if reached else CAP,
                "gave up": trial.gave_up,
            }
        )
    return pd.DataFrame(rows)


def _row(trials: pd.DataFrame, today: pd.DataFrame | None = None) -> dict[str, Any]:
    """What trials came to; beside today's servo in the same worlds, where its trials are given."""
    row = {
        "beyond 10°": float((trials["first"] > AT_ONCE).mean()),
        **beside("harmed", mean_share(trials["harmed"].to_numpy()), ".1%"),
        "force, 99 %": float(trials["force"].quantile(0.99)),
        "largest force": float(trials["force"].max()),
        **beside("rendezvous", mean_share(trials["reached"].to_numpy()), ".1%"),
        "gave up": float(trials["gave up"].mean()),
        "motions": float(trials["motions"].mean()),
    }
    if today is None:
        return row
    unharmed = ~today["harmed"]
    return row | {"ratio": trials["motions"][unharmed].mean() / today["motions"][unharmed].mean()}


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
