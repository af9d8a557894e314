"""What training over many worlds is worth: PPO over a pool of them, then in worlds that it never met."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import chain, product
from typing import Any

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from gymnasium.vector import AutoresetMode
from matplotlib.figure import Figure

import agents
from experiments.config.suite import AgentConfig
from experiments.evaluation import Predictor, evaluate
from experiments.reporting.figures import (
    STYLE,
    LineEnd,
    in_words,
    label_lines,
    lines_of,
    marks,
    motions_axis,
    say,
)
from experiments.reporting.tables import Table
from experiments.studies.common import CAP, DENSE, side_by_side

WORLDS: dict[str, Any] = {"world": "wild", "dynamics": "kinematic", "redraw": "trial"}
POOL, ROWS = 64, 64
LEARNERS = "ppo", "recurrent_ppo"
BESIDE = "random", "unified_servo"
"""Lines to compare with: neither is trained."""
HELD_OUT = 1_000_000
"""Seeds the objects, and worlds that are in no pool."""
MINUTES = "CPU minutes"
KNOWN, UNSEEN = "motions a reach, worlds of the pool", "motions a reach, unseen worlds"


def tables(
    minutes: Sequence[float] = (0.5, 1, 2, 5, 10), runs: int = 3, trials: int = 100
) -> Iterator[Table]:
    """Every learner as often as there are runs, looked at after some minutes of its own CPU time.

    Runs differ in seeds alone. Each of the held-out trials of a look is in a world of its own; what they take
    does not count.
    """
    with side_by_side() as each:
        curves = each(partial(_curve, minutes=minutes, trials=trials), product(LEARNERS, range(runs)))
        beside = [_row(name, 0, 0, _untrained(name), trials) for name in BESIDE]
        frame = pd.DataFrame([*beside, *chain.from_iterable(curves)])
    yield Table(
        "training",
        f"Trained over {POOL} worlds",
        frame,
        {MINUTES: "g", "motions": ",.0f", KNOWN: ".1f", UNSEEN: ".1f"},
        f"Wild worlds, waist mount, kinematic; {ROWS} arms, each trial in one of {POOL} worlds. Means of "
        f"{trials} held-out trials, in as many worlds where unseen; a trial without a rendezvous counts as "
        f"{CAP} motions. `unified_servo` meets each world for the first time. Learners have the settings of "
        "configs/agents, which were not tuned for this.",
    )


def figure(found: Sequence[Table]) -> Figure:
    """Motions a reach in unseen worlds against CPU time; thin lines are runs, thick ones their median."""
    frame = found[0].frame
    lines = lines_of([AgentConfig.model_validate(name) for name in (*BESIDE, *LEARNERS)])
    with plt.rc_context(STYLE):
        drawn, axes = plt.subplots(figsize=(7.6, 4.2), layout="constrained")
        motions_axis(axes, CAP)
        axes.set_xscale("log")
        times = sorted({minute for minute in frame[MINUTES] if minute})
        marks(axes.xaxis, times)
        axes.set(xlabel="CPU minutes of training", xlim=(times[0], times[-1]))
        ends = []
        for name in (*BESIDE, *LEARNERS):
            own = frame[frame["agent"].str.split(", run ").str[0] == name]
            of_runs = [run[UNSEEN].astype(float).to_numpy() for _, run in own.groupby("agent")]
            curves = np.broadcast_to(np.stack(of_runs), (len(of_runs), len(times)))
            if len(curves) > 1:
                axes.plot(times, curves.T, color=lines[name]["color"], linewidth=0.6, alpha=0.5)
            middle = np.median(curves, axis=0)
            axes.plot(times, middle, **lines[name])
            ends.append(LineEnd(times[-1], middle[-1], in_words(name, name), lines[name]["color"]))
        say(drawn, "Trained over many worlds: motions per reach in worlds never met", found[0].note)
        label_lines(axes, ends, 10)
    return drawn


def _curve(which: tuple[str, int], minutes: Sequence[float], trials: int) -> list[dict[str, Any]]:
    """A row of each look at one run."""
    name, run = which
    envs: Any = gym.make_vec(
        DENSE, ROWS, autoreset_mode=AutoresetMode.SAME_STEP, truth=False, pool=POOL, **WORLDS
    )
    envs.reset(seed=run)
    learner = agents.make(name, envs, seed=run)
    spent, rows = 0.0, []
    for until in minutes:
        since = time.process_time()
        end = since + 60 * until - spent
        learner.learn(10**9, callback=lambda *_, end=end: time.process_time() < end)
        spent += time.process_time() - since
        rows.append(_row(f"{name}, run {run + 1}", until, learner.num_timesteps, learner, trials))
    envs.close()
    return rows


def _untrained(name: str) -> Predictor:
    env = gym.make(DENSE, **WORLDS)
    made: Predictor = agents.make(name, env, seed=0)
    return made


def _row(agent: str, minutes: float, motions: int, predictor: Predictor, trials: int) -> dict[str, Any]:
    row: dict[str, Any] = {"agent": agent, MINUTES: minutes, "motions": motions}
    for what, pool in ((KNOWN, POOL), (UNSEEN, None)):
        env = gym.make(DENSE, pool=pool, **WORLDS)
        records = evaluate(predictor, env, trials, HELD_OUT)
        row[what] = float(np.mean([record.motions_per_reach(CAP) for record in records]))
        env.close()
    return row
