"""How fast grasping is stepped: against MuJoCo alone on the same model, and against reaching."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from itertools import count
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
import pandas as pd

import agents
from calfree_gym.geometry import Array
from calfree_gym.robot.simulation import SUBSTEPS
from experiments.benchmarks.speed.rates import pinned, stepping
from experiments.reporting.tables import Table

GRASP = "calfree_gym:CalFree/Grasp-v0"
ROUNDS, ROWS, MOTIONS, BARE_STEPS = 20, 64, 6, 500
FREE, HELD = "jaws free", "object held"
WORDS = {FREE: 0.1, HELD: 0.03}
"""The largest words: what is held is carried about, and not pressed on the table."""
BESIDE_MUJOCO, BESIDE_BATCH, BESIDE_REACH = 0.85, 0.90, {FREE: 0.40, HELD: 0.25}
"""What the project asks of itself."""

Run = Callable[[], int]
"""Steps physics; tells by how many substeps."""


def grasping() -> Iterator[Table]:
    """Physics substeps a second as ratios, each pair in turns; a motion has as many as its way is long."""
    lines: list[tuple[Any, ...]] = []
    arguments: dict[str, Any] = {"truth": False, "terminate_on_success": False}
    with pinned(1):
        reach = stepping(1, MOTIONS, truth=False)
        for state, make in ((FREE, _free), (HELD, _holding)):
            env = make(arguments)
            simulation = env.arms.simulation
            model, data = simulation._batch.get_model(0), simulation._batch.get_data(0)
            rates = _in_turns(_moving(env, WORDS[state]), _bare(model, data), _reaching(reach))
            lines.append((f"one environment / bare mj_step, {state}", *_line(rates, 1), BESIDE_MUJOCO))
            lines.append((f"one environment / reaching, {state}", *_line(rates, 2), BESIDE_REACH[state]))
    ours, other = (gym.make_vec(GRASP, ROWS, max_episode_steps=10**9, **arguments) for _ in range(2))
    ours.reset(seed=0)
    other.reset(seed=0)
    batch = other.unwrapped.arms.simulation._batch  # type: ignore[attr-defined]
    rates = _in_turns(_moving(ours.unwrapped, WORDS[FREE]), lambda: _batch_steps(batch))
    lines.append((f"{ROWS} rows / bare Batch, {FREE}", *_line(rates, 1), BESIDE_BATCH))
    columns = ["row", "ratio", "ours a second", "other a second", "required"]
    formats = {"ratio": ".2f", "required": ".2f", "ours a second": ",.0f", "other a second": ",.0f"}
    note = f"Medians of {ROUNDS} rounds in turns, wild worlds, waist mount, {os.cpu_count()} cores for rows"
    yield Table("grasping", "Physics substeps a second", pd.DataFrame(lines, columns=columns), formats, note)


def _in_turns(*runs: Run) -> Array:
    """Substeps a second (rounds, runs)."""
    rates = np.empty((ROUNDS, len(runs)))
    for run in runs:
        run()
    for row in rates:
        for i, run in enumerate(runs):
            since = time.perf_counter()
            substeps = run()
            row[i] = substeps / (time.perf_counter() - since)
    return rates


def _line(rates: Array, other: int) -> tuple[float, float, float]:
    """Ratio of the first to another, and the rates of both: medians."""
    ratio = np.median(rates[:, 0] / rates[:, other])
    return float(ratio), float(np.median(rates[:, 0])), float(np.median(rates[:, other]))


def _free(arguments: dict[str, Any]) -> Any:
    """An arm whose jaws are open and empty."""
    env = gym.make(GRASP, disable_env_checker=True, **arguments)
    env.reset(seed=0)
    return env.unwrapped


def _holding(arguments: dict[str, Any]) -> Any:
    """An arm that holds an object in the air."""
    env = gym.make(GRASP, shape="cylinder", disable_env_checker=True, **arguments)
    agent = agents.make("grasp", env, knowledge=None)
    for seed in count():
        (observation, _), state, over = env.reset(seed=seed), None, False
        while not over:
            words, state = agent.predict(observation, state)
            observation, _, terminated, truncated, _ = env.step(words)
            if observation["achieved_goal"][-1] == 1:
                return env.unwrapped
            over = terminated or truncated
    raise AssertionError


def _moving(env: Any, largest: float) -> Run:
    """Makes motions there and back again, with jaws as they are."""
    shape = (MOTIONS, *env.action_space.shape)
    words = np.random.default_rng(0).uniform(-largest, largest, shape).astype(np.float32)
    words[1::2] = -words[::2]
    words[..., -1] = 0
    simulation = env.arms.simulation
    clock, timestep = simulation._batch.bind("time"), simulation._model.opt.timestep

    def run() -> int:
        before = float(clock.sum())
        for word in words:
            env.step(word)
        return round((float(clock.sum()) - before) / timestep)

    return run


def _bare(model: mujoco.MjModel, data: mujoco.MjData) -> Run:
    def run() -> int:
        for _ in range(BARE_STEPS):
            mujoco.mj_step(model, data)
        return BARE_STEPS

    return run


def _reaching(motions: Callable[[], None]) -> Run:
    def run() -> int:
        motions()
        return MOTIONS * SUBSTEPS

    return run


def _batch_steps(batch: Any) -> int:
    batch.step(nstep=BARE_STEPS // 10)
    return ROWS * (BARE_STEPS // 10)
