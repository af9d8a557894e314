"""What knowledge is worth: seconds in a region of the work space, records, bytes, and time of a recall."""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import product
from typing import Any

import gymnasium as gym
import numpy as np
import pandas as pd
from numpy.typing import NDArray

import agents
from agents.memory.pairs import Pairs
from agents.memory.remembered import Remembered
from agents.servo.image_model.least_distance import LeastDistance, Seeker
from agents.servo.perception import MARKER_NOISE_PX
from agents.servo.unified import UnifiedServo
from calfree_gym.geometry import Array
from calfree_gym.robot.arms.movemaster import DISTANCE, HEIGHT, MOTORS, WAIST
from experiments.evaluation import TrialRecord, robot_seconds_at
from experiments.reporting.tables import Table, beside
from experiments.running.lifetime import LifetimeRecorder, learn_trials
from experiments.statistics import Estimate, median_world, relative_change
from experiments.studies.common import CAP, REACH

FIRST_WORLD = 2000
LOOKS = (0.2, 1.0, 4.0)
"""Seconds a look: the paper tells none, and its 50 s a grasp come out at about the last."""
TRIALS = 400
WIDTH = 0.25
"""Of the region, as a share of the work space's width in each dimension."""
STORED = (100, 1_000, 10_000, 100_000)
REQUIRED_AT = 10_000
"""Pairs stored at which the time of a recall is bounded."""
ENOUGH = 0.5
"""A substantial part of the records that are ever needed."""
TABLES: tuple[dict[str, Any], ...] = ({}, {"cells": 4}, {"cells": 16})


LOW, HIGH = np.array([[-WAIST, DISTANCE[0], HEIGHT[0]], [WAIST, DISTANCE[1], HEIGHT[1]]])


def tables() -> Iterator[Table]:
    """All that is measured here."""
    yield region()
    yield records()
    yield stored()


class Region(gym.Wrapper[Any, Any, Any, Any]):
    """Resets until the object lies in a box about the first one, as far as that leaves the work space.

    The box is one in angle about the waist, distance from it and height: there the work space is a box too.

    Args:
        env: Places the objects.
        share: Of the work space's width, in each dimension.
    """

    def __init__(self, env: gym.Env[Any, Any], share: float):
        super().__init__(env)
        self._half = share / 2 * (HIGH - LOW)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Places an object in the region; with a seed, the region too."""
        observation, info = self.env.reset(seed=seed, options=options)
        if seed is not None:
            self._centre = np.clip(_place(info), LOW + self._half, HIGH - self._half)
        while (np.abs(_place(info) - self._centre) > self._half + 1e-9).any():
            observation, info = self.env.reset()
        return observation, info


def _place(info: dict[str, Any]) -> Array:
    """The object's angle (rad), distance and height (m)."""
    x, y, z = info["truth"]["object"]
    return np.array([np.arctan2(y, x), np.hypot(x, y), z])


def region(worlds: int = 10) -> Table:
    """Robot seconds per reach of the paper's table, where objects lie anywhere and in a region."""
    rows = []
    for settings in TABLES:
        for share, where in ((1.0, "whole work space"), (WIDTH, f"region of width {WIDTH:g}")):
            lifetimes, learned = _lifetimes(worlds, share, settings)
            stored = [~np.isnan(table.knowledge.records).any(-1) for table in learned]
            filled = [table.knowledge.known_cells()[0] for table in learned]
            for look in LOOKS:
                rows.append(
                    {
                        "settings": " ".join(f"{key} {value}" for key, value in settings.items())
                        or "defaults",
                        "objects": where,
                        "s a look": look,
                        **_seconds(lifetimes, look),
                        "required": None if share == 1 else 3.0,
                        "records": np.mean([each.sum() for each in stored]),
                        "cells filled": np.mean([each.sum() for each in filled]),
                    }
                )
    frame = pd.DataFrame(rows)
    formats = {name: ".1f" for name in frame.columns[3:-2] if not str(name).endswith("95 %")}
    formats |= {"records": ",.0f", "cells filled": ",.0f"}
    last = FIRST_WORLD + worlds - 1
    title = (
        f"grid_table, wild worlds {FIRST_WORLD}-{last}, waist, kinematic, {TRIALS} trials: robot seconds per "
        "reach"
    )
    return Table(
        "region",
        title,
        frame,
        formats,
        "The way home included; a trial without a rendezvous goes on to the cap at its own pace. The "
        "median world; times fewer: of means. The paper: 50 s, then a few; it tells no look time, so these "
        "seconds confirm none of its.",
    )


def _seconds(lifetimes: list[list[TrialRecord]], look: float) -> dict[str, Any]:
    """Robot seconds per reach in blocks of trials, where a look takes so many seconds."""
    seconds = np.array([[_of_trial(record, look) for record in records] for records in lifetimes])
    first, last = seconds[:, :25].mean(axis=1), seconds[:, -100:].mean(axis=1)
    blocks = {"seconds in trials 1-5": seconds[:, :5].mean(axis=1), "1-25": first}
    blocks |= {f"{TRIALS - 99}-{TRIALS}": last}
    more = relative_change(last, first)
    fewer = Estimate(1 + more.value, 1 + more.low, 1 + more.high)
    found: dict[str, Any] = {}
    for name, each in blocks.items():
        found |= beside(name, median_world(each), ".1f")
    return found | beside("times fewer", fewer, ".1f")


def _of_trial(record: TrialRecord, look: float) -> float:
    pace = 1.0 if record.rendezvous else CAP / record.motions
    return pace * float(robot_seconds_at(look, record.robot_seconds, record.motions))


def records(worlds: int = 5, objects: int = 4_000, cells: int = 8) -> Table:
    """The 4-D table beside one of 6-D, whose other coordinates are the object's direction in both images."""
    trials: dict[int, list[int]] = {4: [], 6: []}
    needed: dict[int, list[int]] = {4: [], 6: []}
    for seed in range(FIRST_WORLD, FIRST_WORLD + worlds):
        sensors = np.array(list(_objects(seed, objects)))
        rng = np.random.default_rng(seed)
        in_4d = np.unique(_corners(sensors, cells)).size
        for dimensions in trials:
            needed[dimensions].append(in_4d * (cells + 1) ** (dimensions - 4))
            target = ENOUGH * needed[dimensions][-1]
            trials[dimensions].append(_trials_until(target, sensors, dimensions, cells, rng))
    rows = [
        {
            "dimensions": dimensions,
            "records": (cells + 1) ** dimensions,
            "bytes": 8 * len(MOTORS) * (cells + 1) ** dimensions,
            "ever needed": np.mean(needed[dimensions]),
            f"trials until {ENOUGH:.0%} of these have been visited": np.mean(trials[dimensions]),
        }
        for dimensions in trials
    ]
    frame = pd.DataFrame(rows)
    return Table(
        "records",
        f"Records of {cells} cells a dimension",
        frame,
        dict.fromkeys(frame.columns[1:], ",.0f"),
        f"Needed: the records about {objects:,} objects in each of {worlds} wild worlds; in 6-D, they lie "
        "in any direction in each image.",
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


def stored(recalls: int = 300) -> Table:
    """Bytes to save and recall time against pairs stored, of a smooth map without noise."""
    rows = []
    for name, kind in agents.KNOWLEDGE.items():
        base = RememberedPairs(len(MOTORS)) if kind is Remembered else kind(len(MOTORS))
        rng = np.random.default_rng(0)
        pairs = 0
        for count in STORED:
            for _ in range(count - pairs):
                base.learn(*_pair(rng))
            pairs = count
            rows.append(
                {
                    "knowledge": name,
                    "pairs": count,
                    "bytes": sum(array.nbytes for array in base.arrays().values()),
                    "µs a recall": _recall_time(base, rng, recalls),
                    "required": 300.0 if count == REQUIRED_AT else None,
                }
            )
    formats = {"pairs": ",d", "bytes": ",d", "µs a recall": ".0f", "required": ".0f"}
    return Table("stored", "Bytes to save, and median time of a recall", pd.DataFrame(rows), formats)


class RememberedPairs:
    """What `memory` goes by, as a table of pairs: a recall seeks the rendezvous, as the first step does.

    Args:
        motors: Number of registers m.
    """

    def __init__(self, motors: int) -> None:
        self._remembered = Remembered(motors)
        self._stops = np.ones(motors)

    def learn(self, sensors: Array, registers: Array) -> None:
        """Takes in a look at a rendezvous; the object is seen there where it is seen from home (4,)."""
        seen = sensors[None]
        noise_px, trial = np.array([MARKER_NOISE_PX]), np.zeros(1, np.int64)
        self._remembered.learn(Pairs(registers[None], seen, seen, seen, noise_px, trial))

    def recall(self, sensors: Array) -> LeastDistance:
        """Where the least distance is expected to an object that is seen from home at `sensors` (4,)."""
        points, home = self._remembered.points(sensors, MARKER_NOISE_PX), 0 * self._stops
        return Seeker(points, home, -self._stops, self._stops, UnifiedServo.caution).seek()

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All that is remembered."""
        return self._remembered.arrays()


def _pair(rng: np.random.Generator) -> tuple[Array, Array]:
    registers = rng.uniform(-0.9, 0.9, len(MOTORS))
    a, b, c = registers
    sensors = 0.6 * np.array(
        [np.sin(a + 0.3 * b), np.sin(b + 0.3 * a * c), np.sin(0.8 * a - 0.3 * c), np.sin(c + b)]
    )
    return sensors, registers


def _recall_time(base: Any, rng: np.random.Generator, recalls: int) -> float:
    seconds = []
    for _ in range(recalls):
        sensors, _ = _pair(rng)
        start = time.perf_counter()
        base.recall(sensors)
        seconds.append(time.perf_counter() - start)
    return float(1e6 * np.median(seconds))


def _lifetimes(
    worlds: int, share: float, settings: dict[str, Any]
) -> tuple[list[list[TrialRecord]], list[Any]]:
    """What the table's own trials came to in each world, and the agents after them."""
    lifetimes, learned = [], []
    for seed in range(FIRST_WORLD, FIRST_WORLD + worlds):
        env = gym.make(REACH, camera_mount="waist", dynamics="kinematic")
        recorder = LifetimeRecorder(Region(env, share) if share < 1 else env, seed)
        agent = agents.make("grid_table", recorder, **settings)
        lifetimes.append(learn_trials(agent, recorder, TRIALS))
        learned.append(agent)
    return lifetimes, learned
