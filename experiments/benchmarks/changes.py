"""What becomes of knowledge when the world changes, measured: the paper's questions of section 5."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from typing import Any

import gymnasium as gym
import numpy as np
import pandas as pd
from numpy.typing import NDArray

import agents
import calfree_gym
from calfree_gym.image import CAMERAS
from calfree_gym.world import World
from experiments.benchmarks.trials import CAP, REACH, motions_per_reach, share_of
from experiments.evaluation import TrialRecord
from experiments.reporting.tables import Table, beside
from experiments.running.lifetime import LifetimeRecorder, learn_trials
from experiments.statistics import Array, mean_share

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
OF_THE_ARM = ("joint_zero", "link_length", "motor_gain", "motor_sign")
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
BRANCHES, AFTER = (60, 80, 100, 120, 140), 30
"""Trials at which copies of one state go different ways, and for how many."""
WAYS = ("recognise", "keep", "map", "discard")
DRIFT_TRIALS, DRIFT_LATE = 500, 300
"""Trials while a camera pans, and those that have gone where the late ones begin."""

Map = Callable[..., Iterable[Any]]


def changes() -> Iterator[Table]:
    """Motions after sudden changes and in drifts, and false alarms."""
    with ProcessPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        yield sudden_changes(pool.map)
        yield false_alarms(pool.map)
        yield drift(pool.map)


def actions() -> Iterator[Table]:
    """Whether what is done after a change is right."""
    with ProcessPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        yield right_actions(pool.map)


def sudden_changes(each: Map) -> Table:
    """Motions per reach after changes of one kind, beside those who always discard and who never act."""
    rows = []
    for kind, mount, policy in product((*KINDS, "back"), calfree_gym.MOUNTS, POLICIES):
        worlds = WORLDS if policy == "recognise" else WORLDS[:OTHERS]
        lifetimes = list(each(_lifetime, worlds, *map(_always, (mount, policy, _schedule(kind), TRIALS))))
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


def _always(value: Any) -> list[Any]:
    return [value] * len(WORLDS)


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
    motions = motions_per_reach(lifetimes)
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
        **share_of("success", lifetimes, ".2%"),
    }


def _trials(first: int, last: int) -> str:
    return f"{first + 1}-{last}" if last > first + 1 else f"{last}"


def _lifetime(
    seed: int, mount: str, policy: str, schedule: list[dict[str, Any]], trials: int
) -> list[TrialRecord]:
    env = gym.make(REACH, camera_mount=mount, dynamics="kinematic", perturbations=schedule)
    recorder = LifetimeRecorder(env, seed)
    return learn_trials(agents.make("memory", recorder, on_change=policy), recorder, trials)


def right_actions(each: Map) -> Table:
    """Whether what is done is right: by what else could have been done with a copy of the same state."""
    rows = []
    for mount in calfree_gym.MOUNTS:
        worlds = list(each(_branches, WORLDS, _always(mount)))
        found = [branch for world in worlds for branch in world]
        for kind in ("none", "drift", *KINDS, "arm changed"):
            motions = np.array([ways for what, ways, _ in found if what == kind])
            right = np.array([[_is_right(ways) for what, ways, _ in w if what == kind] for w in worlds])
            names = Counter(name for what, _, name in found if what == kind)
            rows.append(
                {
                    "change": kind,
                    "mount": mount,
                    "events": len(motions),
                    **beside("right", mean_share(right), ".0%"),
                    "required": 0.9,
                    **dict(zip(("did", *WAYS[1:]), motions.mean(0), strict=True)),
                    "recognised as": ", ".join(f"{name} {count}" for name, count in names.most_common()),
                }
            )
    return Table(
        "right_actions",
        f"memory, the same worlds: motions of the {AFTER} trials after a change",
        pd.DataFrame(rows),
        {"right": ".0%", "required": ".0%", **dict.fromkeys(("did", *WAYS[1:]), ".1f")},
        "What it did, beside copies that kept, mapped or discarded their knowledge when the change was "
        "announced. Right: within 10 % of the best of these, with its 95 % interval over worlds.",
    )


def _is_right(ways: list[int]) -> bool:
    return ways[0] <= 1.1 * min(ways[1:])


def false_alarms(each: Map, trials: int = 150) -> Table:
    """Changes that are recognised where nothing changes."""
    rows = []
    for mount in calfree_gym.MOUNTS:
        alarms = list(each(_alarms, WORLDS, _always(mount), _always(trials)))
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


def _alarms(seed: int, mount: str, trials: int) -> int:
    recorder = LifetimeRecorder(gym.make(REACH, camera_mount=mount, dynamics="kinematic"), seed)
    agent: Any = agents.make("memory", recorder)
    learn_trials(agent, recorder, trials)
    return len(agent.adaptation.events)


def _branches(seed: int, mount: str) -> list[tuple[str, list[int], str]]:
    """What was done to the world, motions of all ways, and what the change was recognised as."""
    states: dict[int, dict[str, NDArray[Any]]] = {}
    env: Any = gym.make(REACH, camera_mount=mount, dynamics="kinematic")
    recorder = LifetimeRecorder(env, seed)
    agent: Any = agents.make("memory", recorder)

    def keep_state() -> None:
        if recorder.trials in BRANCHES:
            states.setdefault(recorder.trials, agent.arrays())

    learn_trials(agent, recorder, BRANCHES[-1], keep_state)
    found = []
    for kind, (i, trial) in product(("none", "drift", *KINDS, "arm changed"), enumerate(BRANCHES)):
        camera = CAMERAS[i % 2]
        of_the_arm = OF_THE_ARM[(seed + i) % len(OF_THE_ARM)]
        schedule = _at_once(kind, camera, of_the_arm)
        changed = np.array([camera == each or kind == "arm changed" for each in CAMERAS])
        ways = [
            _go(env.unwrapped.world, mount, schedule, 1000 * seed + trial, states[trial], way, announced)
            for way in WAYS
            for announced in [changed if way in ("map", "discard") else None]
        ]
        found.append((kind, [motions for motions, _ in ways], (ways[0][1] or ["none"])[0]))
    return found


def _at_once(kind: str, camera: str, of_the_arm: str) -> list[dict[str, Any]]:
    """A change of that kind before the first trial, or slowly from it on."""
    if kind == "none":
        return []
    if kind == "drift":
        return [{"drift": {"per": "trial"}, "do": {**PAN, "camera": camera}}]
    change = {"type": KINDS[kind], "camera": camera} if kind in KINDS else {"type": of_the_arm}
    return [{"at": {"trial": 0}, "do": change}]


def _go(
    world: World,
    mount: str,
    schedule: list[dict[str, Any]],
    seed: int,
    state: dict[str, NDArray[Any]],
    way: str,
    announced: NDArray[np.bool_] | None,
) -> tuple[int, list[str]]:
    """Motions of the next trials of a copy of a state, and the changes that it recognised in them.

    Args:
        world: In which the copy goes on.
        mount: What the cameras are fixed to.
        schedule: What becomes of the world.
        seed: Of the trials.
        state: What the copy knows.
        way: What it does about a change.
        announced: Cameras (2,) whose change is announced to it; None where it must recognise the change.
    """
    env = gym.make(REACH, world=world, camera_mount=mount, dynamics="kinematic", perturbations=schedule)
    recorder = LifetimeRecorder(env, seed)
    agent: Any = agents.make("memory", recorder)
    agent.restore(state)
    agent.adaptation.on_change = way
    known = len(agent.adaptation.events)
    if announced is not None:
        agent.adaptation.announce_change(announced)
    records = learn_trials(agent, recorder, AFTER)
    return sum(r.motions_per_reach(CAP) for r in records), [e.kind for e in agent.adaptation.events[known:]]


def drift(each: Map) -> Table:
    """Motions per reach where one camera pans on and on."""
    schedule = [{"drift": {"per": "trial"}, "do": PAN}]
    all_of_them, late = f"motions in trials 1-{DRIFT_TRIALS}", f"in {DRIFT_LATE + 1}-{DRIFT_TRIALS}"
    rows = []
    for mount in calfree_gym.MOUNTS:
        lifetimes = list(each(_lifetime, WORLDS, *map(_always, (mount, "recognise", schedule, DRIFT_TRIALS))))
        motions = motions_per_reach(lifetimes)
        rows.append(
            {
                "mount": mount,
                all_of_them: motions.mean(),
                late: motions[:, DRIFT_LATE:].mean(),
                "required": 1.3,
                **share_of("success", lifetimes, ".2%"),
            }
        )
    frame = pd.DataFrame(rows)
    title = f"memory, the same worlds: a camera pans by 0.2 px a trial, {DRIFT_TRIALS} trials"
    formats = {**dict.fromkeys((all_of_them, late, "required"), ".2f"), "success": ".2%"}
    return Table("drift", title, frame, formats, "Intervals as in the first table.")
