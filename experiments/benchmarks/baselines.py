"""What the agents reach, measured: the servo, the table and SAC against what is asked of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import agents
import calfree_gym
from experiments.config.loading import read_yaml
from experiments.evaluation import TrialRecord, evaluate
from experiments.running.lifetime import Life

REACH, DENSE = calfree_gym.ENV_IDS
SAC_SETTINGS = Path(__file__).parents[2] / "configs" / "agents" / "sac.yaml"


def servo() -> str:
    """The paper's servo, one trial in each of the wild worlds 0-199, physics, both mounts."""
    lines = ["unified_servo test_motions, wild worlds 0-199, one trial each, at most 50 motions"]
    for mount in calfree_gym.MOUNTS:
        records: list[TrialRecord] = []
        for seed in range(200):
            env = gym.make(REACH, camera_mount=mount, max_episode_steps=50)
            agent = agents.make("unified_servo", env, estimator="test_motions")
            records += evaluate(agent, env, trials=1, seed=seed)
        motions = [r.motions for r in records]
        lines.append(
            f"  {mount:6} success {np.mean([r.success for r in records]):.1%} (wanted 99.0%)"
            f"   median motions {np.median(motions):.0f} (16)   p95 {np.percentile(motions, 95):.0f}"
            f"   median distance {np.median([r.distance_mm for r in records]):.1f} mm (5)"
            f"   median robot time {np.median([r.robot_seconds for r in records]):.0f} s"
        )
    return "\n".join(lines)


def table(worlds: int = 10, trials: int = 400, before: int = 250) -> str:
    """grid_table, training trials in wild worlds, the left camera re-aimed by 20 degrees on the way."""
    schedule = [{"at": {"trial": before}, "do": {"type": "camera_aim", "camera": "left", "degrees": 20}}]
    lines = [
        f"grid_table, {worlds} wild worlds, {trials} training trials, re-aimed by 20 degrees at {before}"
    ]
    for mount in calfree_gym.MOUNTS:
        lives = []
        for seed in range(worlds):
            records: list[TrialRecord] = []
            env = gym.make(REACH, camera_mount=mount, perturbations=schedule)
            agent = agents.make("grid_table", Life(env, seed, records.append))
            agent.learn(trials * 60, callback=until(trials, records))
            lives.append(records)
        motions = np.array([[r.motions for r in life] for life in lives])
        success = np.array([[r.success for r in life] for life in lives])
        first, late = motions[:, :25].mean(), motions[:, before - 50 : before].mean()
        lines.append(
            f"  {mount:6} trials 1-25: {first:.2f} motions   {before - 49}-{before}: {late:.2f}"
            f"   ratio {late / first:.2f} (wanted 0.70)"
            f"   success {success[:, :before].mean():.1%}, then {success[:, before:].mean():.1%} (98.0%)"
        )
    return "\n".join(lines)


def until(trials: int, records: list[TrialRecord]) -> Callable[[Any], bool]:
    """A callback that ends a life with that trial."""
    return lambda progress: len(records) < trials


def sac(motions: int = 25_000, seeds: int = 2) -> str:
    """Sac in the nominal world on the waist mount, with the settings of configs/agents/sac.yaml."""
    settings: dict[str, Any] = read_yaml(SAC_SETTINGS)
    lines = [f"sac, nominal world, waist mount, {motions:,} motions, 200 held-out trials, tolerance 4 px"]
    for seed in range(seeds):
        env = gym.make(DENSE, world="nominal", dynamics="kinematic")
        env.reset(seed=seed)
        agent = agents.make("sac", env, seed=seed, **settings).learn(motions)
        held_out = gym.make(REACH, world="nominal")
        records = evaluate(agent, held_out, trials=200, seed=10_000 + seed)
        lines.append(
            f"  seed {seed}  success {np.mean([r.success for r in records]):.1%} (wanted 90.0%)"
            f"   mean motions {np.mean([r.motions for r in records]):.1f}"
            f"   within 16 px {np.mean([r.motions_to[16] is not None for r in records]):.1%}"
        )
    return "\n".join(lines)
