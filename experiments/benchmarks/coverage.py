"""How often the intervals of `experiments.statistics` hold the truth, by simulation."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from experiments.reporting.tables import Table
from experiments.statistics import (
    SHARE,
    Array,
    Estimand,
    Estimate,
    bands,
    interquartile_mean,
    lowest_decile,
    mean,
    median,
    median_time,
    paired_difference,
    probability_of_improvement,
    quantile,
    restricted_mean_time,
    worst_decile,
)

CAP = 60
TRIALS = 20
WORLDS = (4, 10, 20)
HORIZON = 10_000.0
"""Lifetime motions after which the simulated runs end."""

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


@dataclass(frozen=True, slots=True)
class Simulated:
    """Trials of one agent in simulated worlds, each of shape (samples, worlds, trials)."""

    success: Array
    motions: Array


def simulated(
    rng: np.random.Generator, rates: Array, typical: Array, trials: int, slower: float = 1.0
) -> Simulated:
    """Trials: skewed motions of 1 to some 10, and the cap where one fails.

    Args:
        rng: Draws the trials.
        rates: Of success (samples, worlds).
        typical: Motions of a trial beyond the first (samples, worlds).
        trials: In each world.
        slower: What the typical motions are multiplied by.
    """
    size = (*rates.shape, trials)
    success = rng.random(size) < rates[..., None]
    motions = 1 + np.round(rng.gamma(1.5, slower * typical[..., None] / 1.5, size))
    return Simulated(success.astype(float), np.where(success, np.minimum(motions, CAP), CAP))


def _agents(
    rng: np.random.Generator, design: str, size: tuple[int, int], trials: int
) -> tuple[Simulated, Simulated]:
    """An agent and a slower one in the same worlds."""
    typical = 2 * np.exp(0.4 * rng.normal(size=size))
    if design == BAD_FOR_ONE:
        first, second = np.ones(size), SUCCESS["one in ten 50 %, others 100 %"](rng, size)
    else:
        first = second = SUCCESS[design](rng, size)
    return simulated(rng, first, typical, trials), simulated(rng, second, typical, trials, slower=1.5)


def _success(rng: np.random.Generator, design: str, size: tuple[int, int]) -> Array:
    return np.asarray(_agents(rng, design, size, TRIALS)[0].success.mean(axis=2))


def _motions(rng: np.random.Generator, design: str, size: tuple[int, int]) -> Array:
    return np.asarray(_agents(rng, design, size, TRIALS)[0].motions.mean(axis=2))


def _one_trial(rng: np.random.Generator, design: str, size: tuple[int, int]) -> Array:
    return _agents(rng, design, size, 1)[0].motions[:, :, 0]


def _both(rng: np.random.Generator, design: str, size: tuple[int, int]) -> Array:
    return np.stack([agent.motions.mean(axis=2) for agent in _agents(rng, design, size, TRIALS)], axis=-1)


def _more_motions(rng: np.random.Generator, design: str, size: tuple[int, int]) -> Array:
    return np.asarray(np.diff(_both(rng, design, size), axis=-1)[..., 0])


def _more_success(rng: np.random.Generator, design: str, size: tuple[int, int]) -> Array:
    first, second = (agent.success.mean(axis=2) for agent in _agents(rng, design, size, TRIALS))
    return np.asarray(second - first)


def _in_more(rng: np.random.Generator, design: str, size: tuple[int, int]) -> Array:
    more = _more_motions(rng, design, size)
    return (more > 0) + 0.5 * (more == 0)


NEVER = {"all reach it": 0.0, "one in ten never": 0.1, "half never": 0.5}
"""Share of the worlds that never come to a threshold, by the name of the design."""


def _times(rng: np.random.Generator, design: str, size: tuple[int, int]) -> Array:
    """When a world comes to a threshold or its run ends, whether it came, and when it would.

    One run in five ends early.
    """
    times = np.where(rng.random(size) < NEVER[design], np.inf, np.exp(rng.normal(7.0, 0.8, size)))
    ends = HORIZON * np.where(rng.random(size) < 0.2, rng.uniform(0.5, 1.0, size), 1.0)
    return np.stack([np.minimum(times, ends), times <= ends, times], axis=-1)


@dataclass(frozen=True, slots=True)
class Study:
    """An estimand whose interval is tried.

    Attributes:
        estimand: Its name.
        designs: Names of the designs of worlds.
        sample: From a design and (samples, worlds) to what worlds come to (samples, worlds, ...).
        intervals: From that to one interval a sample.
        truth: From what a population of worlds comes to (worlds, ...) to the number itself.
    """

    estimand: str
    designs: Sequence[str]
    sample: Callable[[np.random.Generator, str, tuple[int, int]], Array]
    intervals: Callable[[Array, np.random.Generator], list[Estimate]]
    truth: Callable[[Array], float]


def _of_worlds(
    name: str,
    sample: Callable[[np.random.Generator, str, tuple[int, int]], Array],
    estimand: Estimand,
    bounds: tuple[float, float],
    *more_designs: str,
) -> Study:
    """A study of an estimand of the worlds' own numbers."""
    return Study(
        name,
        (*SUCCESS, *more_designs),
        sample,
        lambda samples, rng: bands(samples.T, estimand, bounds, rng),
        lambda population: float(estimand(population, np.full((1, len(population)), 1 / len(population)))[0]),
    )


def _different_worlds(population: Array) -> float:
    first, second = population[:, 0], np.roll(population[:, 1], 1)
    return float(np.mean((second > first) + 0.5 * (second == first)))


STUDIES = (
    _of_worlds("success, mean", _success, mean, SHARE),
    _of_worlds("success, lowest decile", _success, lowest_decile, SHARE),
    _of_worlds("success, paired difference", _more_success, mean, (-1.0, 1.0), BAD_FOR_ONE),
    _of_worlds("motions, mean", _motions, mean, (1.0, CAP)),
    _of_worlds("motions, interquartile mean", _motions, interquartile_mean, (1.0, CAP)),
    _of_worlds("motions, median", _motions, median, (1.0, CAP)),
    _of_worlds("motions of one trial, 95th percentile", _one_trial, quantile(0.95), (1.0, CAP)),
    _of_worlds("motions, worst decile", _motions, worst_decile, (1.0, CAP)),
    Study(
        "motions, paired difference",
        (*SUCCESS, BAD_FOR_ONE),
        _more_motions,
        lambda samples, rng: [paired_difference(each, 0 * each) for each in samples],
        lambda population: float(population.mean()),
    ),
    _of_worlds("motions, median of paired differences", _more_motions, median, (-CAP, CAP), BAD_FOR_ONE),
    _of_worlds("probability of improvement, paired", _in_more, mean, SHARE, BAD_FOR_ONE),
    Study(
        "probability of improvement, unpaired",
        (*SUCCESS, BAD_FOR_ONE),
        _both,
        lambda samples, rng: [
            probability_of_improvement(x[:, 1], y[:, 0], rng)
            for x, y in zip(samples, np.roll(samples, 1, axis=0), strict=True)
        ],
        _different_worlds,
    ),
    Study(
        "motions to threshold, median",
        tuple(NEVER)[:2],
        _times,
        lambda samples, rng: [median_time(x[:, 0], x[:, 1] > 0, rng) for x in samples],
        lambda population: float(np.median(population[:, 2])),
    ),
    Study(
        "motions to threshold, restricted mean",
        tuple(NEVER),
        _times,
        lambda samples, rng: [restricted_mean_time(x[:, 0], x[:, 1] > 0, HORIZON, rng) for x in samples],
        lambda population: float(np.minimum(population[:, 2], HORIZON).mean()),
    ),
)


def coverage(
    samples: int = 400,
    studies: Sequence[Study] = STUDIES,
    sizes: Sequence[int] = WORLDS,
    population: int = 100_000,
) -> Iterator[Table]:
    """Each estimand in each design.

    Args:
        samples: Of worlds, in each of which there are 20 trials; an interval is made of each.
        studies: The estimands.
        sizes: Worlds in a sample.
        population: Worlds from which the truth is taken.
    """
    rows = []
    for study in studies:
        for design in study.designs:
            truth = study.truth(study.sample(np.random.default_rng(1), design, (1, population))[0])
            row = {"estimand": study.estimand, "worlds that differ": design, "truth": truth}
            for worlds in sizes:
                rng = np.random.default_rng(2)
                found = study.intervals(study.sample(rng, design, (samples, worlds)), rng)
                row[f"coverage, {worlds}"] = np.mean([e.low - EPS <= truth <= e.high + EPS for e in found])
                row[f"width, {worlds}"] = np.median([e.high - e.low for e in found])
            rows.append(row)
    frame = pd.DataFrame(rows)
    yield Table(
        "coverage",
        f"How often 95 % intervals hold the truth, by the number of worlds, with {TRIALS} trials in each",
        frame,
        {
            "truth": ".3g",
            **{f"coverage, {worlds}": ".3f" for worlds in sizes},
            **{f"width, {worlds}": ".3g" for worlds in sizes},
        },
        f"{samples:,} samples a row; widths are medians; motions are at most {CAP}. Truth: of {population:,} "
        "simulated worlds.",
    )


EPS = 1e-9
"""Of sums of floating-point numbers."""
