"""The table of first motions counts what a trial did."""

import gymnasium as gym
import numpy as np
import pytest

from experiments.benchmarks.arms import first_motions
from experiments.benchmarks.arms.first_motions import CAP, FirstTrial, Place, first_trial


class Told(gym.Env):
    """An environment whose infos are given, motion by motion."""

    def __init__(self, infos):
        self._infos = infos

    def reset(self, *, seed=None, options=None):
        self._left = list(self._infos)
        return 0, {}

    def step(self, action):
        info = {"is_success": False, "harmed": False, **self._left.pop(0)}
        return 0, 0.0, info["is_success"], info["harmed"], info


class Sends:
    """An agent of given words."""

    def __init__(self, words):
        self._words = list(words)

    def predict(self, observation, state=None):
        return np.array(self._words.pop(0)), []


def test_the_first_motion_is_the_first_that_moves_and_an_accident_is_no_success():
    quiet, first = {"joint_travel": 0.0, "peak_force": 0.0}, {"joint_travel": 0.2, "peak_force": 5.0}
    last = {"joint_travel": 0.9, "peak_force": 80.0}
    words = [[0.0], [0.1], [0.5]]
    harmed = first_trial(Sends(words), Told([quiet, first, last | {"harmed": True}]), 0)
    assert harmed == FirstTrial(0.2, 80.0, True, False, CAP, False)
    reached = first_trial(Sends(words), Told([quiet, first, last | {"is_success": True}]), 0)
    assert reached == FirstTrial(0.2, 80.0, False, True, 3, False)


def test_shares_and_ratios_are_of_the_trials():
    today = [FirstTrial(0.5, 0, False, True, 10, False), FirstTrial(0.5, 99, True, False, CAP, False)]
    ours = [FirstTrial(0.01, 0, False, True, 15, False), FirstTrial(0.01, 2, False, True, 21, False)]
    row = first_motions._row(ours, today)
    assert row["ratio"] == 1.5, "where today's servo was unharmed"
    assert (row["beyond 10°"], row["harmed"], row["motions"]) == (0.0, 0.0, 18.0)
    assert first_motions._row(today, today)["beyond 10°"] == 1.0


@pytest.mark.slow
def test_a_small_table():
    table, others = first_motions.safe_start({"movemaster": Place(3, {})}, {"again": Place(3, {})})
    assert table.frame["agent"].tolist() == list(first_motions.AGENTS)
    assert table.frame.set_index("agent")["beyond 10°"]["safe_start"] == 0
    alone, beside = others.frame.iloc[0], table.frame.set_index("agent").loc["safe_start"]
    assert (alone["arm"], alone["motors"], alone["worlds"]) == ("again", 3, 3)
    assert alone["motions"] == beside["motions"], "the same agent in the same worlds"
