"""How often the intervals of `experiments.statistics` hold the truth, by simulation."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from experiments.reporting.tables import Table
from experiments.statistics import (
    Array,
    Estimate,
    mean_share,
    median_time,
    median_world,
    paired_motions,
    paired_shares,
    share_of_worlds,
)

CAP = 60
TRIALS = 20
WORLDS = (20, 50)
HORIZON = 10_000.0
"""Lifetime motions after which the simulated runs end."""
EPS = 1e-9
"""Of sums of floating-point numbers."""

Draw = Callable[[np.random.Generator, tuple[int, int]], Array]

SUCCESS: dict[str, Draw] = {
    "worlds alike, 90 %": lambda rng, size: np.full(size, 0.9),
    "beta(8, 2)": lambda rng, size: rng.beta(8, 2, size),
    "beta(99, 1)": lambda rng, size: rng.beta(99, 1, size),
    "beta(0.9, 0.1)": lambda rng, size: rng.beta(0.9, 0.1, size),
    "one in ten 30 %, others 98 %": lambda rng, size: np.where(rng.random(size) < 0.1, 0.3, 0.98),
    "one in ten 50 %, others 100 %": lambda rng, size: np.where(rng.random(size) < 0.1, 0.5, 1.0),
}
"""Rates at which trials succeed in simulated worlds, by the name of the design."""
BAD_FOR_ONE = "one in ten 50 %, others 100 %, for one agent alone"


def _trials(rng: np.random.Generator, design: str, size: tuple[int, int]) -> tuple[Array, Array]:
    """Success and motions of an agent and a slower one in the same worlds (samples, worlds, agents, trials).

    Motions are skewed, of 1 to some 10, and the cap where a trial fails. Worlds differ in the rate at which
    trials succeed, and in how many motions a trial has beyond the first.
    """
    typical = 2 * np.exp(0.4 * rng.normal(size=size))
    if design == BAD_FOR_ONE:
        rates = np.ones(size), SUCCESS["one in ten 50 %, others 100 %"](rng, size)
    else:
        rates = (SUCCESS[design](rng, size),) * 2
    found = []
    for rate, more in zip(rates, (typical, 1.5 * typical), strict=True):
        success = rng.random((*size, TRIALS)) < rate[..., None]
        motions = 1 + np.round(rng.gamma(1.5, more[..., None] / 1.5, (*size, TRIALS)))
        found.append((success.astype(float), np.where(success, np.minimum(motions, CAP), CAP)))
    successes, motions = (np.stack(each, axis=2) for each in zip(*found, strict=True))
    return successes, motions


def _shares(rng: np.random.Generator, design: str, size: tuple[int, int]) -> Array:
    return np.asarray(_trials(rng, design, size)[0].mean(axis=3))


def _motions(rng: np.random.Generator, design: str, size: tuple[int, int]) -> Array:
    """A failure counting as the cap."""
    return np.asarray(_trials(rng, design, size)[1].mean(axis=3))


def _of_those_that_reached(rng: np.random.Generator, design: str, size: tuple[int, int]) -> Array:
    """Of the first agent; NaN in a world in which no trial did."""
    success, motions = (each[:, :, 0] for each in _trials(rng, design, size))
    reached, sums = success.sum(axis=2), (motions * success).sum(axis=2)
    return np.divide(sums, reached, out=np.full(size, np.nan), where=reached > 0)


NEVER = {"all reach it": 0.0, "one in ten never": 0.1}
"""Share of the worlds that never come to a threshold, by the name of the design."""


def _times(rng: np.random.Generator, design: str, size: tuple[int, int]) -> Array:
    """When a world comes to a threshold or its run ends, whether it came, and when it would.

    One run in five ends early.
    """
    times = np.where(rng.random(size) < NEVER[design], np.inf, np.exp(rng.normal(7.0, 0.8, size)))
    ends = HORIZON * np.where(rng.random(size) < 0.2, rng.uniform(0.5, 1.0, size), 1.0)
    return np.stack([np.minimum(times, ends), times <= ends, times], axis=-1)


@dataclass(frozen=True, slots=True)
class CoverageStudy:
    """An estimand whose interval is tried.

    Attributes:
        estimand: Its name.
        sample: From a design and (samples, worlds) to what worlds come to (samples, worlds, ...).
        interval: From what the worlds of one sample come to, to the interval.
        truth: From what a population of worlds comes to (worlds, ...) to the number itself.
        designs: Names of the designs of worlds.
    """

    estimand: str
    sample: Callable[[np.random.Generator, str, tuple[int, int]], Array]
    interval: Callable[[Array], Estimate]
    truth: Callable[[Array], float]
    designs: Sequence[str] = tuple(SUCCESS)


def _fewer(motions: Array) -> Array:
    """By how many motions the first agent needs fewer than the second."""
    return np.asarray(motions[:, 1] - motions[:, 0])


_BOTH = (*SUCCESS, BAD_FOR_ONE)
STUDIES = (
    CoverageStudy(
        "share of rendezvous",
        _shares,
        lambda shares: mean_share(shares[:, 0]),
        lambda shares: float(shares[:, 0].mean()),
    ),
    CoverageStudy(
        "difference of shares",
        _shares,
        lambda shares: paired_shares(shares[:, 1], shares[:, 0]),
        lambda shares: float(np.diff(shares).mean()),
        _BOTH,
    ),
    CoverageStudy(
        "motions of trials that reached, median world",
        _of_those_that_reached,
        median_world,
        lambda motions: float(np.nanmedian(motions)),
    ),
    CoverageStudy(
        "motions per reach, median world",
        _motions,
        lambda motions: median_world(motions[:, 0]),
        lambda motions: float(np.median(motions[:, 0])),
    ),
    CoverageStudy(
        "difference of motions, median world",
        _motions,
        lambda motions: paired_motions(motions[:, 1], motions[:, 0]),
        lambda motions: float(np.median(_fewer(motions))),
        _BOTH,
    ),
    CoverageStudy(
        "share of worlds with fewer motions",
        _motions,
        lambda motions: share_of_worlds(motions[:, 0], motions[:, 1]),
        lambda motions: float(np.mean((_fewer(motions) > 0) + 0.5 * (_fewer(motions) == 0))),
        _BOTH,
    ),
    CoverageStudy(
        "motions lived until 95 %, median world",
        _times,
        lambda times: median_time(times[:, 0], times[:, 1] > 0),
        lambda times: float(np.median(times[:, 2])),
        tuple(NEVER),
    ),
)


def tables(
    samples: int = 1_000,
    studies: Sequence[CoverageStudy] = STUDIES,
    sizes: Sequence[int] = WORLDS,
    population: int = 100_000,
) -> Iterator[Table]:
    """Each estimand in each design: samples of worlds, and a population that the truth is taken of."""
    rows = []
    for study in studies:
        for design in study.designs:
            truth = study.truth(study.sample(np.random.default_rng(1), design, (1, population))[0])
            row: dict[str, Any] = {"estimand": study.estimand, "worlds that differ": design}
            for worlds in sizes:
                drawn = study.sample(np.random.default_rng(2), design, (samples, worlds))
                found = [study.interval(sample) for sample in drawn]
                row[f"{worlds} worlds"] = np.mean([e.low - EPS <= truth <= e.high + EPS for e in found])
                if worlds == sizes[0]:
                    row["width"] = np.median([e.high - e.low for e in found])
            rows.append(row)
    columns = ["estimand", "worlds that differ", *(f"{worlds} worlds" for worlds in sizes), "width"]
    yield Table(
        "coverage",
        "How often 95 % intervals hold the truth",
        pd.DataFrame(rows, columns=columns),
        {**{f"{worlds} worlds": ".1%" for worlds in sizes}, "width": ".3g"},
        f"Share of {samples:,} simulated samples whose interval holds the truth, which is that of "
        f"{population:,} simulated worlds. {TRIALS} trials a world; a trial that fails counts as {CAP} "
        f"motions. Width: the median one with {sizes[0]} worlds.",
    )
