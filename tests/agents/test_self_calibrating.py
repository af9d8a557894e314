"""The robot that identifies itself, against the simulation and the numbers asked of it."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import agents
import calfree_gym
from agents.base.observation import Observation
from agents.calibrated.identification import identify
from agents.calibrated.model import CalibratedModel
from agents.calibrated.observations import Looks
from agents.calibrated.parameters import model_of
from calfree_gym.perturbations import CameraRoll
from experiments.evaluation import evaluate

MOUNTS = calfree_gym.MOUNTS


def wandering(env, object_, motions, rng):
    """Looks of a trial of random motions about home, and the joints of the arm at each."""
    observation, info = env.reset(options={"object": object_})
    looks, joints = [Observation.of(observation)], [info["truth"]["joints"][:4]]
    for _ in range(motions):
        words = rng.uniform(-0.12, 0.12, 3) - looks[-1].registers
        observation, *_, info = env.step(words)
        looks.append(Observation.of(observation))
        joints.append(info["truth"]["joints"][:4])
    return looks, np.array(joints)


def wild(mount, seed, **changes):
    env = gym.make(
        "CalFree/Reach-v0", camera_mount=mount, dynamics="kinematic", terminate_on_success=False
    ).unwrapped
    env.reset(seed=seed)
    env.set_world(replace(env.world, **changes))
    return env


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("seed", [3000, 3007, 3013])
def test_what_is_identified_predicts_what_was_not_seen(mount, seed):
    """Held-out images of both points and the motors' signs, from the looks of three trials without noise."""
    env, rng = wild(mount, seed, point_noise=0.0), np.random.default_rng(seed)
    looks, held_out = Looks.none(), []
    for place in ((0.38, 0.1, 0.1), (0.42, -0.1, 0.2), (0.45, 0.05, 0.06)):
        trial, _ = wandering(env, place, 10, rng)
        looks = looks.and_trial(trial[:-3])
        held_out.append(Looks.none().and_trial(trial[-3:]))
    built = CalibratedModel.of(calfree_gym.nominal(), mount)
    found = identify(looks, built)
    np.testing.assert_array_equal(found.signs, env.world.motor_sign)
    assert np.abs(found.off_px).max() < 0.5
    model = model_of(built, found.signs, found.parameters)
    for trial, object_ in zip(held_out, found.objects, strict=True):
        joints = model.joints(trial.registers)
        objects = np.tile(object_, (len(joints), 1))
        images = [model.image(model.gripper(joints), joints), model.image(objects, joints)]
        off_px = 256 * np.abs(np.concatenate(images, -1) - trial.points)[trial.seen]
        assert off_px.max() < 2


@pytest.mark.parametrize("mount", MOUNTS)
def test_true_parameters_come_out_where_images_determine_them(mount):
    """Elbow angles do not hang on where the frame lies or how large the world is."""
    env, rng = wild(mount, 3002, point_noise=0.0), np.random.default_rng(0)
    looks, angles = Looks.none(), []
    for place in ((0.38, 0.1, 0.1), (0.42, -0.1, 0.2), (0.45, 0.05, 0.06), (0.36, -0.05, 0.15)):
        trial, joints = wandering(env, place, 20, rng)
        looks, angles = looks.and_trial(trial), [*angles, joints]
    built = CalibratedModel.of(calfree_gym.nominal(), mount)
    found = identify(looks, built)
    model = model_of(built, found.signs, found.parameters)
    turned, true = model.joints(looks.registers), np.concatenate(angles)
    np.testing.assert_allclose(turned[:, 2] - turned[0, 2], true[:, 2] - true[0, 2], atol=0.03)
    assert np.ptp(true[:, 2]) > 0.3


@pytest.mark.parametrize("mount", MOUNTS)
def test_looks_surprise_where_the_world_has_changed_and_not_where_it_has_not(mount):
    env, rng = wild(mount, 3004), np.random.default_rng(1)
    built = CalibratedModel.of(calfree_gym.nominal(), mount)
    looks = Looks.none()
    for place in ((0.38, 0.1, 0.1), (0.42, -0.1, 0.2), (0.45, 0.05, 0.06)):
        looks = looks.and_trial(wandering(env, place, 6, rng)[0])
    known = identify(looks, built)
    assert 0.25 < np.sqrt(np.mean(known.off_px**2)) < 0.55
    surprises = []
    for world in (env.world, CameraRoll("right", 8.0).apply(env.world, rng)):
        env.set_world(world)
        later = looks.and_trial(wandering(env, (0.40, 0.0, 0.15), 3, rng)[0])
        surprises.append(known.innovation(identify(later, built, known=known), noise_px=0.5))
    assert surprises[0] < 12 < 50 < surprises[1]


@pytest.mark.parametrize("mount", MOUNTS)
def test_it_reaches_in_wild_worlds_beginning_with_nothing(mount):
    records = []
    for seed in range(3020, 3035):
        env = gym.make("CalFree/Reach-v0", camera_mount=mount, dynamics="kinematic")
        records += evaluate(agents.make("self_calibrating", env, camera_mount=mount), env, 1, seed)
    assert np.mean([record.success for record in records]) >= 0.93
    assert np.median([record.motions for record in records]) <= 9


def held_out_records(mount, seeds, trials):
    records = []
    for seed in seeds:
        env = gym.make("CalFree/Reach-v0", camera_mount=mount, dynamics="kinematic")
        env.reset(seed=seed)
        agent = agents.make("self_calibrating", env, camera_mount=mount).learn(60)
        assert agent.num_timesteps == 60
        held_out = gym.make(
            "CalFree/Reach-v0", camera_mount=mount, dynamics="kinematic", world=env.unwrapped.world
        )
        records += evaluate(agent, held_out, trials, seed=seed + 10_000)
    return records


@pytest.mark.parametrize("mount", MOUNTS)
def test_after_sixty_motions_it_reaches_at_once(mount):
    records = held_out_records(mount, range(3040, 3042), trials=8)
    assert np.mean([record.success for record in records]) >= 0.93
    assert np.mean([record.motions for record in records]) <= 2


@pytest.mark.slow
@pytest.mark.parametrize("mount", MOUNTS)
def test_after_sixty_motions_it_reaches_at_once_in_many_worlds(mount):
    records = held_out_records(mount, range(3050, 3080), trials=5)
    assert np.mean([record.success for record in records]) >= 0.95
    assert np.median([record.motions for record in records]) <= 2


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("change", [{"type": "camera_roll"}, {"type": "motor_sign"}])
def test_it_keeps_determining_the_parameters(mount, change):
    """A camera rolled, a motor reversed: found out within a trial, and known from then on."""
    env = gym.make(
        "CalFree/Reach-v0",
        camera_mount=mount,
        dynamics="kinematic",
        perturbations=[{"at": {"trial": 3}, "do": change}],
    )
    counted = gym.wrappers.RecordEpisodeStatistics(env)
    env.reset(seed=3003)
    agent = agents.make("self_calibrating", counted, camera_mount=mount)
    agent.learn(1000, callback=lambda _: counted.episode_count < 9)
    motions = np.array(counted.length_queue)
    assert motions[2] > motions[1]
    assert motions[2] <= 15
    assert motions[5:].mean() <= 2.5


def test_what_is_not_needed_is_not_loaded():
    code = (
        "import gymnasium, agents, sys; e = gymnasium.make('calfree_gym:CalFree/Reach-v0');"
        "[agents.make(name, e) for name in ('model_based', 'self_calibrating')];"
        "print(sorted({'torch', 'scipy'} & sys.modules.keys()))"
    )
    root = Path(agents.__file__).parents[1]
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
