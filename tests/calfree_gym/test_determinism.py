"""One seed, one trajectory, bit by bit: alone or in a batch, here or in another process."""

import hashlib
import json
import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

from calfree_gym import world as worlds
from tests.arms.every import EVERY, arm_named
from tests.arms.own import ARMS

ID = "calfree_gym:CalFree/Reach-v0"
MOTIONS = 10
SCHEDULE = [
    {"at": {"motion": 4}, "do": {"type": "camera_replace"}},
    {"every": {"trial": 2}, "do": {"type": "motor_gain"}},
    {"drift": {"per": "trial"}, "do": {"type": "camera_aim"}},
    {"drift": {"per": "motion"}, "do": {"type": "camera_roll"}},
    {"at": {"motion": 2}, "do": {"type": "point_outliers"}},
    {"at": {"motion": 3}, "do": {"type": "point_dropout"}},
    {"at": {"motion": 6}, "do": {"type": "latency"}},
]
CASES = [
    pytest.param(mount, dynamics, perturbations, id=f"{mount}-{dynamics}-{name}")
    for mount in ("waist", "stand")
    for dynamics in ("physics", "kinematic")
    for name, perturbations in (("quiet", None), ("perturbed", SCHEDULE))
]


def words(seed, motors=3):
    return np.random.default_rng(seed).uniform(-0.2, 0.2, (MOTIONS, motors)).astype(np.float32)


def digest(*arrays):
    """A hash of numbers, down to their last bits."""
    return hashlib.sha256(b"".join(np.ascontiguousarray(a, np.float64).tobytes() for a in arrays)).hexdigest()


def numbers(observation, reward, over, info):
    observed = [observation[key] for key in sorted(observation)]
    truth = [info["truth"][key] for key in ("error_px", "distance_mm", "points", "object", "joints")]
    return [*observed, reward, over, info["robot_seconds"], *truth]


def trajectory(env, seed):
    """The digest of trials that end after five motions."""
    observation, info = env.reset(seed=seed)
    found = numbers(observation, 0.0, False, info)
    for i, word in enumerate(words(seed, *env.action_space.shape)):
        observation, reward, terminated, truncated, info = env.step(word)
        found += numbers(observation, reward, terminated or truncated, info)
        if i == 4:
            observation, info = env.reset()
            found += numbers(observation, 0.0, False, info)
    return digest(*found)


def row_trajectories(seeds, threads, **arguments):
    """The same of rows stepped together."""
    env = gym.make_vec(
        ID, num_envs=len(seeds), threads=threads, autoreset_mode="Disabled", max_episode_steps=99, **arguments
    )
    observation, infos = env.reset(seed=seeds)
    found = [[] for _ in seeds]

    def note(observation, reward, over, infos):
        for row, series in enumerate(found):
            own = {key: value[row] for key, value in observation.items()}
            truth = {key: value[row] for key, value in infos["truth"].items()}
            info = {"robot_seconds": infos["robot_seconds"][row], "truth": truth}
            series.extend(numbers(own, reward[row], over[row], info))

    none = np.zeros(len(seeds))
    note(observation, none, none, infos)
    for i, together in enumerate(np.stack([words(seed, env.action_space.shape[1]) for seed in seeds], 1)):
        observation, reward, terminated, truncated, infos = env.step(together)
        note(observation, reward, terminated | truncated, infos)
        if i == 4:
            observation, infos = env.reset(options={"reset_mask": np.ones(len(seeds), bool)})
            note(observation, none, none, infos)
    return [digest(*series) for series in found]


def made_trajectory(spec, seed):
    return trajectory(gym.make(spec, disable_env_checker=True), seed)


@pytest.mark.parametrize(("mount", "dynamics", "perturbations"), CASES)
def test_one_seed_is_one_trajectory(mount, dynamics, perturbations):
    arguments = {
        "camera_mount": mount,
        "dynamics": dynamics,
        "perturbations": perturbations,
        "terminate_on_success": False,
    }
    seeds = [3, 14, 15, 92, 6]
    alone = [trajectory(gym.make(ID, **arguments), seed) for seed in seeds]
    assert len(set(alone)) == len(seeds)
    for threads in (1, 2):
        assert row_trajectories(seeds, threads, **arguments) == alone
        assert row_trajectories(seeds[::-1], threads, **arguments) == alone[::-1]
        assert row_trajectories(seeds[2:4], threads, **arguments) == alone[2:4]


def test_one_seed_is_one_trajectory_in_other_processes_and_from_saved_specs():
    env = gym.make(ID, perturbations=SCHEDULE, terminate_on_success=False)
    here = trajectory(env, 5)
    assert made_trajectory(pickle.loads(pickle.dumps(env.spec)), 5) == here
    assert made_trajectory(EnvSpec.from_json(env.spec.to_json()), 5) == here
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as children:
        assert list(children.map(made_trajectory, [env.spec] * 2, [5, 5])) == [here, here]


OF_ANY_ARM = [
    {"at": {"motion": 4}, "do": {"type": "camera_replace"}},
    {"every": {"trial": 2}, "do": {"type": "motor_gain"}},
    {"drift": {"per": "trial"}, "do": {"type": "joint_zero"}},
    {"at": {"motion": 2}, "do": {"type": "backlash"}},
    {"at": {"trial": 0}, "do": {"type": "repeatability"}},
    {"at": {"trial": 0}, "do": {"type": "register_noise"}},
    {"at": {"motion": 1}, "do": {"type": "dead_zone", "words": 0.1}},
    {"at": {"motion": 3}, "do": {"type": "gear_ripple"}},
]


def spec_of(name):
    return gym.make(ID, arm=arm_named(name), perturbations=OF_ANY_ARM, terminate_on_success=False).spec


@pytest.mark.parametrize("dynamics", ["physics", pytest.param("kinematic", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", EVERY)
def test_one_seed_is_one_trajectory_of_any_arm(name, dynamics):
    arguments = {
        "arm": arm_named(name),
        "dynamics": dynamics,
        "perturbations": OF_ANY_ARM,
        "terminate_on_success": False,
    }
    seeds = [3, 14]
    alone = [trajectory(gym.make(ID, **arguments), seed) for seed in seeds]
    assert len(set(alone)) == len(seeds)
    for threads in (1, 2):
        assert row_trajectories(seeds, threads, **arguments) == alone


def test_one_seed_is_one_trajectory_of_any_arm_in_other_processes_and_from_saved_specs():
    specs = [spec_of(name) for name in ARMS]
    here = [made_trajectory(spec, 5) for spec in specs]
    assert len(set(here)) == len(ARMS)
    assert [made_trajectory(pickle.loads(pickle.dumps(spec)), 5) for spec in specs] == here
    assert [made_trajectory(EnvSpec.from_json(spec.to_json()), 5) for spec in specs] == here
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as child:
        assert list(child.map(made_trajectory, specs, [5] * len(specs))) == here


def test_rows_in_spawned_children_are_the_batched_rows():
    def steps(mode, **vector):
        env = gym.make_vec(
            ID, num_envs=2, vectorization_mode=mode, vector_kwargs=vector, perturbations=SCHEDULE
        )
        found = [env.reset(seed=8)[0]]
        found += [env.step(np.stack([word, -word]))[0] for word in words(0)]
        env.close()
        return digest(*(o[key].copy() for o in found for key in sorted(o)))

    assert steps("async", context="spawn") == steps("vector_entry_point")


def test_a_new_world_field_moves_no_other_draw(monkeypatch):
    def trajectories():
        return [trajectory(gym.make(ID, perturbations=SCHEDULE), seed) for seed in range(3)]

    before = trajectories()
    wild = worlds.DISTRIBUTIONS["wild"]
    drawn = []

    def with_a_new_field(draw, robot):
        drawn.append(draw("new_field").standard_normal(7))
        return wild(draw, robot)

    monkeypatch.setitem(worlds.DISTRIBUTIONS, "wild", with_a_new_field)
    assert trajectories() == before
    assert drawn


def test_a_world_goes_through_json_exactly():
    world = worlds.WorldDistribution("wild").sample(7)
    assert worlds.World.from_dict(json.loads(json.dumps(world.to_dict()))) == world
