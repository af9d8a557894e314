"""The examples run as they are told to, and do what they say."""

import json
import pydoc
import re
import sys

import matplotlib.pyplot as plt
import numpy as np
import pytest
import stable_baselines3
import torch
import yaml
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.utils import LinearSchedule
from torch.nn.utils import parameters_to_vector

from tests.calfree_gym.environments import example
from tests.test_wheel import REPOSITORY, run

EXAMPLES = REPOSITORY / "examples"


def output(script, *arguments):
    """What a script prints."""
    return run(sys.executable, str(EXAMPLES / script), *arguments, PYTHONPATH=str(REPOSITORY))


@pytest.mark.parametrize("mount", ["waist", "stand"])
def test_servo_reaches_in_wild_worlds(mount):
    *worlds, summary = output("servo.py", "--trials", "40", "--mount", mount).splitlines()
    reached = [re.fullmatch(r"world \d+: reached in (\d+) motions", world) for world in worlds]
    motions = [int(match[1]) for match in reached if match]
    assert len(motions) >= 38
    assert min(motions) > 3, "fewer than the test motions"
    assert f"reached in {len(motions)} of 40 worlds" in summary


def test_a_knocked_camera_stops_no_servo():
    lines = output("knocked_camera.py", "--motions", "200", "--degrees", "30").splitlines()
    (knocked,) = (i for i, line in enumerate(lines) if "camera_aim" in line)
    assert 5 < knocked < len(lines) - 5
    outcomes = [line.split()[2] for line in lines]
    assert outcomes.count("reached") >= len(lines) - 1
    assert "'degrees': 30.0" in lines[knocked]


@pytest.mark.slow
@pytest.mark.parametrize("script", ["ppo_sb3.py", "ppo_cleanrl.py", "sac_her_sb3.py"])
def test_learners_learn(script):
    assert float(re.search(r"([\d.]+)%", output(script).splitlines()[-1])[1]) > 75


def test_advantages_are_the_returns_of_each_trial(monkeypatch):
    """Where lambda is 1: against returns that are summed forwards until a trial or the rollout ends."""
    ppo = example("ppo_cleanrl")
    monkeypatch.setattr(ppo, "GAE_LAMBDA", 1.0)
    rng, steps, envs = np.random.default_rng(0), 40, 6
    values, rewards = rng.normal(size=(steps + 1, envs)), rng.normal(size=(steps, envs))
    over = rng.random((steps, envs)) < 0.2
    over[1:] &= ~over[:-1]  # the step after a trial's end resets, and ends none
    terminated = over & (rng.random((steps, envs)) < 0.5)
    arrays = (rewards, values, terminated.astype(float), over.astype(float))
    estimates = ppo.advantages(*map(torch.as_tensor, arrays)).numpy()
    for env in range(envs):
        for start in range(steps):
            end = start
            while not over[end, env] and end < steps - 1:
                end += 1
            discounts = ppo.GAMMA ** np.arange(end - start + 2)
            rest = 0.0 if terminated[end, env] else values[end + 1, env]
            gained = discounts @ np.append(rewards[start : end + 1, env], rest)
            assert estimates[start, env] == pytest.approx(gained - values[start, env])


ZOO = {
    f"{path.stem} {env_id}": (path.stem, settings)
    for path in sorted((EXAMPLES / "zoo").glob("*.yml"))
    for env_id, settings in yaml.safe_load(path.read_text()).items()
}


@pytest.mark.parametrize("name", ZOO)
def test_zoo_settings_build_and_train(name):
    """Read as rl-baselines3-zoo reads them; itself it is no dependency."""
    torch.set_num_threads(1)
    algorithm, settings = ZOO[name]
    settings = dict(settings)
    assert 1e4 <= settings.pop("n_timesteps") <= 1e6
    (wrapper, arguments), *_ = *settings.pop("env_wrapper", [{}])[0].items(), (None, {})
    env = make_vec_env(
        "calfree_gym:" + name.split()[1],
        n_envs=settings.pop("n_envs", 1),
        env_kwargs=settings.pop("env_kwargs"),
        wrapper_class=pydoc.locate(wrapper) if wrapper else None,
        wrapper_kwargs=arguments,
    )
    if isinstance(rate := settings["learning_rate"], str):
        settings["learning_rate"] = LinearSchedule(float(rate.removeprefix("lin_")), 0.0, 1.0)
    if buffer := settings.get("replay_buffer_class"):
        settings["replay_buffer_class"] = getattr(stable_baselines3, buffer)
    if "learning_starts" in settings:
        settings["learning_starts"] = 100
    model = getattr(stable_baselines3, algorithm.upper())(env=env, device="cpu", **settings)
    before = parameters_to_vector(model.policy.parameters()).detach().clone()
    model.learn(110 if algorithm == "sac" else 4096)
    assert not torch.equal(before, parameters_to_vector(model.policy.parameters()))


def test_the_notebook_runs_from_top_to_bottom():
    plt.switch_backend("agg")
    cells = json.loads((EXAMPLES / "first_reach.ipynb").read_text())["cells"]
    names = {}
    for cell in cells:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
            assert cell["outputs"] == [], "what is printed is made anew"
    plt.close("all")
    first, *later = names["reaches"].values()
    assert first[-1] < 4 < first[0]
    assert max(map(len, later)) < len(first)
