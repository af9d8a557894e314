"""What the controllers reach in worlds that none of them was tuned on, beside what is required of them."""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import product
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import pandas as pd

import agents
import calfree_gym
from agents.base.prior_knowledge import in_order
from calfree_gym.tasks.reach import PRIVILEGED
from experiments.benchmarks.trials import CAP, REACH, Lifetimes, each_alone, motions_per_reach, share_of
from experiments.evaluation import TrialRecord, evaluate
from experiments.reporting.tables import Table, beside, must_know
from experiments.running.lifetime import LifetimeRecorder, learn_trials
from experiments.statistics import mean_share, median_world

FIRST_WORLD = 1000


class Required(NamedTuple):
    """The least share of rendezvous, and the most motions, that are required; None where nothing is."""

    rendezvous: float | None = None
    median: int | None = None
    percentile_95: int | None = None


NOTHING = dict.fromkeys(calfree_gym.MOUNTS, Required())
FIRST = {"waist": Required(0.995, 7, 12), "stand": Required(0.995, 8, 15)}
LATER = {"waist": Required(None, 4, 8), "stand": Required(None, 5, 12)}

SERVOS: tuple[tuple[str, dict[str, Any], dict[str, Required]], ...] = (
    ("random", {}, NOTHING),
    ("oracle", {}, NOTHING),
    ("work_plane_servo", {}, dict.fromkeys(calfree_gym.MOUNTS, Required(0.99, 16))),
    *(
        ("paper_servo", settings, dict.fromkeys(calfree_gym.MOUNTS, required))
        for required in [Required(0.99, 14)]
        for settings in ({"redundancy": "omit"}, {"redundancy": "transform"}, {})
    ),
    *(
        ("jacobian_servo", {"estimator": estimator}, NOTHING)
        for estimator in ("broyden", "trust_region", "rls", "local")
    ),
    ("jacobian_servo", {}, FIRST),
    ("unified_servo", {}, FIRST),
    ("recurrent_servo", {}, dict.fromkeys(calfree_gym.MOUNTS, Required(0.99, 6))),
    ("joint_space_servo", {}, NOTHING),
    ("affine_stereo", {}, NOTHING),
)
"""Controllers, their settings, and what is required of them on each mount."""

ROLLED = ("jacobian_servo", "unified_servo", "paper_servo", "work_plane_servo", "recurrent_servo")
"""Controllers whose camera is rolled in mid-trial."""
LASTING = ("jacobian_servo", "unified_servo")
"""Servos that remember a Jacobian from one trial to the next, and average noise."""


class Trouble(NamedTuple):
    """What observations suffer from, for how many motions, and what is required at the end.

    Attributes:
        name: In the table.
        do: The perturbation.
        motions: Of a trial.
        error_px: The largest true error to end with.
        required: Share of the trials that must end so, on each mount.
    """

    name: str
    do: dict[str, Any]
    motions: int
    error_px: float
    required: dict[str, float]


TROUBLES = (
    Trouble(
        "4 px noise", {"type": "point_noise", "px": 4.0}, 60, 4.0, dict.fromkeys(calfree_gym.MOUNTS, 0.95)
    ),
    Trouble("20 px noise", {"type": "point_noise", "px": 20.0}, 60, 16.0, {"waist": 0.95, "stand": 0.85}),
    *(
        Trouble(name, do, motions, 5.5, dict.fromkeys(calfree_gym.MOUNTS, required))
        for name, do, motions, required in (
            ("40 % outliers", {"type": "point_outliers", "share": 0.4}, 120, 0.98),
            ("20 % outliers", {"type": "point_outliers", "share": 0.2}, 120, 0.99),
            ("30 % dropout", {"type": "point_dropout", "share": 0.3}, 60, 0.995),
            ("latency 1", {"type": "latency", "motions": 1}, 60, 0.995),
        )
    ),
)

_FORMATS = {
    "success": ".1%",
    "rendezvous": ".1%",
    "required rendezvous": ".1%",
    "median motions": ".0f",
    "required median": ".0f",
    "95th percentile": ".0f",
    "required 95th": ".0f",
    "median of more motions": ".0f",
    "µs a decision": ".0f",
}
_HOW_TO_READ = (
    "Success: the true error at the end is within the tolerance of 4 px; rendezvous: the last observation "
    f"was. Median and 95th percentile of motions, a trial without a rendezvous counting as {CAP}; median "
    "time of a decision. Brackets: 95 % intervals over worlds. Required: the fewest rendezvous, the most "
    "motions."
)


def controllers(worlds: int = 500) -> Iterator[Table]:
    """First trials in wild worlds, later ones in the same world, and trials in which a camera is rolled."""
    where = f"wild worlds {FIRST_WORLD}-{FIRST_WORLD + worlds - 1}, physics, 0.5 px noise, at most 60 motions"
    first = []
    for name, settings, required in SERVOS:
        for mount in calfree_gym.MOUNTS:
            agent = _Timed(name, mount, **settings)
            records = _first_trials(agent, mount, worlds)
            first.append(
                {**agent.named, **_reached(each_alone(records), mount, required[mount]), **agent.decision}
            )
    yield _table("first_trials", f"First trials, {where}", first)
    later = []
    for name in LASTING:
        for mount in calfree_gym.MOUNTS:
            lifetimes = [_lifetime(name, mount, seed, trials=4)[1:] for seed in _seeds(worlds)]
            later.append({"agent": name, **_reached(lifetimes, mount, LATER[mount])})
    yield _table("later_trials", "Trials 2-4 in the same world", later)
    rolled = [_rolled(_Timed(name, mount), mount, worlds) for name in ROLLED for mount in calfree_gym.MOUNTS]
    yield _table("rolled", "A camera rolled at motion 1-5", rolled)


def models(worlds: int = 500, identified: int = 100) -> Iterator[Table]:
    """The calibrated robot where its model is true, and the self-calibrating one in wild worlds."""
    rows = []
    for mount in calfree_gym.MOUNTS:
        agent = _Timed("model_based", mount, camera_mount=mount)
        records = _first_trials(agent, mount, worlds, world="nominal")
        rows.append(
            {
                "agent": agent.name,
                **_reached(each_alone(records), mount, Required(0.995, 2)),
                **agent.decision,
            }
        )
    yield _table("model_based", f"The calibrated robot, nominal world, {worlds} objects", rows)
    rows = []
    for mount in calfree_gym.MOUNTS:
        records = []
        for seed in _seeds(identified):
            env = gym.make(REACH, camera_mount=mount)
            env.reset(seed=seed)
            learned = agents.make("self_calibrating", env, camera_mount=mount).learn(60)
            records += evaluate(learned, env, trials=1, seed=seed)
        rows.append({"agent": "self_calibrating", **_reached(each_alone(records), mount, Required(0.95))})
    title = f"The self-calibrating robot, {identified} wild worlds: 60 motions of learning, then one trial"
    yield _table("self_calibrating", title, rows)


def robust(worlds: int = 200) -> Iterator[Table]:
    """Servos in trouble; no trial is ended for them, and the true error after the last motion counts."""
    rows = []
    for name, trouble, mount in product(LASTING, TROUBLES, calfree_gym.MOUNTS):
        records = _first_trials(
            _Timed(name, mount),
            mount,
            worlds,
            max_episode_steps=trouble.motions,
            terminate_on_success=False,
            perturbations=[{"at": {"trial": 0}, "do": trouble.do}],
        )
        within = [record.error_px <= trouble.error_px for record in records]
        rows.append(
            {
                "agent": name,
                "trouble": trouble.name,
                "mount": mount,
                "trials": len(records),
                "motions": trouble.motions,
                "within px": trouble.error_px,
                **beside("share", mean_share(np.array(within)), ".1%"),
                "required share": trouble.required[mount],
            }
        )
    yield Table(
        "robust",
        f"Bad observations, wild worlds {FIRST_WORLD}-{FIRST_WORLD + worlds - 1}, physics, nothing announced",
        pd.DataFrame(rows),
        {"share": ".1%", "required share": ".1%", "within px": "g"},
        "Share of the trials whose true error after the last motion is within this many pixels, with its "
        "95 % interval over worlds, one trial in each.",
    )


class _Timed:
    """An agent whose decisions are timed."""

    def __init__(self, name: str, mount: str, **settings: Any) -> None:
        self.name = name
        spaces = gym.make(REACH, camera_mount=mount, tell=tuple(PRIVILEGED))
        self.agent: Any = agents.make(name, spaces, **settings)
        self.seconds: list[float] = []
        self.named = {
            "agent": name,
            "settings": " ".join(settings.values()),
            "what it must know": must_know(self.agent.privileged, in_order(self.agent.prior_knowledge)),
        }

    def predict(self, *arguments: Any, **options: Any) -> tuple[Any, Any]:
        start = time.perf_counter()
        decision: tuple[Any, Any] = self.agent.predict(*arguments, **options)
        self.seconds.append(time.perf_counter() - start)
        return decision

    @property
    def decision(self) -> dict[str, float]:
        return {"µs a decision": 1e6 * float(np.median(self.seconds))}


def _table(name: str, title: str, rows: list[dict[str, Any]]) -> Table:
    frame = pd.DataFrame(rows)
    formats = {column: form for column, form in _FORMATS.items() if column in frame}
    return Table(name, title, frame.dropna(axis="columns", how="all"), formats, _HOW_TO_READ)


def _seeds(worlds: int) -> range:
    return range(FIRST_WORLD, FIRST_WORLD + worlds)


def _first_trials(agent: _Timed, mount: str, worlds: int, **options: Any) -> list[TrialRecord]:
    """One trial in each world, with nothing remembered."""
    env = gym.make(REACH, camera_mount=mount, tell=agent.agent.privileged, **options)
    return [record for seed in _seeds(worlds) for record in evaluate(agent, env, trials=1, seed=seed)]


def _lifetime(name: str, mount: str, seed: int, trials: int) -> list[TrialRecord]:
    """The first trials of a servo that remembers its Jacobian."""
    recorder = LifetimeRecorder(gym.make(REACH, camera_mount=mount), seed)
    return learn_trials(agents.make(name, recorder), recorder, trials)


def _rolled(agent: _Timed, mount: str, worlds: int) -> dict[str, Any]:
    """Trials in which a camera was rolled beside the same trials in which none was."""
    records, more = [], []
    for record, rolled in _pairs(agent, mount, worlds):
        records.append(rolled)
        more.append(rolled.motions_per_reach(CAP) - record.motions_per_reach(CAP))
    reached = _reached(each_alone(records), mount, Required(0.99))
    found = median_world(np.array(more))
    return {**agent.named, **reached, **beside("median of more motions", found, ".0f"), "required more": 4}


def _pairs(agent: _Timed, mount: str, worlds: int) -> Iterator[tuple[TrialRecord, TrialRecord]]:
    quiet = _first_trials(agent, mount, worlds)
    schedules = [[{"at": {"motion": k}, "do": {"type": "camera_roll"}}] for k in range(1, 6)]
    envs = [gym.make(REACH, camera_mount=mount, perturbations=schedule) for schedule in schedules]
    for record, seed in zip(quiet, _seeds(worlds), strict=True):
        k = 1 + seed % 5
        if record.motions > k:
            yield record, evaluate(agent, envs[k - 1], trials=1, seed=seed)[0]


def _reached(lifetimes: Lifetimes, mount: str, required: Required) -> dict[str, Any]:
    """What trials came to; one list a world, all of the same length."""
    motions = motions_per_reach(lifetimes)
    return {
        "mount": mount,
        "trials": motions.size,
        **share_of("rendezvous", lifetimes, ".1%"),
        "required rendezvous": required.rendezvous,
        **share_of("success", lifetimes, ".1%"),
        "median motions": np.median(motions),
        "required median": required.median,
        "95th percentile": np.quantile(motions, 0.95, method="averaged_inverted_cdf"),
        "required 95th": required.percentile_95,
    }
