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
from numpy.typing import NDArray

import agents
import calfree_gym
from calfree_gym.image import CAMERAS
from calfree_gym.world import World
from experiments.benchmarks.baselines import until
from experiments.evaluation import TrialRecord
from experiments.running.lifetime import Life

REACH, _ = calfree_gym.ENV_IDS
WORLDS = range(2000, 2020)
FIRST, APART, EVENTS = 60, 60, 5
"""Trials before the first change of a life, from each to the next, and how many there are."""
BEFORE, AWAY = 50, 30
"""Trials before a change that it is compared with; trials for which the old camera is away."""
OTHERS = 10
"""So many of the worlds for those who always discard and who never act."""
POLICIES = ("recognise", "discard", "keep")
KINDS: dict[str, str] = {
    "re-aimed": "camera_aim",
    "rolled": "camera_roll",
    "zoomed": "camera_zoom",
    "moved": "camera_shift",
    "replaced": "camera_replace",
}
OF_THE_ARM = ("joint_zero", "link_length", "motor_gain", "motor_sign")
ASKED = {
    "re-aimed": (3, 8, 0.25),
    "rolled": (3, 8, 0.25),
    "zoomed": (3, 8, 0.25),
    "moved": (5, 15, 0.7),
    "replaced": (25, 50, 0.6),
    "back": (1, 6, 0.25),
}
"""First and last trial after a change, and by how much longer a mean reach there may be than before."""
PAN = {"type": "camera_aim", "camera": "left", "degrees": 0.0375}
"""Moves the image centre 0.2 px at the built focal length."""
BRANCHES, AFTER = (60, 80, 100, 120, 140), 30
"""Trials at which copies of one state go different ways, and for how many."""


def changes() -> str:
    """All that is measured here."""
    with ProcessPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        return "\n".join([*_struck(pool.map), *_right(pool.map), *_drifting(pool.map)])


Map = Callable[..., Iterable[Any]]


def _struck(each: Map) -> Iterator[str]:
    """Motions per reach after changes of one kind, beside those who always discard and who never act."""
    yield (
        f"memory, wild worlds {WORLDS[0]}-{WORLDS[-1]}, kinematic, {EVENTS} changes a world: motions per "
        "reach before, those of another camera aside, and in trials after (wanted: before + so much); "
        f"those who always discard or never act in the first {OTHERS} of the worlds"
    )
    for kind, mount in product((*KINDS, "back"), calfree_gym.MOUNTS):
        for policy in POLICIES:
            worlds = WORLDS if policy == "recognise" else WORLDS[:OTHERS]
            lives = list(each(_life, worlds, *map(_always, (mount, policy, _schedule(kind), _STRUCK))))
            yield f"  {kind:11} {mount:6} {policy:9} " + _after(
                lives, ASKED.get(kind), AWAY if kind == "back" else 0
            )


_STRUCK = FIRST + APART * EVENTS
_CHANGES = np.arange(FIRST, _STRUCK, APART)


def _always(value: Any) -> list[Any]:
    return [value] * len(WORLDS)


def _schedule(kind: str) -> list[dict[str, Any]]:
    """Changes of one camera; where it is the old one that comes back, some trials after another came."""
    do = {"type": KINDS.get(kind, "camera_replace"), "camera": CAMERAS[0]}
    if kind != "back":
        return [{"at": {"trial": int(t)}, "do": do} for t in _CHANGES]
    replaced = [{"at": {"trial": int(t) - AWAY}, "do": do} for t in _CHANGES]
    undone = [{"at": {"trial": int(t)}, "undo": 2 * i} for i, t in enumerate(_CHANGES)]
    return [event for pair in zip(replaced, undone, strict=True) for event in pair]


def _after(lives: list[list[TrialRecord]], asked: tuple[int, int, float] | None, away: int) -> str:
    """Mean motions before changes, less the trials `away` from the old camera, and in blocks after."""
    motions = np.array([[record.motions for record in life] for life in lives])
    success = np.mean([record.success for life in lives for record in life])
    before = np.mean([motions[:, t - BEFORE : t - away] for t in _CHANGES])
    blocks = dict.fromkeys([(0, 1), *([asked[:2]] if asked else []), (3, 8), (25, 50)])
    told = "".join(
        f"   {a + 1}-{b}: {np.mean([motions[:, t + a : t + b] for t in _CHANGES]):5.2f}"
        + (f" ({before + asked[2]:.2f})" if asked and asked[:2] == (a, b) else "")
        for a, b in blocks
    )
    return f"before: {before:.2f}{told}   success {success:.2%}"


def _life(
    seed: int, mount: str, policy: str, schedule: list[dict[str, Any]], trials: int
) -> list[TrialRecord]:
    records: list[TrialRecord] = []
    env = gym.make(REACH, camera_mount=mount, dynamics="kinematic", perturbations=schedule)
    agent = agents.make("memory", Life(env, seed, records.append), on_change=policy)
    agent.learn(60 * trials, callback=until(trials, records))
    return records


def _right(each: Map) -> Iterator[str]:
    """Whether what is done is right: by what else could have been done with a copy of the same state."""
    yield (
        f"memory, the same worlds: what it did, and the motions of the next {AFTER} trials, beside those of "
        "copies that kept, mapped or discarded what was known, told of the change (right: within 10 % of the "
        "best; wanted: 90 %)"
    )
    kinds = ("none", "drift", *KINDS, "arm changed")
    for mount in calfree_gym.MOUNTS:
        found = [branch for world in each(_branches, WORLDS, _always(mount)) for branch in world]
        for kind in kinds:
            motions = np.array([ways for what, ways, _ in found if what == kind])
            names = Counter(name for what, _, name in found if what == kind)
            right = np.mean(motions[:, 0] <= 1.1 * motions[:, 1:].min(1))
            means = "   ".join(
                f"{way} {mean:5.1f}"
                for way, mean in zip(("did", "keep", "map", "discard"), motions.mean(0), strict=True)
            )
            yield (
                f"  {kind:11} {mount:6} right {right:4.0%} of {len(motions)}   {means}   recognised as "
                + ", ".join(f"{name} {count}" for name, count in names.most_common())
            )
    quiet = list(each(_alarms, WORLDS, _always("waist"))) + list(each(_alarms, WORLDS, _always("stand")))
    yield f"  false alarms in {150 * len(quiet):,} quiet trials: {sum(quiet)} (wanted: 3 in 3,000)"


def _alarms(seed: int, mount: str) -> int:
    env = gym.make(REACH, camera_mount=mount, dynamics="kinematic")
    records: list[TrialRecord] = []
    agent: Any = agents.make("memory", Life(env, seed, records.append))
    agent.learn(60 * 150, callback=until(150, records))
    return len(agent.adaptation.events)


def _branches(seed: int, mount: str) -> list[tuple[str, list[int], str]]:
    """What was done to the world, motions of all ways, and what the change was recognised as."""
    states: dict[int, dict[str, NDArray[Any]]] = {}
    records: list[TrialRecord] = []
    env: Any = gym.make(REACH, camera_mount=mount, dynamics="kinematic")
    agent: Any = agents.make("memory", Life(env, seed, records.append))

    def remember(progress: Any) -> bool:
        if len(records) in BRANCHES:
            states.setdefault(len(records), agent.arrays())
        return len(records) < BRANCHES[-1]

    agent.learn(60 * BRANCHES[-1], callback=remember)
    found = []
    for kind, (i, trial) in product(("none", "drift", *KINDS, "arm changed"), enumerate(BRANCHES)):
        camera = CAMERAS[i % 2]
        of_the_arm = OF_THE_ARM[(seed + i) % len(OF_THE_ARM)]
        schedule = _at_once(kind, camera, of_the_arm)
        changed = np.array([camera == each or kind == "arm changed" for each in CAMERAS])
        ways = [
            _go(env.unwrapped.world, mount, schedule, 1000 * seed + trial, states[trial], way, told)
            for way, told in (("recognise", None), ("keep", None), ("map", changed), ("discard", changed))
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
    told: NDArray[np.bool_] | None,
) -> tuple[int, list[str]]:
    """Motions of the next trials of a copy of a state, and the changes that it recognised in them."""
    records: list[TrialRecord] = []
    env = gym.make(REACH, world=world, camera_mount=mount, dynamics="kinematic", perturbations=schedule)
    agent: Any = agents.make("memory", Life(env, seed, records.append))
    agent.restore(state)
    agent.adaptation.on_change = way
    known = len(agent.adaptation.events)
    if told is not None:
        agent.adaptation.announce_change(told)
    agent.learn(60 * AFTER, callback=until(AFTER, records))
    return sum(r.motions for r in records), [e.kind for e in agent.adaptation.events[known:]]


def _drifting(each: Map) -> Iterator[str]:
    """Motions per reach where one camera pans on and on."""
    trials = 500
    yield (
        f"memory, the same worlds, a camera pans by 0.2 px a trial, {trials} trials: motions per reach "
        "(wanted 1.3)"
    )
    for mount in calfree_gym.MOUNTS:
        schedule = [{"drift": {"per": "trial"}, "do": PAN}]
        lives = list(each(_life, WORLDS, *map(_always, (mount, "recognise", schedule, trials))))
        motions = np.array([[record.motions for record in life] for life in lives])
        success = np.mean([record.success for life in lives for record in life])
        yield (
            f"  {mount:6} 1-{trials}: {motions.mean():.2f}"
            f"   301-{trials}: {motions[:, 300:].mean():.2f}   success {success:.2%}"
        )
