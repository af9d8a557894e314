"""Which constants matter: each one halved and doubled, in wild worlds that nobody tuned on.

Nothing is changed by what is found: a table lists it. Base and variations meet the same worlds, objects and
noise, so that differences are paired.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from calfree_gym import MOUNTS
from experiments.benchmarks.sensitivity.constants import MODULES, constants
from experiments.benchmarks.sensitivity.trials import CONDITIONS, Sizes, Task, Variation, carry_out
from experiments.reporting.tables import Table
from experiments.statistics import Estimate, mean_estimate, relative_change

Array = NDArray[np.float64]

FIRST_WORLD = 5000
"""`unified_servo` and `memory` were not tuned on worlds from here on; `benchmark priors` uses them, too."""
FACTORS = (0.5, 2.0)
MOTIONS, SUCCESS = 0.05, 0.01
"""Changes of motions (a share) and of success (one point) that are too small to matter."""


def tables(worlds: int = 20, sizes: Sizes | None = None, only: Collection[str] = ()) -> Iterator[Table]:
    """The table of `sensitivity`, for people."""
    sizes = sizes or Sizes()
    short = "" if worlds >= 20 else " A short run, which only shows what the table looks like."
    yield Table(
        "constants",
        "Each constant of unified_servo and memory, halved and doubled",
        readable(sensitivity(worlds, sizes, only)),
        {},
        f"Wild worlds {FIRST_WORLD}-{FIRST_WORLD + worlds - 1}, by turns on stand and waist, kinematic; each "
        f"{sizes.first} first and {sizes.later} later trials, {sizes.trouble} in each kind of trouble, a "
        f"lifetime of {sizes.lifetime} trials; paired 95 % t intervals over worlds.{short}",
    )


def sensitivity(
    worlds: int = 20,
    sizes: Sizes | None = None,
    only: Collection[str] = (),
    jobs: int | None = None,
) -> pd.DataFrame:
    """What halving and doubling each constant does; one row a constant and factor.

    Args:
        worlds: How many, at least 2; from `FIRST_WORLD` on.
        sizes: Trials; the default takes some 15 minutes on two cores.
        only: Labels of constants to vary; all where it is empty.
        jobs: Processes, each with one thread; two where there are this many cores.

    Returns:
        The columns agent, constant, value, source, factor, tried, condition (that with the clearest change),
        motions (%) and success (points) with the ends of their 95 % intervals, differing (the share of all
        trials, in %, that came out otherwise) and verdict.
    """
    found = effects(worlds, sizes, only, jobs)
    rank = found["verdict"].map(VERDICTS.index)
    order = found.assign(rank=rank, size=-found["motions"].abs()).sort_values(["rank", "size"], kind="stable")
    key = ["agent", "constant", "factor"]
    clearest = order.drop_duplicates(key).sort_index()
    shares = found.groupby(key, sort=False)["differing"].mean().rename("differing")
    return (
        clearest.drop(columns=["rank", "size", "differing"])
        .merge(shares, on=key, sort=False)[COLUMNS]
        .reset_index(drop=True)
    )


def readable(found: pd.DataFrame) -> pd.DataFrame:
    """A table for people: each change and its interval in one column of text."""
    shown = found[COLUMNS[:7]].assign(value=found["value"].map("{:g}".format))
    shown["tried"] = found["tried"].map("{:.3g}".format)
    for name, unit in (("motions", "%"), ("success", "points")):
        parts = found[[name, f"{name} low", f"{name} high"]].to_numpy()
        shown[f"{name}, {unit}"] = [f"{value:+.1f} [{low:+.1f}, {high:+.1f}]" for value, low, high in parts]
    shown["differing, %"] = found["differing"].map("{:.0f}".format)
    return shown.assign(verdict=found["verdict"])


COLUMNS = [
    *("agent", "constant", "value", "source", "factor", "tried", "condition"),
    *("motions", "motions low", "motions high", "success", "success low", "success high"),
    *("differing", "verdict"),
]
VERDICTS = ("raises an error", "sensitive", "not shown", "insensitive", "no trial differed")
"""The clearest first."""


def effects(
    worlds: int = 20,
    sizes: Sizes | None = None,
    only: Collection[str] = (),
    jobs: int | None = None,
) -> pd.DataFrame:
    """As `sensitivity`, one row a constant, factor and condition."""
    start = time.perf_counter()
    sizes = sizes or Sizes()
    jobs = jobs or min(2, len(os.sched_getaffinity(0)))
    variations = {
        agent: tuple(
            Variation(each, each.times(factor))
            for each in constants(agent)
            for factor in FACTORS
            if (not only or each.label in only) and each.times(factor) != each.value
        )
        for agent in MODULES
    }
    tasks = [
        Task(agent, condition, seed, MOUNTS[seed % len(MOUNTS)], sizes, (Variation(), *variations[agent]))
        for agent in reversed(MODULES)
        if variations[agent]
        for condition in CONDITIONS[agent]
        for seed in range(FIRST_WORLD, FIRST_WORLD + worlds)
    ]
    runs = sum(len(task.variations) for task in tasks)
    _tell(f"{runs:,} runs in {len(tasks)} parts; planned: {_planned(tasks, jobs):.1f} minutes")
    results: dict[Task, Array] = {}
    with _mapped(jobs) as each:
        for i, (task, result) in enumerate(each(carry_out, tasks), 1):
            results[task] = result
            if i % 20 == 0 or i == len(tasks):
                _tell(f"{i} of {len(tasks)} parts after {(time.perf_counter() - start) / 60:.1f} minutes")
    return pd.DataFrame(
        row
        for agent, own in variations.items()
        for i, variation in enumerate(own, 1)
        for row in _rows(agent, variation, i, results)
    )


def _rows(agent: str, variation: Variation, i: int, results: dict[Task, Array]) -> Iterator[dict[str, Any]]:
    """The rows of the i-th variation."""
    constant = variation.constant
    assert constant is not None
    for condition in CONDITIONS[agent]:
        own = [task for task in results if (task.agent, task.condition) == (agent, condition)]
        own.sort(key=lambda task: task.seed)
        found = np.array([results[task] for task in own])
        base, changed = found[:, 0], found[:, i]  # (worlds, trials, motions and success)
        differing = 100 * float((base != changed).any(-1).mean())
        yield {
            "agent": agent,
            "constant": constant.label,
            "value": constant.value,
            "source": constant.source,
            "factor": FACTORS[int(variation.value > constant.value)],
            "tried": variation.value,
            "condition": condition,
            **judged(base.mean(1), changed.mean(1)),
            "differing": differing,
            **({} if differing else {"verdict": VERDICTS[-1]}),
        }


def judged(base: Array, changed: Array) -> dict[str, Any]:
    """Changes from `base` to `changed`, each motions and success (worlds, 2), with intervals and verdict.

    Worlds are the units: trials in one world are averaged before.
    """
    if np.isnan(changed).any():
        return {**dict.fromkeys(COLUMNS[7:13], np.nan), "verdict": VERDICTS[0]}
    motions = relative_change(base[:, 0], changed[:, 0])
    success = mean_estimate(changed[:, 1] - base[:, 1])
    numbers = [100 * part for each in (motions, success) for part in (each.value, each.low, each.high)]
    return {**dict(zip(COLUMNS[7:13], numbers, strict=True)), "verdict": verdict(motions, success)}


def verdict(motions: Estimate, success: Estimate) -> str:
    """What the intervals of both changes show, as shares of 1."""
    both = ((motions, MOTIONS), (success, SUCCESS))
    if any(change.low > limit or change.high < -limit for change, limit in both):
        return "sensitive"
    if all(-limit <= change.low and change.high <= limit for change, limit in both):
        return "insensitive"
    return "not shown"


def _planned(tasks: list[Task], jobs: int) -> float:
    """Minutes that the tasks will take, by the first trials of the base in one world."""
    minutes = 0.0
    for agent, conditions in CONDITIONS.items():
        for condition in conditions:
            own = [task for task in tasks if (task.agent, task.condition) == (agent, condition)]
            if own:
                start = time.perf_counter()
                carry_out(Task(agent, condition, own[0].seed, own[0].mount, own[0].sizes, (Variation(),)))
                runs = sum(len(task.variations) for task in own)
                minutes += (time.perf_counter() - start) * runs / jobs / 60
    return minutes


@contextmanager
def _mapped(jobs: int) -> Iterator[Callable[..., Iterable[tuple[Task, Array]]]]:
    """Maps tasks over fresh processes of one thread each; in this process where there is one job."""
    if jobs == 1:
        yield map
        return
    one_thread = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    before = {name: os.environ.get(name) for name in one_thread}
    os.environ.update(one_thread)
    try:
        with multiprocessing.get_context("spawn").Pool(jobs) as pool:
            yield pool.imap_unordered
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _tell(text: str) -> None:
    print(f"sensitivity: {text}", file=sys.stderr, flush=True)
