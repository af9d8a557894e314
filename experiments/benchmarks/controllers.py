"""What the controllers reach in worlds that none of them was tuned on, beside what is asked of them."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import numpy as np

import agents
import calfree_gym
from calfree_gym.envs.goal import PRIVILEGED
from experiments.evaluation import TrialRecord, evaluate
from experiments.running.lifetime import Life

REACH, _ = calfree_gym.ENV_IDS
FIRST_WORLD = 1000

SERVOS: tuple[tuple[str, dict[str, Any], str], ...] = (
    ("work_plane_servo", {}, "99 %, 16"),
    ("unified_servo", {"estimator": "test_motions", "redundancy": "omit"}, "99 %, 14"),
    ("unified_servo", {"estimator": "test_motions", "redundancy": "transform"}, "99 %, 14"),
    ("unified_servo", {"estimator": "test_motions"}, "99 %, 14"),
    ("unified_servo", {"estimator": "broyden"}, ""),
    ("unified_servo", {"estimator": "trust_region"}, ""),
    ("unified_servo", {"estimator": "rls"}, ""),
    ("unified_servo", {"estimator": "local"}, ""),
    ("unified_servo", {}, "99.5 %, 7 / 8, 12 / 15"),
    ("joint_space_servo", {}, ""),
    ("affine_stereo", {}, ""),
)
"""Controllers, their settings, and what is asked of them: success, median motions, p95 (waist / stand)."""

TROUBLES: tuple[tuple[str, dict[str, Any], int, float, str], ...] = (
    ("20 px noise", {"type": "point_noise", "px": 20.0}, 60, 16.0, "95 % / 85 %"),
    ("40 % outliers", {"type": "point_outliers", "share": 0.4}, 120, 5.5, "98 %"),
    ("20 % outliers", {"type": "point_outliers", "share": 0.2}, 120, 5.5, "99 %"),
    ("30 % dropout", {"type": "point_dropout", "share": 0.3}, 60, 5.5, "99.5 %"),
    ("latency 1", {"type": "latency", "motions": 1}, 60, 5.5, "99.5 %"),
)
"""What looks suffer from, for how many motions, the largest error in px to end with, and the share asked."""


def controllers(worlds: int = 500) -> str:
    """First trials in wild worlds, later ones in the same world, and trials in which a camera is rolled."""
    lines = [
        f"wild worlds {FIRST_WORLD}-{FIRST_WORLD + worlds - 1}, physics, 0.5 px noise, at most 60 motions",
        "success by the truth, median and 95th percentile of motions, median microseconds a decision",
    ]
    for name, settings, asked in SERVOS:
        for mount in calfree_gym.MOUNTS:
            agent = _Timed(name, mount, **settings)
            label = " ".join([name, *settings.values()])
            lines.append(
                f"  {label:40} {mount:6} {_of(_first_trials(agent, mount, worlds))}  {agent}  {asked}"
            )
    lines.append("later trials 2-4 in the same world (asked: median 4 / 5, p95 8 / 12)")
    for mount in calfree_gym.MOUNTS:
        later = [record for seed in _seeds(worlds) for record in _life(mount, seed, trials=4)[1:]]
        lines.append(f"  {'unified_servo':40} {mount:6} {_of(later)}")
    lines.append("a camera rolled at motion 1-5 (asked: 99 %, median of motions more than unrolled 4)")
    for name, settings in (
        ("unified_servo", {}),
        ("unified_servo", {"estimator": "test_motions"}),
        ("work_plane_servo", {}),
    ):
        for mount in calfree_gym.MOUNTS:
            label = " ".join([name, *settings.values()])
            lines.append(f"  {label:40} {mount:6} {_rolled(_Timed(name, mount, **settings), mount, worlds)}")
    return "\n".join(lines)


def models(worlds: int = 500, identified: int = 100) -> str:
    """The calibrated robot where its model is true, and the self-calibrating one in wild worlds."""
    lines = [f"model_based, nominal world, {worlds} objects (asked: 99.5 %, at most 2 motions)"]
    for mount in calfree_gym.MOUNTS:
        agent = _Timed("model_based", mount, camera_mount=mount)
        lines.append(f"  {mount:6} {_of(_first_trials(agent, mount, worlds, world='nominal'))}  {agent}")
    lines.append(f"self_calibrating, {identified} wild worlds: 60 motions of learning, then one trial (95 %)")
    for mount in calfree_gym.MOUNTS:
        records = []
        for seed in _seeds(identified):
            env = gym.make(REACH, camera_mount=mount)
            env.reset(seed=seed)
            learned = agents.make("self_calibrating", env, camera_mount=mount).learn(60)
            records += evaluate(learned, env, trials=1, seed=seed)
        lines.append(f"  {mount:6} {_of(records)}")
    return "\n".join(lines)


def robust(worlds: int = 500) -> str:
    """unified_servo in trouble; no trial is ended for it, and the true error after the last motion counts."""
    lines = [f"unified_servo, wild worlds {FIRST_WORLD}-{FIRST_WORLD + worlds - 1}, physics, nothing told"]
    for label, do, motions, error_px, asked in TROUBLES:
        shares = []
        for mount in calfree_gym.MOUNTS:
            records = _first_trials(
                _Timed("unified_servo", mount),
                mount,
                worlds,
                max_episode_steps=motions,
                terminate_on_success=False,
                perturbations=[{"at": {"trial": 0}, "do": do}],
            )
            shares.append(np.mean([record.error_px <= error_px for record in records]))
        lines.append(
            f"  {label:14} within {error_px:4} px after {motions:3} motions: "
            f"{shares[0]:.1%} / {shares[1]:.1%} (waist / stand; asked {asked})"
        )
    return "\n".join(lines)


class _Timed:
    """An agent whose decisions are timed."""

    def __init__(self, name: str, mount: str, **settings: Any) -> None:
        spaces = gym.make(REACH, camera_mount=mount, tell=tuple(PRIVILEGED))
        self.agent: Any = agents.make(name, spaces, **settings)
        self.seconds: list[float] = []

    def predict(self, *arguments: Any, **options: Any) -> tuple[Any, Any]:
        start = time.perf_counter()
        decision: tuple[Any, Any] = self.agent.predict(*arguments, **options)
        self.seconds.append(time.perf_counter() - start)
        return decision

    def __str__(self) -> str:
        return f"{1e6 * np.median(self.seconds):4.0f} us"


def _seeds(worlds: int) -> range:
    return range(FIRST_WORLD, FIRST_WORLD + worlds)


def _first_trials(agent: _Timed, mount: str, worlds: int, **options: Any) -> list[TrialRecord]:
    """One trial in each world, with nothing remembered."""
    env = gym.make(REACH, camera_mount=mount, tell=agent.agent.told, **options)
    return [record for seed in _seeds(worlds) for record in evaluate(agent, env, trials=1, seed=seed)]


def _life(mount: str, seed: int, trials: int) -> list[TrialRecord]:
    """The first trials of a servo that remembers its Jacobian."""
    records: list[TrialRecord] = []
    life = Life(gym.make(REACH, camera_mount=mount), seed, records.append)
    agents.make("unified_servo", life).learn(60 * trials, callback=lambda _: len(records) < trials)
    return records


def _rolled(agent: _Timed, mount: str, worlds: int) -> str:
    """Trials in which a camera was rolled beside the same trials in which none was."""
    records, more = [], []
    for record, rolled in _pairs(agent, mount, worlds):
        records.append(rolled)
        more.append(rolled.motions - record.motions)
    return f"{_of(records)}   {np.median(more):3.0f} more, in {len(more)} trials"


def _pairs(agent: _Timed, mount: str, worlds: int) -> Iterator[tuple[TrialRecord, TrialRecord]]:
    quiet = _first_trials(agent, mount, worlds)
    schedules = [[{"at": {"motion": k}, "do": {"type": "camera_roll"}}] for k in range(1, 6)]
    envs = [gym.make(REACH, camera_mount=mount, perturbations=schedule) for schedule in schedules]
    for record, seed in zip(quiet, _seeds(worlds), strict=True):
        k = 1 + seed % 5
        if record.motions > k:
            yield record, evaluate(agent, envs[k - 1], trials=1, seed=seed)[0]


def _of(records: list[TrialRecord]) -> str:
    motions = [record.motions for record in records]
    return (
        f"{np.mean([record.success for record in records]):6.1%}  {np.median(motions):3.0f} "
        f"{np.percentile(motions, 95):3.0f}"
    )
