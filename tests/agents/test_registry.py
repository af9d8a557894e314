"""Agents by name, and the settings that they take."""

import importlib
import re
import sys
from functools import partial

import gymnasium as gym
import numpy as np
import pytest

import agents
from agents.base.registration import AGENTS, agent
from agents.moved import MOVED
from calfree_gym.tasks.reach import PRIVILEGED
from tests.arms.own import ARMS

NAMES = agents.names()


def test_unknown_names_and_settings():
    env = gym.make("CalFree/Reach-v0")
    with pytest.raises(ValueError, match=r"'grid_tabel'.*did you mean grid_table"):
        agents.make("grid_tabel", env)
    for name in NAMES:
        for ask in (agents.default_settings, partial(agents.make, env=env)):
            with pytest.raises(ValueError, match=rf"'{name}' has no setting 'no_such'; allowed: .*seed"):
                ask(name, no_such=1)
    for name, settings, said in (
        ("grid_table", {"cels": 9}, r"\(did you mean cells"),
        ("insert", {"prob_px": 3}, r"\(did you mean probe_px"),
        ("grasp", {"lift": 3}, "; allowed"),
        ("grasp", {"knowledge": "grid_table", "direction": True, "every_look": True}, "; allowed"),
        ("grid_table", {"servo": "work_plane_servo", "estimator": "kalman"}, "; allowed: .*in_plane_px"),
    ):
        with pytest.raises(ValueError, match=f"agent '{name}' has no setting '{[*settings][-1]}'.*{said}"):
            agents.default_settings(name, **settings)


SELF_TAUGHT = [
    *[("hidden", (0,)), ("hidden", 64), ("learning_rate", 0), ("random_motions", 1), ("random_extent", 1.5)],
    *[("exploration", -0.1), ("patience", 0), ("updates", 0), ("batch", 0), ("capacity", 1)],
]
WRONG = [
    ("random", "limit", 2, "must be a number"),
    ("random", "limit", True, "must be a number"),
    ("grid_table", "cells", 0, "must be a whole number"),
    ("grid_table", "cells", "eight", "must be a whole number"),
    *[("factored_table", *each, "") for each in (("jump_px", "x"), ("jump_px", -1), ("every_look", "no"))],
    *[(name, "rate", rate, "") for name in ("factored_table", "support_points") for rate in (0, 2)],
    *[(name, "kalman", "yes", "") for name in ("factored_table", "support_points")],
    ("memory", "on_change", "forget", "allowed: recognise, map, discard, keep"),
    *[("learning_servo", setting, ["x"], "allowed: ") for setting in ("servo", "knowledge")],
    ("body_schema", "servo", "memory", "allowed: .*unified_servo"),
    *[("unified_servo", *each, "") for each in (("probe_px", -3), ("caution", "x"))],
    *[("jacobian_servo", *each, "") for each in (("damping", "x"), ("patience", 0))],
    ("jacobian_servo", "estimator", "kalmann", r"\(did you mean kalman\?\)"),
    ("paper_servo", "step_word", 1.5, ""),
    ("paper_servo", "damping", np.inf, "must be a finite number, 0 or more"),
    ("work_plane_servo", "camera", "lft", r"\(did you mean left\?\)"),
    ("work_plane_servo", "border", 0, ""),
    ("work_plane_servo", "in_plane_px", -1, "must be a number, 0 or more"),
    ("work_plane_servo", "step_word", 2, "must be a number, .*at most 1"),
    *[("joint_space_servo", *each, "") for each in (("gain", 1.5), ("step_rad", 0.0), ("damping", -1.0))],
    *[("affine_stereo", *each, "") for each in (("gain", 0.0), ("gain", 1.5), ("spacing", 0.0))],
    *[(name, "camera_mount", "wrist", "allowed: waist, st") for name in ("model_based", "simulation_prior")],
    ("self_calibrating", "lens", "fisheye", "allowed: radial, none"),
    ("simulation_prior", "prior", 3, "must be the name of a file"),
    ("recurrent_servo", "weights", 3, "must be the name of a file"),
    *[(name, *each, "") for name in ("self_supervised", "cooperstock_milios") for each in SELF_TAUGHT],
    ("sac", "word_limit", 0, ""),
    ("sac", "seed", None, "must be a whole number, 0 or"),
    *[("memory", "seed", each, "must be a whole number, 0 or") for each in ("a", -1, 1.5)],
    ("grasp", "intermediate", "above", "allowed: along_axis"),
    ("grasp", "orientation", "eye", "allowed: least_squares"),
    ("grasp", "tries", 0, ""),
    ("grasp", "direction", 1, "allowed: True, False"),
]


@pytest.mark.parametrize(("name", "setting", "value", "said"), WRONG)
def test_wrong_settings_say_what_is_allowed(name, setting, value, said):
    task, told = ("Grasp", {}) if name == "grasp" else ("Reach", {"tell": tuple(PRIVILEGED)})
    wrong = value[0] if isinstance(value, tuple) else value
    message = re.escape(f"agent '{name}': {setting} is {wrong!r}") + f".*{said}"
    with pytest.raises(ValueError, match=message):
        agents.make(name, gym.make(f"CalFree/{task}-v0", **told), **{setting: value})


def test_a_class_that_is_no_agent_gets_no_name():
    class Still:
        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            return np.zeros(3), None

    with pytest.raises(TypeError, match=r"Still.* must be derived from agents.Agent to be called 'still'"):
        agent("still", "Does not move.")(Still)


@pytest.mark.parametrize(
    ("name", "task", "said"),
    [
        ("joint_space_servo", "Reach", r"requires joint_angles.*tell=\('joint_angles',\)"),
        ("affine_stereo", "Reach", r"requires gripper_position.*tell=\('gripper_position',\)"),
        (
            "unified_servo",
            "Grasp",
            "'unified_servo' cannot grasp, as this environment asks; allowed: random, g",
        ),
        ("grasp", "Reach", "'grasp' cannot reach, as this"),
        *[(name, "Insert", f"'{name}' cannot insert, .*random, insert, y") for name in ("grasp", "oracle")],
        *[(name, "Grasp", f"'{name}' cannot grasp") for name in ("insert", "yoshimi_allen")],
    ],
)
def test_who_cannot_do_a_task_or_needs_to_be_told_something_says_so(name, task, said):
    with pytest.raises(ValueError, match=said):
        agents.make(name, gym.make(f"calfree_gym:CalFree/{task}-v0"))


@pytest.mark.parametrize("number", [np.float32(0.5), np.int64(1)])
def test_numbers_of_numpy_are_numbers(make_env, number):
    assert agents.make("random", make_env(), limit=number).limit == number


@pytest.mark.parametrize("ask", [agents.make, lambda name, env: agents.default_settings(name)])
def test_a_neural_agent_says_what_to_install(make_env, monkeypatch, ask):
    monkeypatch.setitem(sys.modules, "yaml", None)  # as if it were not installed
    with pytest.raises(ModuleNotFoundError, match=r"agent 'sac' needs yaml.*pip install '\.\[agents\]' in"):
        ask("sac", make_env())


@pytest.mark.parametrize("arm", ["hobby", "gantry"])
def test_agents_that_know_one_arm_refuse_others_and_name_those_that_act_on_any(arm):
    env = gym.make("calfree_gym:CalFree/Reach-v0", arm=ARMS[arm], tell=tuple(PRIVILEGED))
    for name in ("affine_stereo", "model_based", "self_calibrating", "simulation_prior"):
        with pytest.raises(ValueError, match=f"{name} is built on the arm 'movemaster'") as refused:
            agents.make(name, env)
    of_any = re.search("allowed with any arm: (.*?);", str(refused.value))[1].split(", ")
    assert {*of_any} == {name for name in NAMES if not AGENTS[name].arms}
    env.reset(seed=0)
    for name in set(of_any) - {*agents.NEURAL}:
        assert agents.make(name, env).learn(3).num_timesteps == 3


@pytest.mark.parametrize("name", ["memory", "unified_servo", "random", "self_supervised", "grasp", "sac"])
@pytest.mark.parametrize("task", ["Reach", "Grasp"])
def test_images_instead_of_image_points_are_refused(name, task):
    env = gym.make(f"CalFree/{task}-v0", observation="pixels")
    said = (
        rf"agent '{name}': it needs image points \(achieved_goal, desired_goal\); this environment's "
        r"observation has only (observation|pixels), (observation|pixels); make it with observation='points'"
    )
    with pytest.raises(ValueError, match=said):
        agents.make(name, env)


class Elsewhere(gym.Wrapper):
    """Its goals are in space, as those of other environments."""

    keys = ("achieved_goal", "desired_goal", "observation")
    observation_space = gym.spaces.Dict(dict.fromkeys(keys, gym.spaces.Box(-1, 1, (3,))))


@pytest.mark.parametrize(
    ("env", "said"),
    [
        ("CalFree/Reach-v0", r"needs an environment, such as gymnasium\.make.*found 'CalFree/Reach-v0'"),
        (gym.make("Pendulum-v1"), r"needs an environment of calfree_gym; .* observation is Box"),
        (gym.make_vec("calfree_gym:CalFree/Reach-v0", num_envs=2), "one environment at a time"),
        (
            Elsewhere(gym.make("calfree_gym:CalFree/Reach-v0")),
            r"4 or 5 numbers; this environment's has shape \(3,\)",
        ),
    ],
    ids=str,
)
def test_what_is_no_environment_of_ours_is_refused(env, said):
    with pytest.raises(ValueError, match=said):
        agents.make("memory", env)


def test_an_unknown_task_is_named(make_env):
    with pytest.raises(ValueError, match=r"task is 'grip'.*allowed: reach, grasp, insert"):
        agents.names("grip")
    env = make_env()
    env.unwrapped.task = "hover"
    with pytest.raises(ValueError, match="task is 'hover'"):
        agents.make("memory", env)


@pytest.mark.parametrize("motions", [-1, 10.5, "5"])
@pytest.mark.parametrize("name", ["memory", "self_supervised", "recurrent_servo", "sac"])
def test_motions_to_learn_by_are_a_whole_number(make_env, name, motions):
    agent = agents.make(name, make_env())
    with pytest.raises(ValueError, match=f"total_timesteps is {motions!r}; it must be a whole number, 0 or"):
        agent.learn(motions)
    assert agent.num_timesteps == 0


@pytest.mark.parametrize("old", [name for name in MOVED if not name.startswith("neural")])
def test_a_module_is_found_under_its_earlier_name(old):
    sys.modules.pop(f"agents.{old}", None)
    with pytest.warns(DeprecationWarning, match=rf"agents\.{old} is now agents\.{MOVED[old]}"):
        found = importlib.import_module(f"agents.{old}")
    assert found is importlib.import_module(f"agents.{MOVED[old]}")
    assert found.__spec__.name == f"agents.{MOVED[old]}"


@pytest.mark.parametrize("knowledge", ["memory", None])
def test_directions_are_keys_of_tables_alone(knowledge):
    with pytest.raises(ValueError, match="allowed: grid_table, factored_table"):
        agents.make("grasp", gym.make("CalFree/Grasp-v0"), direction=True, knowledge=knowledge)
