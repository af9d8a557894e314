"""What the agents reach, measured: the servo, the table and SAC against what is required of them."""

from __future__ import annotations

from collections.abc import Iterator

import gymnasium as gym
import numpy as np
import pandas as pd

import agents
import calfree_gym
from experiments.benchmarks.trials import CAP, DENSE, REACH, each_alone, motions_per_reach, share_of
from experiments.evaluation import TrialRecord, evaluate
from experiments.reporting.tables import Table, beside
from experiments.running.lifetime import LifetimeRecorder, learn_trials
from experiments.statistics import Estimate, mean_share, median_world, relative_change

SHARES = ("rendezvous", "success")
"""Of trials: an observed rendezvous, and a true error within the tolerance."""


def servo(worlds: int = 200) -> Iterator[Table]:
    """The paper's servo, one trial in each of some wild worlds, physics, both mounts."""
    rows = []
    for mount in calfree_gym.MOUNTS:
        records: list[TrialRecord] = []
        for seed in range(worlds):
            env = gym.make(REACH, camera_mount=mount, max_episode_steps=50)
            agent = agents.make("paper_servo", env)
            records += evaluate(agent, env, trials=1, seed=seed)
        motions = np.array([r.motions_per_reach(50) for r in records])
        rows.append(
            {
                "mount": mount,
                **share_of("rendezvous", each_alone(records), ".1%"),
                "required rendezvous": 0.99,
                **share_of("success", each_alone(records), ".1%"),
                **beside("median motions", median_world(motions), ".0f"),
                "required median": 16,
                "95th percentile": np.quantile(motions, 0.95, method="averaged_inverted_cdf"),
                "median distance (mm)": np.median([r.distance_mm for r in records]),
                "required distance (mm)": 5.0,
                "median robot time (s)": np.median([r.robot_seconds for r in records]),
            }
        )
    yield Table(
        "servo",
        f"paper_servo, wild worlds 0-{worlds - 1}, one trial each, at most 50 motions",
        pd.DataFrame(rows),
        {
            **dict.fromkeys(("rendezvous", "success", "required rendezvous"), ".1%"),
            "median motions": ".0f",
            "95th percentile": ".0f",
            "median distance (mm)": ".1f",
            "required distance (mm)": ".1f",
            "median robot time (s)": ".0f",
        },
        "Success: true error within 4 px. A trial without a rendezvous counts as 50 motions. Robot time: "
        "with 4 s a look. 95 % intervals over worlds.",
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
        motions = motions_per_reach(lifetimes)
        reached = np.array([[r.rendezvous for r in records] for records in lifetimes])
        first, late = motions[:, :25].mean(axis=1), motions[:, before - 50 : before].mean(axis=1)
        less = relative_change(first, late)
        ratio = Estimate(1 + less.value, 1 + less.low, 1 + less.high)
        rows.append(
            {
                "mount": mount,
                **beside("motions in trials 1-25", median_world(first), ".2f"),
                **beside(f"in {before - 49}-{before}", median_world(late), ".2f"),
                **beside("ratio", ratio, ".2f"),
                "required ratio": 0.7,
                **beside("rendezvous before the change", mean_share(reached[:, :before]), ".1%"),
                **beside("rendezvous after it", mean_share(reached[:, before:]), ".1%"),
                "required rendezvous": 0.98,
            }
        )
    frame = pd.DataFrame(rows)
    numbers = ("motions in trials 1-25", f"in {before - 49}-{before}", "ratio", "required ratio")
    shares = ("rendezvous before the change", "rendezvous after it", "required rendezvous")
    yield Table(
        "table",
        f"grid_table, {worlds} wild worlds, {trials} training trials, re-aimed by 20 degrees at {before}",
        frame,
        {**dict.fromkeys(numbers, ".2f"), **dict.fromkeys(shares, ".1%")},
        f"Motions per reach of the median world; a trial without a rendezvous counts as {CAP}. Ratio: of the "
        "means over worlds.",
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
                **share_of("rendezvous", each_alone(records), ".1%"),
                "required rendezvous": 0.9,
                **share_of("success", each_alone(records), ".1%"),
                "mean motions": np.mean([r.motions_per_reach(CAP) for r in records]),
                "within 16 px": np.mean([r.motions_to[16] is not None for r in records]),
            }
        )
    yield Table(
        "sac",
        f"sac, nominal world, waist mount, {motions:,} motions, {trials} held-out trials, tolerance 4 px",
        pd.DataFrame(rows),
        {
            **dict.fromkeys(("rendezvous", "success", "required rendezvous", "within 16 px"), ".1%"),
            "mean motions": ".1f",
        },
        f"One world: intervals are over its objects. A trial without a rendezvous counts as {CAP} motions.",
    )
