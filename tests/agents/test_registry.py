"""Agents by name, and the settings that they take."""

import importlib
import re
import sys

import gymnasium as gym
import numpy as np
import pytest

import agents
from agents.base.registration import AGENTS
from agents.moved import MOVED
from agents.servo.paper import PaperServo
from agents.servo.unified import UnifiedServo
from agents.servo.work_plane import WorkPlaneServo
from calfree_gym.tasks.reach import PRIVILEGED
from tests.arms.own import ARMS

NAMES = agents.names()


def test_unknown_names_and_settings():
    env = gym.make("CalFree/Reach-v0")
    with pytest.raises(ValueError, match=r"'grid_tabel'.*did you mean grid_table"):
        agents.make("grid_tabel", env)
    for name in NAMES:
        with pytest.raises(ValueError, match=rf"'{name}' has no setting 'no_such_setting'; allowed: .*seed"):
            agents.make(name, env, no_such_setting=1)
        with pytest.raises(ValueError, match=rf"'{name}' has no setting 'no_such_setting'; allowed: .*seed"):
            agents.default_settings(name, no_such_setting=1)
    with pytest.raises(ValueError, match="did you mean cells"):
        agents.make("grid_table", env, cels=9)
    with pytest.raises(ValueError, match="cells is 'eight'; it must be a whole number"):
        agents.make("grid_table", env, cells="eight")
    for name, setting in (
        ("random", {"limit": 2}),
        ("grid_table", {"cells": 0}),
        ("sac", {"word_limit": 0}),
        ("unified_servo", {"probe_px": -3}),
        ("unified_servo", {"caution": "x"}),
        ("jacobian_servo", {"damping": "x"}),
        ("jacobian_servo", {"patience": 0}),
        ("paper_servo", {"step_word": 1.5}),
        ("work_plane_servo", {"camera": "middle"}),
        ("work_plane_servo", {"border": 0}),
    ):
        with pytest.raises(ValueError, match=str(list(setting.values())[-1])):
            agents.make(name, env, **setting)
    with pytest.raises(ValueError, match=r"estimator is 'kalmann' \(did you mean kalman\?\)"):
        agents.make("jacobian_servo", env, estimator="kalmann")


def test_which_servo_corrects_the_paper_s_table(make_env):
    """The paper's own, unless another one is asked for."""
    env = make_env()
    assert agents.make("grid_table", env).servo == PaperServo()
    assert agents.make("grid_table", env, servo="unified_servo").servo == UnifiedServo()
    assert agents.make("grid_table", env, servo="work_plane_servo").servo == WorkPlaneServo()
    with pytest.raises(ValueError, match=r"has no setting 'estimator'.*allowed: .*in_plane_px"):
        agents.make("grid_table", env, servo="work_plane_servo", estimator="kalman")


@pytest.mark.parametrize("number", [np.float32(0.5), np.float64(0.5), np.int64(1)])
def test_numbers_of_numpy_are_numbers(make_env, number):
    assert agents.make("random", make_env(), limit=number).limit == number
    with pytest.raises(ValueError, match="limit is True; it must be a number"):
        agents.make("random", make_env(), limit=True)
    with pytest.raises(ValueError, match=r"damping is inf; it must be a finite number, 0 or more"):
        agents.make("paper_servo", make_env(), damping=np.inf)


def test_a_batched_environment_to_learn_in_is_refused():
    batch = gym.make_vec("CalFree/Reach-v0", num_envs=2)
    with pytest.raises(ValueError, match="one environment at a time"):
        agents.make("grid_table", batch)


@pytest.mark.parametrize("ask", [agents.make, lambda name, env: agents.default_settings(name)])
def test_a_neural_agent_says_what_to_install(make_env, monkeypatch, ask):
    monkeypatch.setitem(sys.modules, "yaml", None)  # as if it were not installed
    with pytest.raises(
        ModuleNotFoundError, match=r"agent 'sac' needs yaml.*pip install '\.\[agents\]' in the repository"
    ):
        ask("sac", make_env())


@pytest.mark.parametrize("arm", ["hobby", "gantry"])
def test_agents_that_know_one_arm_refuse_others_and_name_those_that_act_on_any(arm):
    """Also an arm that has as many motors as the one they know."""
    env = gym.make("calfree_gym:CalFree/Reach-v0", arm=ARMS[arm], tell=tuple(PRIVILEGED))
    for name in ("affine_stereo", "model_based", "self_calibrating"):
        with pytest.raises(ValueError, match=f"{name} is built on the arm 'movemaster'") as refused:
            agents.make(name, env)
    of_any = re.search("allowed with any arm: (.*);", str(refused.value))[1].split(", ")
    assert {*of_any} == {name for name in NAMES if not AGENTS[name].arms}
    env.reset(seed=0)
    for name in set(of_any) - {*agents.NEURAL}:
        assert agents.make(name, env).learn(3).num_timesteps == 3


@pytest.mark.parametrize("name", ["memory", "unified_servo", "random", "self_supervised", "grasp", "sac"])
@pytest.mark.parametrize("task", ["Reach", "Grasp"])
def test_images_instead_of_image_points_are_refused(name, task):
    env = gym.make(f"CalFree/{task}-v0", observation="pixels")
    with pytest.raises(
        ValueError,
        match=rf"agent '{name}': it needs image points \(achieved_goal, desired_goal\); this environment's "
        r"observation has only (observation|pixels), (observation|pixels); make it with observation='points'",
    ):
        agents.make(name, env)


@pytest.mark.parametrize(
    ("env", "said"),
    [
        ("CalFree/Reach-v0", r"needs an environment, such as gymnasium\.make.*found 'CalFree/Reach-v0'"),
        (gym.make("Pendulum-v1"), r"needs an environment of calfree_gym; .* observation is Box"),
        (gym.make("CartPole-v1"), r"needs an environment of calfree_gym; .* observation is Box"),
    ],
)
def test_what_is_no_environment_of_ours_is_refused(env, said):
    with pytest.raises(ValueError, match=f"agent 'memory': it {said}"):
        agents.make("memory", env)


def test_goals_of_another_size_are_refused(make_env):
    class Elsewhere(gym.Wrapper):
        """In space, as the goals of other environments."""

        observation_space = gym.spaces.Dict(
            dict.fromkeys(("achieved_goal", "desired_goal", "observation"), gym.spaces.Box(-1, 1, (3,)))
        )

    with pytest.raises(ValueError, match=r"4 or 5 numbers; this environment's has shape \(3,\)"):
        agents.make("memory", Elsewhere(make_env()))


def test_tables_begin_with_the_floor_and_the_ceiling():
    assert NAMES[:3] == ("random", "oracle", "paper_servo")


def test_agents_of_an_unknown_task():
    with pytest.raises(ValueError, match=r"task is 'grip'.*allowed: reach, grasp, insert"):
        agents.names("grip")


@pytest.mark.parametrize("setting", ["servo", "knowledge"])
def test_a_list_is_no_name(make_env, setting):
    with pytest.raises(ValueError, match=rf"{setting} is \['x'\]; allowed: "):
        agents.make("learning_servo", make_env(), **{setting: ["x"]})


@pytest.mark.parametrize("seed", ["a", -1, 1.5, None])
@pytest.mark.parametrize("name", ["memory", "sac"])
def test_a_seed_is_a_whole_number(make_env, name, seed):
    with pytest.raises(
        ValueError, match=f"agent '{name}': seed is {seed!r}; it must be a whole number, 0 or"
    ):
        agents.make(name, make_env(), seed=seed)


@pytest.mark.parametrize("motions", [-1, 10.5, "5"])
@pytest.mark.parametrize("name", ["memory", "self_supervised", "recurrent_servo", "sac"])
def test_motions_to_learn_by_are_a_whole_number(make_env, name, motions):
    agent = agents.make(name, make_env())
    with pytest.raises(ValueError, match=f"total_timesteps is {motions!r}; it must be a whole number, 0 or"):
        agent.learn(motions)
    assert agent.num_timesteps == 0


@pytest.mark.parametrize("task", ["Reach", "Grasp", "Insert"])
def test_random_acts_in_every_task(task):
    env = gym.make(f"calfree_gym:CalFree/{task}-v0")
    agent = agents.make("random", env).learn(2)
    observation, _ = env.reset(seed=0)
    words, _ = agent.predict(observation)
    assert env.action_space.contains(words)


@pytest.mark.parametrize("old", [name for name in MOVED if not name.startswith("neural")])
def test_a_module_is_found_under_its_earlier_name(old):
    """As itself, not as a second one that would be registered again."""
    sys.modules.pop(f"agents.{old}", None)
    with pytest.warns(DeprecationWarning, match=rf"agents\.{old} is now agents\.{MOVED[old]}"):
        found = importlib.import_module(f"agents.{old}")
    assert found is importlib.import_module(f"agents.{MOVED[old]}")
    assert found.__spec__.name == f"agents.{MOVED[old]}"


def test_an_environment_says_what_its_task_is(make_env):
    env = make_env()
    env.unwrapped.task = "hover"
    with pytest.raises(ValueError, match="task is 'hover'"):
        agents.make("memory", env)
