"""What becomes of knowledge when the world changes, measured: the paper's questions of section 5."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import product
from typing import Any

import gymnasium as gym
import numpy as np
import pandas as pd

import agents
import calfree_gym
from calfree_gym.image import CAMERAS
from experiments.evaluation import TrialRecord
from experiments.reporting.tables import Table, beside
from experiments.running.lifetime import LifetimeRecorder, learn_trials
from experiments.statistics import Array, mean_share
from experiments.studies.common import CAP, REACH, Map, side_by_side

WORLDS = range(2000, 2020)
FIRST, APART, EVENTS = 60, 60, 5
"""Trials before the first change of a lifetime, from each to the next, and how many there are."""
BEFORE, AWAY = 50, 30
"""Trials before a change that it is compared with; trials for which the old camera is away."""
TRIALS = FIRST + APART * EVENTS
CHANGES = np.arange(FIRST, TRIALS, APART)
OTHERS = 5
"""This many of the worlds for those who always discard and who never act: these take ten times as long."""
POLICIES = ("recognise", "discard", "keep")
KINDS: dict[str, str] = {
    "re-aimed": "camera_aim",
    "rolled": "camera_roll",
    "zoomed": "camera_zoom",
    "moved": "camera_shift",
    "replaced": "camera_replace",
}
REQUIRED = {
    "re-aimed": (3, 8, 0.25),
    "rolled": (3, 8, 0.25),
    "zoomed": (3, 8, 0.25),
    "moved": (5, 15, 0.7),
    "replaced": (25, 50, 0.6),
    "back": (1, 6, 0.25),
}
"""First and last trial after a change, and by how much longer a mean reach there may be than before."""
BLOCKS = ((0, 1), (3, 8), (25, 50))
"""Trials after a change that are shown for every kind."""
PAN = {"type": "camera_aim", "camera": "left", "degrees": 0.0375}
"""Moves the image centre 0.2 px at the built focal length."""
DRIFT_TRIALS, DRIFT_LATE = 500, 300
"""Trials while a camera pans, and those that have gone where the late ones begin."""


def tables() -> Iterator[Table]:
    """Motions after sudden changes and in drifts, and false alarms."""
    with side_by_side() as each:
        yield sudden_changes(each)
        yield false_alarms(each)
        yield drift(each)


def sudden_changes(each: Map) -> Table:
    """Motions per reach after changes of one kind, beside those who always discard and who never act."""
    rows = []
    for kind, mount, policy in product((*KINDS, "back"), calfree_gym.MOUNTS, POLICIES):
        worlds = WORLDS if policy == "recognise" else WORLDS[:OTHERS]
        lived = partial(_lifetime, mount, policy, _schedule(kind), TRIALS)
        lifetimes = list(each(lived, worlds))
        after = _after(lifetimes, REQUIRED[kind], AWAY if kind == "back" else 0)
        rows.append({"change": kind, "mount": mount, "policy": policy, "worlds": len(worlds), **after})
    frame = pd.DataFrame(rows)
    motions = ("before", *(_trials(*block) for block in BLOCKS), "motions there", "required")
    return Table(
        "sudden_changes",
        f"memory, wild worlds {WORLDS[0]}-{WORLDS[-1]}, {EVENTS} changes a world: motions per reach",
        frame,
        {**dict.fromkeys(motions, ".2f"), "success": ".2%"},
        "Kinematic dynamics. Before: the trials before changes, without those of another camera. Then the "
        "trials after them; required: at most this many motions in the trials that are named. A trial "
        f"without a rendezvous counts as {CAP}. Success: true error within 4 px, with its 95 % interval "
        f"over worlds: each has {EVENTS} changes.",
    )


def _schedule(kind: str) -> list[dict[str, Any]]:
    """Changes of one camera; where it is the old one that comes back, some trials after another came."""
    do = {"type": KINDS.get(kind, "camera_replace"), "camera": CAMERAS[0]}
    if kind != "back":
        return [{"at": {"trial": int(t)}, "do": do} for t in CHANGES]
    replaced = [{"at": {"trial": int(t) - AWAY}, "do": do} for t in CHANGES]
    undone = [{"at": {"trial": int(t)}, "undo": 2 * i} for i, t in enumerate(CHANGES)]
    return [event for pair in zip(replaced, undone, strict=True) for event in pair]


def _after(lifetimes: list[list[TrialRecord]], required: tuple[int, int, float], away: int) -> dict[str, Any]:
    """Mean motions before changes, less the trials `away` from the old camera, and in blocks after."""
    motions, successes = _motions_and_successes(lifetimes)
    before = np.mean([motions[:, t - BEFORE : t - away] for t in CHANGES])

    def after(first: int, last: int) -> Array:
        """Of each world."""
        return np.asarray(np.mean([motions[:, t + first : t + last].mean(axis=1) for t in CHANGES], axis=0))

    first, last, more = required
    return {
        "before": before,
        **{_trials(*block): after(*block).mean() for block in BLOCKS},
        "required in trials": _trials(first, last),
        "motions there": after(first, last).mean(),
        "required": before + more,
        **beside("success", mean_share(successes), ".2%"),
    }


def _motions_and_successes(lifetimes: list[list[TrialRecord]]) -> Array:
    """Of each trial (2, worlds, trials)."""
    found = [[(each.motions_per_reach(CAP), each.success) for each in records] for records in lifetimes]
    return np.moveaxis(np.array(found, float), -1, 0)


def _trials(first: int, last: int) -> str:
    return f"{first + 1}-{last}" if last > first + 1 else f"{last}"


def _lifetime(
    mount: str, policy: str, schedule: list[dict[str, Any]], trials: int, seed: int
) -> list[TrialRecord]:
    agent, recorder = begun(mount, seed, perturbations=schedule)
    agent.adaptation.on_change = policy
    return learn_trials(agent, recorder, trials)


def begun(mount: str, seed: int, **arguments: Any) -> tuple[Any, LifetimeRecorder]:
    """A `memory` that knows nothing, and its lifetime."""
    recorder = LifetimeRecorder(gym.make(REACH, camera_mount=mount, dynamics="kinematic", **arguments), seed)
    return agents.make("memory", recorder), recorder


def false_alarms(each: Map, trials: int = 150) -> Table:
    """Changes that are recognised where nothing changes."""
    rows = []
    for mount in calfree_gym.MOUNTS:
        alarms = list(each(partial(_alarms, mount, trials), WORLDS))
        quiet = mean_share(np.array(alarms) == 0)
        rows.append(
            {
                "mount": mount,
                "quiet trials": trials * len(alarms),
                "false alarms": sum(alarms),
                **beside("worlds without any", quiet, ".0%"),
            }
        )
    title = "memory, the same worlds: false alarms where nothing changes"
    formats = {"quiet trials": ",d", "worlds without any": ".0%", "required": "g"}
    frame = pd.DataFrame(rows)
    frame["required"] = frame["quiet trials"] / 1_000
    return Table("false_alarms", title, frame, formats)


def _alarms(mount: str, trials: int, seed: int) -> int:
    agent, recorder = begun(mount, seed)
    learn_trials(agent, recorder, trials)
    return len(agent.adaptation.events)


def drift(each: Map) -> Table:
    """Motions per reach where one camera pans on and on."""
    schedule = [{"drift": {"per": "trial"}, "do": PAN}]
    all_of_them, late = f"motions in trials 1-{DRIFT_TRIALS}", f"in {DRIFT_LATE + 1}-{DRIFT_TRIALS}"
    rows = []
    for mount in calfree_gym.MOUNTS:
        lived = partial(_lifetime, mount, "recognise", schedule, DRIFT_TRIALS)
        lifetimes = list(each(lived, WORLDS))
        motions, successes = _motions_and_successes(lifetimes)
        rows.append(
            {
                "mount": mount,
                all_of_them: motions.mean(),
                late: motions[:, DRIFT_LATE:].mean(),
                "required": 1.3,
                **beside("success", mean_share(successes), ".2%"),
            }
        )
    frame = pd.DataFrame(rows)
    title = f"memory, the same worlds: a camera pans by 0.2 px a trial, {DRIFT_TRIALS} trials"
    formats = {**dict.fromkeys((all_of_them, late, "required"), ".2f"), "success": ".2%"}
    return Table("drift", title, frame, formats, "Intervals as in the first table.")
