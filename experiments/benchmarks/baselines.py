"""What the agents reach, measured: the servo, the table and SAC against what is required of them."""

from __future__ import annotations

from collections.abc import Iterator

import gymnasium as gym
import numpy as np
import pandas as pd

import agents
import calfree_gym
from experiments.evaluation import TrialRecord, evaluate
from experiments.reporting.tables import Table
from experiments.running.lifetime import LifetimeRecorder, learn_trials

REACH, DENSE = calfree_gym.ENV_IDS


def servo(worlds: int = 200) -> Iterator[Table]:
    """The paper's servo, one trial in each of some wild worlds, physics, both mounts."""
    rows = []
    for mount in calfree_gym.MOUNTS:
        records: list[TrialRecord] = []
        for seed in range(worlds):
            env = gym.make(REACH, camera_mount=mount, max_episode_steps=50)
            agent = agents.make("unified_servo", env, estimator="test_motions")
            records += evaluate(agent, env, trials=1, seed=seed)
        motions = [r.motions for r in records]
        rows.append(
            {
                "mount": mount,
                "success": np.mean([r.success for r in records]),
                "required success": 0.99,
                "median motions": np.median(motions),
                "required median": 16,
                "95th percentile": np.percentile(motions, 95),
                "median distance (mm)": np.median([r.distance_mm for r in records]),
                "required distance (mm)": 5.0,
                "median robot time (s)": np.median([r.robot_seconds for r in records]),
            }
        )
    yield Table(
        "servo",
        f"unified_servo with test motions, wild worlds 0-{worlds - 1}, one trial each, at most 50 motions",
        pd.DataFrame(rows),
        {
            "success": ".1%",
            "required success": ".1%",
            "median motions": ".0f",
            "95th percentile": ".0f",
            "median distance (mm)": ".1f",
            "required distance (mm)": ".1f",
            "median robot time (s)": ".0f",
        },
    )


def table(worlds: int = 10, trials: int = 400, before: int = 250) -> Iterator[Table]:
    """grid_table, training trials in wild worlds, the left camera re-aimed by 20 degrees on the way."""
    schedule = [{"at": {"trial": before}, "do": {"type": "camera_aim", "camera": "left", "degrees": 20}}]
    rows = []
    for mount in calfree_gym.MOUNTS:
        lifetimes = []
        for seed in range(worlds):
            recorder = LifetimeRecorder(gym.make(REACH, camera_mount=mount, perturbations=schedule), seed)
            lifetimes.append(learn_trials(agents.make("grid_table", recorder), recorder, trials))
        motions = np.array([[r.motions for r in records] for records in lifetimes])
        success = np.array([[r.success for r in records] for records in lifetimes])
        first, late = motions[:, :25].mean(), motions[:, before - 50 : before].mean()
        rows.append(
            {
                "mount": mount,
                "motions in trials 1-25": first,
                f"in {before - 49}-{before}": late,
                "ratio": late / first,
                "required ratio": 0.7,
                "success before the change": success[:, :before].mean(),
                "success after it": success[:, before:].mean(),
                "required success": 0.98,
            }
        )
    frame = pd.DataFrame(rows)
    shares = ("success before the change", "success after it", "required success")
    yield Table(
        "table",
        f"grid_table, {worlds} wild worlds, {trials} training trials, re-aimed by 20 degrees at {before}",
        frame,
        {**dict.fromkeys(frame.columns[1:5], ".2f"), **dict.fromkeys(shares, ".1%")},
    )


def sac(motions: int = 25_000, seeds: int = 2, trials: int = 200) -> Iterator[Table]:
    """Sac in the nominal world on the waist mount, with the settings of configs/agents/sac.yaml."""
    rows = []
    for seed in range(seeds):
        env = gym.make(DENSE, world="nominal", dynamics="kinematic")
        env.reset(seed=seed)
        agent = agents.make("sac", env, seed=seed).learn(motions)
        held_out = gym.make(REACH, world="nominal")
        records = evaluate(agent, held_out, trials=trials, seed=10_000 + seed)
        rows.append(
            {
                "seed": seed,
                "success": np.mean([r.success for r in records]),
                "required success": 0.9,
                "mean motions": np.mean([r.motions for r in records]),
                "within 16 px": np.mean([r.motions_to[16] is not None for r in records]),
            }
        )
    yield Table(
        "sac",
        f"sac, nominal world, waist mount, {motions:,} motions, {trials} held-out trials, tolerance 4 px",
        pd.DataFrame(rows),
        {"success": ".1%", "required success": ".1%", "mean motions": ".1f", "within 16 px": ".1%"},
    )
