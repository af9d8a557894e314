"""The same episodes under each schedule, whoever acts in them; and how they are shown."""

import sys

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3 import A2C

import agents
from calfree_gym import StereoPoints, paired
from calfree_gym.perturb import Paired, Words
from tests.calfree_gym.perturb.table_top import TableTop

NONE = []
MIRRORED = [{"at": {"step": 0}, "do": {"type": "motor_sign", "motor": "action0"}}]
KNOCKED = [{"at": {"step": 1}, "do": {"type": "camera_aim", "camera": "top", "degrees": 15}}]


def towards(observation):
    """Knows where hand and thing are, and how actions move the hand."""
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


def test_an_agent_of_ours_acts_as_it_is_and_a_knock_in_mid_episode_does_not_stop_it():
    def success(env, info):
        hand, thing = env.unwrapped.data.mocap_pos
        return np.linalg.norm(hand - thing) < 0.02

    servo = agents.make("unified_servo", points_of(TableTop()))
    table = paired(
        lambda: TableTop(steps=400),
        servo,
        {"none": NONE, "knocked": KNOCKED},
        episodes=5,
        success=success,
        wrap=points_of,
        images={"top": None},
        per="episode",
    )
    assert [row.success for row in table.rows] == [1.0, 1.0]


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


def test_a_model_of_stable_baselines3_may_be_the_learner():
    def make(env):
        return A2C("MlpPolicy", env, n_steps=4, device="cpu")

    table = paired(lambda: TableTop(steps=5), make, {"none": NONE, "again": NONE}, episodes=3, learns=True)
    assert [len(outcomes) for outcomes in table.outcomes.values()] == [3, 3]


def test_it_is_printed_as_a_table_and_drawn():
    table = Paired({"none": (True,) * 9 + (False,), "10°": (True,) * 2 + (False,) * 7 + (True,)})
    assert str(table).splitlines() == [
        "schedule  success  won / lost  p     difference (95 %)",
        "none      90%",
        "10°       30%      1 / 7       0.07  -60% (-89% to +0%)",
    ]
    (axes,) = table.figure().axes
    assert [bar.get_width() for bar in axes.patches] == [90, 30]


def test_a_figure_without_matplotlib_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(ModuleNotFoundError, match=r"\.\[perturb\]"):
        Paired({"none": (True,)}).figure()


class Silent(gym.ObservationWrapper):
    """Tells no success."""

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
        ({"episodes": 0}, "episodes is 0"),
        ({"make_env": lambda: Silent(TableTop())}, "info has speed.*is_success, success.*success="),
        ({"schedules": {"none": NONE, "bad": [{"at": 3}]}}, "schedule.0 is .* must be a mapping"),
    ],
)
def test_what_cannot_be_compared_is_told(arguments, said):
    given = {"make_env": TableTop, "policy": towards, "schedules": {"none": NONE}, "episodes": 1}
    with pytest.raises(ValueError, match=said):
        paired(**(given | arguments))
