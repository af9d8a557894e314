"""The same episodes under each schedule, and McNemar's test and Tango's interval against others."""

import re
import sys
import warnings
from functools import cache

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar
from scipy.stats import binomtest

import agents
from calfree_gym import StereoPoints, paired
from calfree_gym.perturb import Paired, Words
from calfree_gym.perturb.paired_shares import mcnemar_p, score_interval
from tests.calfree_gym.perturb.table_top import TableTop

NONE = []
MIRRORED = [{"at": {"step": 0}, "do": {"type": "motor_sign", "motor": "action0"}}]
KNOCKED = [{"at": {"step": 1}, "do": {"type": "camera_aim", "camera": "top", "degrees": 15}}]


def towards(observation):
    return np.clip((observation[3:] - observation[:3]) / 0.02, -1, 1)


def points_of(env):
    return StereoPoints(env, "tip", "thing", ("top", "front"), Words((0, 1, 2), steps=15))


def test_episodes_are_the_same_but_for_what_is_perturbed():
    made = []

    def make_env():
        made.append(TableTop(steps=40))
        return made[-1]

    table = paired(make_env, towards, {"none": NONE, "again": NONE, "mirrored": MIRRORED}, episodes=8, seed=5)
    assert [env.seeds for env in made] == [list(range(5, 13))] * 3
    none, again, mirrored = table.rows
    assert (none.success, none.won, none.lost, none.p) == (1.0, 0, 0, 1.0)
    assert again == none._replace(schedule="again")
    assert (mirrored.success, mirrored.won, mirrored.lost, mirrored.difference) == (0.0, 0, 8, -1.0)
    assert mirrored.p == pytest.approx(2 / 2**8)
    assert mirrored.low == -1 < mirrored.high < 0


def test_a_knock_stays_in_its_own_life_where_environments_share_a_model():
    model = TableTop().model
    built = model.cam_quat.copy()

    def make_env():
        env = TableTop(steps=3)
        env.model, env.data = model, mujoco.MjData(model)
        return env

    def as_built(env, info):
        return (env.unwrapped.model.cam_quat == built).all()

    schedules = {"knocked": KNOCKED, "none": NONE, "again": KNOCKED}
    table = paired(make_env, towards, schedules, episodes=2, success=as_built, images={"top": None})
    assert table.outcomes == {"knocked": (False, False), "none": (True, True), "again": (False, False)}
    np.testing.assert_array_equal(model.cam_quat, built)


def test_a_schedule_that_never_comes_is_warned_of():
    late, never = [{**MIRRORED[0], "at": {"step": 7}}], [{**MIRRORED[0], "at": {"step": 8}}]
    given = {"make_env": lambda: TableTop(steps=8), "policy": towards, "episodes": 2}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        paired(schedules={"none": NONE, "late": late}, per="episode", **given)
        paired(schedules={"none": NONE, "of a life": never}, **given)
    with pytest.warns(
        UserWarning, match="nothing of the schedule 'never' was applied in 2 episodes: .*the end of each"
    ):
        paired(schedules={"none": NONE, "late": late, "never": never}, per="episode", **given)


def test_a_model_with_predict_gets_its_state_back():
    told = []

    class Counts:
        def predict(self, observation, state=None, episode_start=None, deterministic=False):
            told.append((state, bool(episode_start[0]), deterministic))
            return towards(observation), (state or 0) + 1

    table = paired(lambda: TableTop(steps=3), Counts(), {"none": NONE}, episodes=2)
    assert told == 2 * [(None, True, True), (1, False, True), (2, False, True)]
    assert len(table.outcomes["none"]) == 2


def test_a_function_with_reset_is_told_where_episodes_begin():
    class Policy:
        begun = 0

        def reset(self):
            self.begun += 1

        def __call__(self, observation):
            return towards(observation)

    policy = Policy()
    paired(TableTop, policy, {"none": NONE, "again": NONE}, episodes=3)
    assert policy.begun == 6


def test_a_learner_lives_one_life_in_each_schedule():
    made = []

    def make(env):
        made.append(gym.wrappers.RecordEpisodeStatistics(env))
        return agents.make("memory", made[-1])

    table = paired(
        lambda: TableTop(steps=400),
        make,
        {"none": NONE, "knocked": [{**KNOCKED[0], "at": {"episode": 6}}]},
        episodes=12,
        learns=True,
        wrap=points_of,
        images={"top": None},
    )
    assert [len(outcomes) for outcomes in table.outcomes.values()] == [12, 12]
    none, knocked = ([*life.length_queue] for life in made)
    assert len(none) == len(knocked) == 12
    assert none[:6] == knocked[:6]
    assert none[0] > none[-1], "it learns from episode to episode"


def test_a_learner_that_ends_before_all_episodes_is_told():
    class Ends:
        def learn(self, motions, callback):
            return self

    with pytest.raises(ValueError, match=r"schedules\.none: learn ended after 0 of 2 episodes"):
        paired(TableTop, lambda env: Ends(), {"none": NONE, "again": NONE}, episodes=2, learns=True)


def test_it_is_printed_as_a_table_and_drawn():
    table = Paired({"none": (True,) * 9 + (False,), "10°": (True,) * 2 + (False,) * 7 + (True,)})
    assert re.search(r"none +90%\n.*10° +30% +1 / 7 +0.07 +-60% .-89% to .0%", str(table))
    (axes,) = table.figure().axes
    assert [bar.get_width() for bar in axes.patches] == [90, 30]


def test_a_figure_without_matplotlib_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(ModuleNotFoundError, match=r"\.\[perturb\]"):
        Paired({"none": (True,)}).figure()


class Silent(gym.ObservationWrapper):
    def observation(self, observation):
        return observation

    def step(self, action):
        *result, _ = super().step(action)
        return *result, {"speed": 1}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"schedules": {}}, "must be schedules by name"),
        ({"schedules": [NONE]}, "must be schedules by name"),
        ({"schedules": {0: NONE}}, "schedules has the name 0; names are text"),
        ({"episodes": 0}, "episodes is 0"),
        ({"make_env": lambda: Silent(TableTop())}, "info has speed.*is_success, success.*success="),
        (
            {"make_env": cache(TableTop), "schedules": {"none": NONE, "more": NONE}},
            "the same environment again",
        ),
        (
            {"schedules": {"none": NONE, "bad": [{"at": 3}]}},
            r"schedules\.bad: schedule\.0 is .* must be a mapping",
        ),
    ],
)
def test_what_cannot_be_compared_is_told(arguments, said):
    given = {"make_env": TableTop, "policy": towards, "schedules": {"none": NONE}, "episodes": 1}
    with pytest.raises(ValueError, match=said):
        paired(**(given | arguments))


def test_p_is_that_of_the_binomial_test():
    for won in range(12):
        for lost in range(40):
            if won + lost:
                assert mcnemar_p(won, lost) == pytest.approx(binomtest(won, won + lost).pvalue, rel=1e-9)
    assert mcnemar_p(0, 0) == 1.0


@pytest.mark.parametrize(
    ("won", "lost", "pairs", "low", "high"),
    [
        (1, 7, 21, -0.517, -0.026),  # Bentur et al. 2009
        (6, 16, 161, -0.1240, -0.0054),  # Cavo et al. 2012
    ],
)
def test_intervals_that_were_published(won, lost, pairs, low, high):
    """In Fagerland, Lydersen and Laake, Statistical Analysis of Contingency Tables (2017), chapter 8."""
    digits = 3 if pairs == 21 else 4
    found = score_interval(won, lost, pairs, correction=0)
    np.testing.assert_allclose(found, (low, high), atol=0.51 * 10**-digits)


@pytest.mark.parametrize(
    "counts", [(0, 1, 44), (12, 2, 50), (0, 9, 30), (3, 3, 30), (25, 4, 30), (0, 96, 100)]
)
def test_bounds_are_where_the_score_of_the_most_likely_shares_is_z(counts):
    won, lost, pairs = counts

    def score(difference):
        def unlikely(losing):
            shares = np.array([losing + difference, losing, 1 - 2 * losing - difference])
            return -np.array([won, lost, pairs - won - lost]) @ np.log(np.maximum(shares, 1e-300))

        least, most = max(0, -difference), (1 - difference) / 2
        losing = minimize_scalar(unlikely, bounds=(least, most), options={"xatol": 1e-12}).x
        variance = pairs * (2 * losing + difference - difference**2)
        return (won - lost - pairs * difference) / np.sqrt(variance)

    middle, z = (won - lost) / pairs, 1.959963984540054
    low, high = score_interval(*counts, correction=0)
    if middle > -1:
        assert brentq(lambda d: score(d) - z, -1 + 1e-9, middle - 1e-9) == pytest.approx(float(low), abs=1e-5)
    if middle < 1:
        assert brentq(lambda d: score(d) + z, middle + 1e-9, 1 - 1e-9) == pytest.approx(float(high), abs=1e-5)


def test_edges():
    low, high = score_interval([0, 30, 0], [0, 0, 30], 30, correction=0)
    z2 = 1.959963984540054**2
    np.testing.assert_allclose(high, [z2 / (30 + z2), 1, -low[1]])
    np.testing.assert_allclose(low, [-high[0], 30 / (30 + z2) * 2 - 1, -1], atol=1e-9)
