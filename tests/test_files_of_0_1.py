"""Files that the code of version 0.1 (commit 5291005) wrote are read as it read them, or refused by name."""

import json
from pathlib import Path

import gymnasium as gym
import numpy as np
import pandas as pd
import pytest

import agents
from calfree_gym import World
from experiments.config.loading import load
from experiments.errors import ConfigError
from experiments.reporting.results_file import read_finished

FILES = Path(__file__).with_name("files_of_0_1")
EXPECTED = json.loads((FILES / "expected.json").read_text())
"""A first observation, the words that each agent of 0.1 chose by it, and true points in a world of 0.1."""
OVER_JACOBIAN = {"servo": "jacobian_servo"}
NOW = {
    "unified_servo": ("jacobian_servo", {}),
    "paper_servo": ("paper_servo", {}),
    "work_plane_servo": ("work_plane_servo", {}),
    "grid_table": ("grid_table", {"cells": 4}),
    "factored_table": ("factored_table", {"cells": 2, **OVER_JACOBIAN}),
    "support_points": ("support_points", OVER_JACOBIAN),
    **{name: (name, {}) for name in ("self_calibrating", "model_based")},
}
"""What each saved agent is called now, and its settings."""


@pytest.fixture
def env():
    env = gym.make("calfree_gym:CalFree/Reach-v0", dynamics="kinematic")
    env.reset(seed=1)
    return env


@pytest.mark.filterwarnings("ignore:.*(now|version 0.1)")
@pytest.mark.parametrize("file", NOW)
def test_a_saved_agent_acts_as_it_did(file, env):
    name, settings = NOW[file]
    agent = agents.make(name, env, **settings).load(FILES / f"{file}.npz")
    assert agent.num_timesteps == 40
    observation = {key: np.array(value, np.float32) for key, value in EXPECTED["observation"].items()}
    words, _ = agent.predict(observation)
    np.testing.assert_allclose(words, EXPECTED["words"][file], atol=1e-4)


def test_an_agent_with_another_name_now_is_loaded_with_a_warning(env):
    with pytest.warns(UserWarning, match=r"names UnifiedServo\(.*, which is now JacobianServo\("):
        agents.make("jacobian_servo", env).load(FILES / "unified_servo.npz")


@pytest.mark.parametrize(("name", "held"), [("memory", "GaussianProcess"), ("unified_servo", "UnifiedServo")])
def test_an_agent_that_is_another_now_is_refused(name, held, env):
    with pytest.raises(ValueError, match=rf"{name}\.npz holds {held}.*this agent is"):
        agents.make(name, env).load(FILES / f"{name}.npz")


def test_a_world_shows_what_it_showed(env):
    env.unwrapped.set_world(World.from_dict(json.loads((FILES / "world.json").read_text())))
    _, info = env.reset(seed=5, options={"object": (0.4, 0.1, 0.1)})
    np.testing.assert_allclose(info["truth"]["points"], EXPECTED["points"], atol=1e-4 / 256)


def test_a_suite_is_read():
    suite = load(FILES / "suite.yaml")
    assert [agent.label for agent in suite.agents] == ["unified_servo", "coarse_table"]
    assert [len(part) for part in (suite.scenarios, suite.sweeps)] == [1, 1]


def test_rows_of_results_are_read_and_a_report_is_refused(tmp_path):
    rows = pd.read_parquet(FILES / "results.parquet")
    assert {"run", "agent", "world", "phase", "trial", "motions", "error_px"} <= {*rows.columns}
    with pytest.raises(ConfigError, match="make its report with that code"):
        read_finished(FILES / "results.parquet", tmp_path)
