"""`polynomial` and `simulation_prior`: they reach, remember, forget a moved camera; their regression."""

from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import agents
from agents.base.observation import Observation
from agents.rivals import train
from agents.rivals.prior import KEPT, load_prior
from agents.rivals.regression_agent import RegressionAgent
from calfree_gym.world import WorldDistribution
from experiments.config.loading import read_mapping
from experiments.running.run import world_seeds
from tests.agents.trials import STAND_FIRST, carry_out
from tests.arms.own import ARMS

CONFIGS = (Path(__file__).parents[3] / "configs").glob("*.yaml")
SUITES = sorted(path for path in CONFIGS if "\nquestion:" in path.read_text())
UNSEEN = 1000


@pytest.fixture(params=["polynomial", "simulation_prior"])
def name(request):
    return request.param


@pytest.mark.parametrize("mount", STAND_FIRST)
def test_it_reaches_in_worlds_that_it_never_saw_and_remembers(name, mount, live, make_env):
    settings = {"camera_mount": mount} if name == "simulation_prior" else {}
    lives = [live(name, make_env(mount), UNSEEN + i, 10, **settings)[1] for i in (0, 1)]
    assert np.max(lives) < 60
    motions = np.mean(lives, 0)
    assert motions[5:].mean() < motions[0] / 2


def test_what_a_moved_camera_saw_is_forgotten_and_the_other_s_is_kept(name, live, make_env):
    aimed = [{"at": {"trial": 6}, "do": {"type": "camera_aim", "camera": "left", "degrees": 20}}]
    agent, _ = live(name, make_env(perturbations=aimed), UNSEEN, trials=7)
    left, right = (np.isfinite(agent.looks.points[:, 0, side]).all(1) for side in (slice(2), slice(2, 4)))
    forgotten = int(left.argmax())
    assert forgotten >= 12, "six trials: at home, and after a motion at least"
    assert left[forgotten:].all()
    assert right.all()


def test_a_camera_that_was_once_mistaken_at_home_is_not_forgotten(name, live, make_env):
    agent, _ = live(name, env := make_env(), UNSEEN, trials=4)
    right = Observation.of(env.reset()[0])
    mistaken = replace(right, points=right.points + np.array([[0.5], [0.0], [0.0], [0.0]]))
    findings, looks = agent.new_findings(), agent.looks
    carry_out(agent.procedure(mistaken, findings), lambda _: right, most=1)
    assert np.isfinite(findings.looks.points[: len(looks)]).sum() == np.isfinite(looks.points).sum()
    np.testing.assert_array_equal(findings.gripper_home, right.gripper)


@pytest.mark.parametrize("name", ["polynomial", pytest.param("simulation_prior", marks=pytest.mark.slow)])
def test_of_a_long_life_the_latest_looks_are_kept_and_a_moved_camera_is_met_by_them(
    name, live, make_env, monkeypatch
):
    aimed = [{"at": {"trial": 8}, "do": {"type": "camera_aim", "camera": "left", "degrees": 20}}]
    lives = []
    for kept in (10_000, 20):
        monkeypatch.setattr(RegressionAgent, "KEPT", kept)
        lives.append(live(name, make_env(), UNSEEN, trials=8))
        assert max(live(name, make_env(perturbations=aimed), UNSEEN, trials=12)[1]) < 60
    (all_, counts), (latest, same) = lives
    assert counts == same
    assert len(all_.looks) > len(latest.looks) == 20
    assert np.array_equal(latest.looks.points, all_.looks.points[-20:], equal_nan=True)


@pytest.mark.parametrize(
    ("trouble", "setting", "value"),
    [
        *[("point_dropout", "share", 0.2), ("point_outliers", "share", 0.1)],
        *[("point_noise", "px", 2.0), ("latency", "motions", 1)],
    ],
)
def test_points_that_are_hidden_mistaken_noisy_or_late(name, trouble, setting, value, live, make_env):
    trouble = [{"at": {"trial": 0}, "do": {"type": trouble, setting: value}}]
    env = make_env(perturbations=trouble, max_episode_steps=100)
    agent, counts = live(name, env, UNSEEN, trials=4)
    assert np.median(counts) < 30
    assert all(np.isfinite(array).all() for array in agent.images.arrays().values())


def test_a_reversed_motor_makes_it_forget_and_it_reaches_again(live, make_env):
    reversed_ = [{"at": {"trial": 40}, "do": {"type": "motor_sign", "motor": "elbow"}}]
    agent, counts = live("polynomial", make_env(perturbations=reversed_), 80_021, trials=44)
    assert len(agent.looks) < sum(counts[40:]) + 10, "those of trials before are forgotten"
    assert max(counts) < 60


@pytest.mark.parametrize(
    "arm", ["redundant", *(pytest.param(each, marks=pytest.mark.slow) for each in ("scara", "hobby"))]
)
def test_polynomials_reach_with_other_arms(arm, live):
    env = gym.make("calfree_gym:CalFree/Reach-v0", arm=ARMS[arm], camera_mount="stand", dynamics="kinematic")
    _, counts = live("polynomial", env, UNSEEN, trials=6)
    assert np.median(counts) < 60


def test_another_mount_or_prior_is_refused(tmp_path, make_env):
    with pytest.raises(FileNotFoundError, match="no such file"):
        agents.make("simulation_prior", make_env(), prior=str(tmp_path / "nowhere.npz"))
    agents.make("polynomial", make_env()).save(tmp_path / "other.npz")
    with pytest.raises(ValueError, match=r"holds Polynomial\(\)"):
        agents.make("simulation_prior", make_env(), prior=str(tmp_path / "other.npz"))
    agents.make("simulation_prior", make_env("stand"), camera_mount="stand").save(tmp_path / "stand.npz")
    with pytest.raises(ValueError, match="camera_mount='stand'"):
        agents.make("simulation_prior", make_env()).load(tmp_path / "stand.npz")


def test_a_prior_is_made_anew_by_its_command(tmp_path, make_env):
    path, tiny = tmp_path / "prior.npz", "--worlds 12 --objects 12 --motions 20 --components 8"
    train.main(f"--out {path} --worlds-from 910000 {tiny}".split())
    prior, training = load_prior(path, "stand", 3)
    assert prior.deviations.shape == (8,)
    assert training["worlds"] == 12
    assert not prior.basis[56:].any(), "on the stand no motor moves the object's image"
    assert agents.make("simulation_prior", make_env(), prior=str(path)).learn(5).num_timesteps == 5


@pytest.fixture(scope="module")
def of_training():
    """Seeds of the worlds in which priors and networks were trained, and some worlds of the priors."""
    prior = load_prior(KEPT, "waist", 3)[1]
    seeds = range(prior["worlds_from"], prior["worlds_from"] + prior["worlds"])
    nets = agents.make("in_context", gym.make("CalFree/Reach-v0", dynamics="kinematic")).training
    of_nets = range(nets["worlds_from"], nets["worlds_from"] + 2 * nets["worlds_a_mount"])
    return {*seeds, *of_nets}, [WorldDistribution("wild").sample(seed) for seed in seeds[::30]]


@pytest.mark.parametrize("path", SUITES, ids=lambda path: path.name)
def test_no_suite_has_a_world_of_the_training(path, of_training):
    suite = read_mapping(path)
    more = [each.get("worlds", 0) for each in suite["agents"] if isinstance(each, dict)]
    seeds = world_seeds(suite.get("seed", 0), max([suite["worlds"], *more]), suite.get("first_world"))
    assert of_training[0].isdisjoint(seeds)
    assert not any(WorldDistribution("wild").sample(seed) in of_training[1] for seed in seeds[:3])
