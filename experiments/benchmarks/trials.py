"""What benchmarks make of recorded trials: motions, failures counted, and shares with their intervals."""

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np

import calfree_gym
from calfree_gym.geometry import Array
from experiments.evaluation import TrialRecord
from experiments.reporting.tables import beside
from experiments.statistics import mean_share

REACH, DENSE = calfree_gym.ENV_IDS[:2]
CAP = gym.spec(REACH).max_episode_steps or 0
"""Motions as which a trial without a rendezvous counts."""

Lifetimes = Sequence[Sequence[TrialRecord]]
"""Trials of each world, of the same number in all."""


def motions_per_reach(lifetimes: Lifetimes) -> Array:
    """Motions (worlds, trials), a trial without a rendezvous counting as `CAP`."""
    return np.array([[record.motions_per_reach(CAP) for record in records] for records in lifetimes], float)


def share_of(what: str, lifetimes: Lifetimes, form: str) -> dict[str, Any]:
    """Columns of a table: the share of trials with a "rendezvous" or "success", its interval over worlds."""
    found = np.array([[record[what] for record in records] for records in lifetimes])
    return beside(what, mean_share(found), form)


def each_alone(records: Sequence[TrialRecord]) -> Lifetimes:
    """Trials of which each was made in a world of its own."""
    return [[record] for record in records]
