"""The table of first motions counts what a trial did."""

import gymnasium as gym
import numpy as np
import pandas as pd
import pytest

from experiments.studies import safe_start
from experiments.studies.common import CAP, first_trial
from experiments.studies.safe_start import Place


class Told(gym.Env):
    """An environment whose infos are given, motion by motion."""

    def __init__(self, infos):
        self._infos = infos

    def reset(self, *, seed=None, options=None):
        self._left = list(self._infos)
        return 0, {}

    def step(self, action):
        info = {"is_success": False, "harmed": False, "truth": {}, **self._left.pop(0)}
        return 0, 0.0, info["is_success"], info["harmed"], info

    def is_solved(self, truth):
        return False


class Sends:
    """An agent of given words."""

    def __init__(self, words):
        self._words = list(words)

    def predict(self, observation, state=None):
        return np.array(self._words.pop(0)), []


@pytest.mark.parametrize(
    ("end", "harmed", "reached", "motions"),
    [({"harmed": True}, True, False, CAP), ({"is_success": True}, False, True, 3)],
)
def test_the_first_motion_is_the_first_that_moves_and_an_accident_is_no_success(
    end, harmed, reached, motions
):
    infos = [{"joint_travel": 0.0, "peak_force": 0.0}, {"joint_travel": 0.2, "peak_force": 5.0}]
    infos.append({"joint_travel": 0.9, "peak_force": 80.0} | end)
    trial = first_trial(Sends([[0.0], [0.1], [0.5]]), Told(infos), 0)
    (found,) = safe_start._of_trials([trial]).to_numpy().tolist()
    assert found == [0.2, 80.0, harmed, reached, motions, False]


def test_shares_and_ratios_are_of_the_trials():
    columns = ["first", "force", "harmed", "reached", "motions", "gave up"]
    today = pd.DataFrame([(0.5, 0, False, True, 10, False), (0.5, 99, True, False, CAP, False)])
    ours = pd.DataFrame([(0.01, 0, False, True, 15, False), (0.01, 2, False, True, 21, False)])
    today.columns = ours.columns = columns
    row = safe_start._row(ours, today)
    assert row["ratio"] == 1.5, "where today's servo was unharmed"
    assert (row["beyond 10°"], row["harmed"], row["motions"]) == (0.0, 0.0, 18.0)
    assert safe_start._row(today, today)["beyond 10°"] == 1.0


@pytest.mark.slow
def test_a_small_table():
    table, others = safe_start.tables({"movemaster": Place(3, {})}, {"again": Place(3, {})})
    assert table.frame["agent"].tolist() == list(safe_start.AGENTS)
    assert table.frame.set_index("agent")["beyond 10°"]["safe_start"] == 0
    alone, beside = others.frame.iloc[0], table.frame.set_index("agent").loc["safe_start"]
    assert (alone["arm"], alone["motors"], alone["worlds"]) == ("again", 3, 3)
    assert alone["motions"] == beside["motions"], "the same agent in the same worlds"
