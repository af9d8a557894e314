"""Whether what `memory` does after a change is right: by what else a copy of it could have done."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

import calfree_gym
from calfree_gym.image import CAMERAS
from calfree_gym.world import World
from experiments.reporting.tables import Table, beside
from experiments.running.lifetime import learn_trials
from experiments.statistics import mean_share
from experiments.studies.changes import KINDS, PAN, WORLDS, begun
from experiments.studies.common import CAP, Map, side_by_side

OF_THE_ARM = ("joint_zero", "link_length", "motor_gain", "motor_sign")
EVERY = ("none", "drift", *KINDS, "arm changed")
"""Kinds of changes."""
BRANCHES, AFTER = (60, 80, 100, 120, 140), 30
"""Trials at which copies of one state go different ways, and for how many."""
WAYS = ("recognise", "keep", "map", "discard")


def tables() -> Iterator[Table]:
    """The one table."""
    with side_by_side() as each:
        yield right_actions(each)


def right_actions(each: Map) -> Table:
    """Whether what is done is right: by what else could have been done with a copy of the same state."""
    rows = []
    for mount in calfree_gym.MOUNTS:
        worlds = list(each(partial(_branches, mount), WORLDS))
        found = [branch for world in worlds for branch in world]
        for kind in EVERY:
            motions = np.array([ways for what, ways, _ in found if what == kind])
            right = np.array(
                [[did <= 1.1 * min(others) for what, (did, *others), _ in w if what == kind] for w in worlds]
            )
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


def _branches(mount: str, seed: int) -> list[tuple[str, list[int], str]]:
    """What was done to the world, motions of all ways, and what the change was recognised as."""
    states: dict[int, dict[str, NDArray[Any]]] = {}
    agent, recorder = begun(mount, seed)
    env: Any = recorder.unwrapped

    def keep_state() -> None:
        if recorder.trials in BRANCHES:
            states.setdefault(recorder.trials, agent.arrays())

    learn_trials(agent, recorder, BRANCHES[-1], keep_state)
    found = []
    for kind, (i, trial) in product(EVERY, enumerate(BRANCHES)):
        camera = CAMERAS[i % 2]
        of_the_arm = OF_THE_ARM[(seed + i) % len(OF_THE_ARM)]
        schedule = _at_once(kind, camera, of_the_arm)
        changed = np.array([camera == each or kind == "arm changed" for each in CAMERAS])
        ways = [
            _go(env.world, mount, schedule, 1000 * seed + trial, states[trial], way, announced)
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

    The cameras (2,) are those whose change is announced to it; None where it must recognise the change.
    """
    agent, recorder = begun(mount, seed, world=world, perturbations=schedule)
    agent.restore(state)
    agent.adaptation.on_change = way
    known = len(agent.adaptation.events)
    if announced is not None:
        agent.adaptation.announce_change(announced)
    records = learn_trials(agent, recorder, AFTER)
    return sum(r.motions_per_reach(CAP) for r in records), [e.kind for e in agent.adaptation.events[known:]]
