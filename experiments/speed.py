"""Speed as ratios to bare MuJoCo, measured in turns within one run, so that a drifting machine cancels."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
from mujoco.batch import Batch

from calfree_gym.simulation import SUBSTEPS, build_model

ROUNDS = 60


@dataclass(frozen=True)
class Ratio:
    """One line of the benchmark.

    Attributes:
        name: What was compared.
        wanted: The ratio that the project asks of itself.
        ratio: Median over rounds of bare seconds by our seconds, each pair timed in turn.
        ours, bare: Environment steps a second, medians.
    """

    name: str
    wanted: float
    ratio: float
    ours: float
    bare: float


def speed() -> str:
    """Measures the single, the batched and the kinematic environment, as lines of text."""
    ratios = [_single(), _batched(), _kinematic()]
    lines = [f"{'':44}{'ratio':>7}{'wanted':>8}{'ours/s':>12}{'bare/s':>12}"]
    for r in ratios:
        lines.append(f"{r.name:44}{r.ratio:7.2f}{r.wanted:8.2f}{r.ours:12,.0f}{r.bare:12,.0f}")
    lines.append(
        f"MuJoCo {mujoco.__version__}, {os.cpu_count()} cores, {SUBSTEPS} substeps a motion, "
        f"medians of {ROUNDS} rounds in turn"
    )
    return "\n".join(lines)


def _single() -> Ratio:
    """One environment against `mj_step` over the same substeps, one thread."""
    steps = 50
    env = gym.make("calfree_gym:CalFree/Reach-v0", terminate_on_success=False).unwrapped
    env.reset(seed=0)
    words = _words(steps, 1)[:, 0]
    model = build_model("waist")
    data = mujoco.MjData(model)

    def bare() -> None:
        for _ in range(steps * SUBSTEPS):
            mujoco.mj_step(model, data)

    with _pinned(1):
        return _ratio("single environment / bare mj_step", 0.85, _stepping(env, words), bare, steps)


def _batched() -> Ratio:
    """256 rows on all cores against a bare `Batch` over the same substeps."""
    rows, steps = 256, 4
    env = gym.make_vec("calfree_gym:CalFree/Reach-v0", num_envs=rows)
    env.reset(seed=0)
    words = _words(steps, rows)
    batch = Batch(build_model("waist"), rows)

    def bare() -> None:
        for _ in range(steps):
            batch.step(nstep=SUBSTEPS)

    return _ratio(f"batched, {rows} rows / bare Batch", 0.90, _stepping(env, words), bare, steps * rows)


def _kinematic() -> Ratio:
    """1,024 rows of kinematic dynamics on all cores against a bare `Batch.forward(POS)`."""
    rows, steps = 1024, 60
    env = gym.make_vec("calfree_gym:CalFree/Reach-v0", num_envs=rows, dynamics="kinematic")
    env.reset(seed=0)
    words = _words(steps, rows)
    batch = Batch(build_model("waist"), rows)
    stage = int(mujoco.mjtStage.mjSTAGE_POS)

    def bare() -> None:
        for _ in range(steps):
            batch.forward(stage=stage)

    name = f"kinematic, {rows} rows / bare Batch.forward(POS)"
    return _ratio(name, 0.40, _stepping(env, words), bare, steps * rows)


def _stepping(env: Any, words: np.ndarray) -> Callable[[], None]:
    def ours() -> None:
        for word in words:
            env.step(word)

    return ours


def _words(steps: int, rows: int) -> np.ndarray:
    """Words there and back again, so that registers stay where they can be."""
    words = np.random.default_rng(0).uniform(-0.1, 0.1, (steps, rows, 3)).astype(np.float32)
    words[1::2] = -words[::2]
    return words


def _ratio(name: str, wanted: float, ours: Callable[[], None], bare: Callable[[], None], steps: int) -> Ratio:
    seconds = np.empty((ROUNDS, 2))
    for row in seconds:
        for i, function in enumerate((ours, bare)):
            start = time.perf_counter()
            function()
            row[i] = time.perf_counter() - start
    ratio = float(np.median(seconds[:, 1] / seconds[:, 0]))
    ours_s, bare_s = np.median(seconds, axis=0)
    return Ratio(name, wanted, ratio, steps / float(ours_s), steps / float(bare_s))


@contextmanager
def _pinned(cores: int) -> Iterator[None]:
    """Holds the process to this many cores, where the system can."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, set(sorted(before)[:cores]))
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)
