"""What remembering is worth, measured: the paper's claims about its table, and what is asked of memory."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from itertools import product
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import agents
import calfree_gym
from agents.knowledge.interface import Knowledge
from calfree_gym.geometry import Array
from calfree_gym.robot.motors import MOTORS
from experiments.benchmarks.baselines import until
from experiments.benchmarks.region import Region
from experiments.evaluation import TrialRecord
from experiments.running.lifetime import Life

REACH, _ = calfree_gym.ENV_IDS
FIRST_WORLD = 2000
TRIALS = 400
WIDTH = 0.25
"""Of the region, as a share of the work space's width in each dimension."""
ASKED = ((25, 50), (100, 150), (300, 400))
"""Trials about which something is asked of memory."""
STORED = (100, 1_000, 10_000, 100_000)
ENOUGH = 0.5
"""A substantial part of the records that are ever needed."""
TABLES: tuple[dict[str, Any], ...] = ({}, {"cells": 4}, {"cells": 16})


def knowledge() -> str:
    """All that is measured here."""
    return "\n".join([*_region(), *_records(), *_stored(), *_memory()])


def _region(worlds: int = 10) -> Iterator[str]:
    """Robot seconds per reach of the paper's table, where objects lie anywhere and in a region."""
    yield (
        f"grid_table, {_named(worlds)}, waist, kinematic, {TRIALS} trials: robot "
        "seconds per reach (the paper: 50, then a few; wanted: 3 times fewer in the region)"
    )
    for settings in TABLES:
        for share, where in ((1.0, "whole work space"), (WIDTH, f"region of width {WIDTH:g}")):
            lives, tables = _lives("grid_table", "waist", worlds, share, "kinematic", TRIALS, **settings)
            seconds = np.array([[record.robot_seconds for record in life] for life in lives])
            first, last = seconds[:, :25].mean(), seconds[:, -100:].mean()
            records = [~np.isnan(table.knowledge.records).any(-1) for table in tables]
            filled = [table.knowledge.known_cells()[0] for table in tables]
            label = " ".join(f"{key} {value}" for key, value in settings.items()) or "as it is"
            yield (
                f"  {label:9} {where:20} trials 1-5: {seconds[:, :5].mean():4.1f}   1-25: {first:4.1f}"
                f"   {TRIALS - 99}-{TRIALS}: {last:4.1f}   times fewer {first / last:.1f}"
                f"   records {np.mean([each.sum() for each in records]):5,.0f}"
                f"   cells filled {np.mean([each.sum() for each in filled]):4,.0f}"
            )


def _records(worlds: int = 5, objects: int = 4_000, cells: int = 8) -> Iterator[str]:
    """The 4-D table beside one of 6-D, whose other coordinates are the object's direction in both images."""
    yield (
        f"records of 8 cells a dimension; needed: those about {objects:,} objects in each of {worlds} wild "
        "worlds, in 6-D lying in any direction in each image"
    )
    curves: dict[int, list[int]] = {4: [], 6: []}
    needed: dict[int, list[int]] = {4: [], 6: []}
    for seed in range(FIRST_WORLD, FIRST_WORLD + worlds):
        sensors = np.array(list(_objects(seed, objects)))
        rng = np.random.default_rng(seed)
        in_4d = np.unique(_corners(sensors, cells)).size
        for dimensions in curves:
            needed[dimensions].append(in_4d * (cells + 1) ** (dimensions - 4))
            target = ENOUGH * needed[dimensions][-1]
            curves[dimensions].append(_trials_until(target, sensors, dimensions, cells, rng))
    for dimensions, trials in curves.items():
        records = (cells + 1) ** dimensions
        yield (
            f"  {dimensions}-D   records {records:7,}   bytes {8 * len(MOTORS) * records:10,}"
            f"   ever needed {np.mean(needed[dimensions]):7,.0f}"
            f"   trials until {ENOUGH:.0%} of these have been visited {np.mean(trials):6,.0f}"
        )


def _objects(seed: int, count: int) -> Iterator[Array]:
    env = gym.make(REACH, dynamics="kinematic")
    observation, _ = env.reset(seed=seed)
    for _ in range(count):
        yield observation["desired_goal"]
        observation, _ = env.reset()


def _corners(places: Array, cells: int) -> NDArray[np.int64]:
    """Which records (n, 2**d) stand at the corners about places (n, d) in [-1, 1]."""
    dimensions = places.shape[1]
    cell = np.clip(((places + 1) / 2 * cells).astype(int), 0, cells - 1)
    corners = cell[:, None] + np.array(list(product((0, 1), repeat=dimensions)))
    return np.asarray(np.ravel_multi_index(tuple(np.moveaxis(corners, -1, 0)), [cells + 1] * dimensions))


def _trials_until(
    target: float, sensors: Array, dimensions: int, cells: int, rng: np.random.Generator
) -> int:
    """After how many trials `target` records have been visited; objects are drawn from `sensors` (n, 4)."""
    visited: set[int] = set()
    trials = 0
    while len(visited) < target:
        direction = rng.uniform(-1, 1, dimensions - sensors.shape[1])
        place = np.concatenate([sensors[rng.integers(len(sensors))], direction])
        visited.update(_corners(place[None], cells)[0].tolist())
        trials += 1
    return trials


def _stored(recalls: int = 300) -> Iterator[str]:
    """Bytes to save and recall time against pairs stored, of a smooth map without noise."""
    yield "bytes to save, and median microseconds a recall (wanted: 300 at 10,000 pairs), after so many pairs"
    kinds: dict[Callable[..., Knowledge], list[str]] = {}
    for name, kind in agents.KNOWLEDGE.items():
        kinds.setdefault(kind, []).append(name)
    for kind, names in kinds.items():
        base: Any = kind(len(MOTORS))
        rng = np.random.default_rng(0)
        found, stored = [], 0
        for count in STORED:
            for _ in range(count - stored):
                base.learn(*_pair(rng))
            stored = count
            size = sum(array.nbytes for array in base.arrays().values())
            found.append(f"{count:,}: {size:,} B {_recall_time(base, rng, recalls):.0f} us")
        yield f"  {', '.join(names):28} " + "   ".join(found)


def _pair(rng: np.random.Generator) -> tuple[Array, Array]:
    registers = rng.uniform(-0.9, 0.9, len(MOTORS))
    a, b, c = registers
    sensors = 0.6 * np.array(
        [np.sin(a + 0.3 * b), np.sin(b + 0.3 * a * c), np.sin(0.8 * a - 0.3 * c), np.sin(c + b)]
    )
    return sensors, registers


def _recall_time(base: Knowledge, rng: np.random.Generator, recalls: int) -> float:
    seconds = []
    for _ in range(recalls):
        sensors, _ = _pair(rng)
        start = time.perf_counter()
        base.recall(sensors)
        seconds.append(time.perf_counter() - start)
    return float(1e6 * np.median(seconds))


def _memory(worlds: int = 20) -> Iterator[str]:
    """Motions per reach of memory in blocks of trials."""
    yield (
        f"memory, {_named(worlds)}, physics: motions per reach, worst world "
        "in brackets (wanted in trials 26-50: 1.8, in 101-150: 1.25 [1.6], in 301-400: 1.15; success 99.5%)"
    )
    for mount in calfree_gym.MOUNTS:
        lives, _ = _lives("memory", mount, worlds, 1.0, "physics", TRIALS)
        first, _ = _lives("unified_servo", mount, worlds, 1.0, "physics", 1)
        motions = np.array([[record.motions for record in life] for life in lives])
        blocks = "".join(f"   {a + 1}-{b}: {_mean_and_worst(motions[:, a:b])}" for a, b in ASKED)
        success = np.mean([record.success for life in lives for record in life])
        bare = np.mean([record.motions for (record,) in first])
        yield (
            f"  {mount:6} trial 1: {motions[:, 0].mean():.2f} (unified_servo {bare:.2f}){blocks}   "
            f"success {success:.2%}"
        )


def _mean_and_worst(motions: NDArray[np.int64]) -> str:
    return f"{motions.mean():.2f} [{motions.mean(1).max():.2f}]"


def _named(worlds: int) -> str:
    return f"wild worlds {FIRST_WORLD}-{FIRST_WORLD + worlds - 1}"


def _lives(
    name: str, mount: str, worlds: int, share: float, dynamics: str, trials: int, **settings: Any
) -> tuple[list[list[TrialRecord]], list[Any]]:
    """What an agent's own trials came to in each world, and the agents after them."""
    lives, lived = [], []
    for seed in range(FIRST_WORLD, FIRST_WORLD + worlds):
        records: list[TrialRecord] = []
        env = gym.make(REACH, camera_mount=mount, dynamics=dynamics)
        life = Life(Region(env, share) if share < 1 else env, seed, records.append)
        lived.append(agents.make(name, life, **settings).learn(60 * trials, callback=until(trials, records)))
        lives.append(records)
    return lives, lived
