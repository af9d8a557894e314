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
from agents.base import storage
from agents.base.observation import Observation
from agents.calibrated.identification import identify
from agents.calibrated.prediction import Measurements, named
from agents.calibrated.robot_model import RobotModel
from calfree_gym.image import lengths_px
from calfree_gym.perturbations import CameraRoll
from experiments.evaluation import evaluate


def wandering(env, object_, motions, rng):
    """Observations of a trial of random motions about home, and the joints of the arm at each."""
    observation, info = env.reset(options={"object": object_})
    observations, joints = [Observation.of(observation)], [info["truth"]["joints"][:4]]
    for _ in range(motions):
        words = rng.uniform(-0.12, 0.12, 3) - observations[-1].registers
        observation, *_, info = env.step(words)
        observations.append(Observation.of(observation))
        joints.append(info["truth"]["joints"][:4])
    return observations, np.array(joints)


def wild(mount, seed, **changes):
    env = gym.make(
        "CalFree/Reach-v0", camera_mount=mount, dynamics="kinematic", terminate_on_success=False
    ).unwrapped
    env.reset(seed=seed)
    env.set_world(replace(env.world, **changes))
    return env


@pytest.mark.parametrize("seed", [3000, 3007, 3013])
def test_what_is_identified_predicts_what_was_not_seen(mount, seed):
    """Held-out images of both points and the motors' signs, from three trials without noise."""
    env, rng = wild(mount, seed, point_noise=0.0), np.random.default_rng(seed)
    measured, held_out = Measurements.none(), []
    for place in ((0.38, 0.1, 0.1), (0.42, -0.1, 0.2), (0.45, 0.05, 0.06)):
        trial, _ = wandering(env, place, 10, rng)
        measured = measured.with_trial(trial[:-3])
        held_out.append(Measurements.none().with_trial(trial[-3:]))
    built = RobotModel.of(calfree_gym.nominal(), mount)
    found = identify(measured, built)
    np.testing.assert_array_equal(found.signs, env.world.motor_sign)
    assert np.abs(found.residuals_px).max() < 0.5
    model = found.model(built)
    for trial, object_ in zip(held_out, found.objects, strict=True):
        predicted = model.points(trial.registers, np.tile(object_, (len(trial.registers), 1)))
        assert lengths_px(predicted - trial.points)[trial.seen].max() < 2


def test_true_parameters_come_out_where_images_determine_them(mount):
    """Elbow angles do not hang on where the frame lies or how large the world is."""
    env, rng = wild(mount, 3002, point_noise=0.0), np.random.default_rng(0)
    measured, angles = Measurements.none(), []
    for place in ((0.38, 0.1, 0.1), (0.42, -0.1, 0.2), (0.45, 0.05, 0.06), (0.36, -0.05, 0.15)):
        trial, joints = wandering(env, place, 20, rng)
        measured, angles = measured.with_trial(trial), [*angles, joints]
    built = RobotModel.of(calfree_gym.nominal(), mount)
    found = identify(measured, built)
    model = found.model(built)
    turned, true = model.joints(measured.registers), np.concatenate(angles)
    np.testing.assert_allclose(turned[:, 2] - turned[0, 2], true[:, 2] - true[0, 2], atol=0.03)
    assert np.ptp(true[:, 2]) > 0.3


def test_measurements_are_inconsistent_where_the_world_has_changed_and_not_where_it_has_not(mount):
    env, rng = wild(mount, 3004), np.random.default_rng(1)
    built = RobotModel.of(calfree_gym.nominal(), mount)
    measured = Measurements.none()
    for place in ((0.38, 0.1, 0.1), (0.42, -0.1, 0.2), (0.45, 0.05, 0.06)):
        measured = measured.with_trial(wandering(env, place, 6, rng)[0])
    known = identify(measured, built)
    assert 0.25 < np.sqrt(np.mean(known.residuals_px**2)) < 0.55
    innovations = []
    for world in (env.world, CameraRoll("right", 8.0).apply(env.world, rng)):
        env.set_world(world)
        later = measured.with_trial(wandering(env, (0.40, 0.0, 0.15), 3, rng)[0])
        innovations.append(known.innovation(identify(later, built, known=known), noise_px=0.5))
    assert innovations[0] < 12 < 50 < innovations[1]


def test_it_reaches_in_wild_worlds_beginning_with_nothing(mount):
    records = []
    for seed in range(3020, 3035):
        env = gym.make("CalFree/Reach-v0", camera_mount=mount, dynamics="kinematic")
        records += evaluate(agents.make("self_calibrating", env, camera_mount=mount), env, 1, seed)
    assert np.mean([record.rendezvous for record in records]) >= 0.93
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


def test_after_sixty_motions_it_reaches_at_once(mount):
    records = held_out_records(mount, range(3040, 3042), trials=8)
    assert np.mean([record.rendezvous for record in records]) >= 0.93
    assert np.mean([record.motions for record in records]) <= 2


@pytest.mark.slow
def test_after_sixty_motions_it_reaches_at_once_in_many_worlds(mount):
    records = held_out_records(mount, range(3050, 3080), trials=5)
    assert np.mean([record.rendezvous for record in records]) >= 0.95
    assert np.median([record.motions for record in records]) <= 2


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


@pytest.fixture(scope="module")
def learned(make_env):
    """A robot that has identified itself in a wild world."""
    env = make_env()
    env.reset(seed=3000)
    return agents.make("self_calibrating", env).learn(12)


def in_version_0_1(arrays):
    """Arrays as version 0.1 saved them: eight coordinates, each with its flag, a measurement."""
    flat = {name: arrays[name].reshape(-1, 8) for name in ("points", "residuals_px")}
    kept = {name: array for name, array in arrays.items() if name != "residuals_px"}
    return {
        **kept,
        "points": flat["points"],
        "off_px": flat["residuals_px"],
        "seen": np.repeat(arrays["seen"], 2, 1),
    }


def test_what_it_has_measured_and_identified_is_saved_and_loaded(learned, tmp_path):
    learned.save(tmp_path / "robot.npz")
    loaded = agents.make("self_calibrating", learned.env).load(tmp_path / "robot.npz").arrays()
    assert loaded["points"].shape[1:] == (4, 2)
    assert loaded["seen"].shape[1:] == (4,)
    assert loaded.keys() == learned.arrays().keys()
    for name, array in learned.arrays().items():
        np.testing.assert_array_equal(loaded[name], array)


def test_files_of_version_0_1_load_with_a_warning(learned, tmp_path):
    """They go on as if they had been saved today: same arrays, same words."""
    storage.save(tmp_path / "old.npz", learned.kind, in_version_0_1(learned.arrays()), 12, 3)
    robot = agents.make("self_calibrating", learned.env)
    with pytest.warns(UserWarning, match=r"version 0\.1"):
        robot.load(tmp_path / "old.npz")
    assert robot.num_timesteps == 12
    for name, array in learned.arrays().items():
        np.testing.assert_array_equal(robot.arrays()[name], array)
    home, _ = learned.env.reset(seed=3001)
    np.testing.assert_array_equal(robot.predict(home)[0], learned.predict(home)[0])


def test_files_from_before_there_were_kinds_of_models_load_with_a_warning(learned, tmp_path):
    storage.save(tmp_path / "old.npz", "SelfCalibrating(camera_mount='waist')", learned.arrays(), 12, 3)
    with pytest.warns(UserWarning, match=r"motor_curve='cubic', lens='radial'\)"):
        agents.make("self_calibrating", learned.env).load(tmp_path / "old.npz")
    with pytest.raises(ValueError, match=r"this agent is .*motor_curve='linear'"):
        agents.make("self_calibrating", learned.env, motor_curve="linear").load(tmp_path / "old.npz")


def test_a_model_that_is_wrong_in_kind_lacks_curvature_and_distortion():
    """It identifies all the rest, and still reaches where motors are curved and lenses distort."""
    env = gym.make("CalFree/Reach-v0", dynamics="kinematic")
    env.reset(seed=3004)
    wrong = {"motor_curve": "linear", "lens": "none"}
    robot = agents.make("self_calibrating", env, **wrong).learn(25)
    found = named(robot.calibration.known.parameters)
    for name in found:
        lacks = name in ("motor_curvature", "lens_k1")
        assert (np.abs(found[name]) < 1e-6).all() == lacks

    records = evaluate(robot, env, trials=4, seed=8)
    assert all(record.rendezvous for record in records)


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"points": np.zeros((5, 4))}, r"points have shape \(5, 4\), here \(any, 4, 2\) is wanted"),
        ({"seen": np.ones((3, 4), bool)}, "seen have shape"),
        ({"registers": np.zeros((2, 3))}, "registers have shape"),
        ({"parameters": np.zeros(30)}, r"parameters have shape \(30,\), here \(31\) is wanted"),
        ({"objects": np.zeros((0, 3))}, "objects have shape"),
        ({"signs": None}, "holds no signs"),
        ({"residuals_px": None}, "holds no residuals_px"),
        ({"trial": np.full(1000, 1)}, "trial have shape"),
    ],
)
def test_damaged_files_are_errors_that_say_what_is_wrong(learned, tmp_path, change, error):
    arrays = learned.arrays()
    arrays = {name: array for name, array in {**arrays, **change}.items() if array is not None}
    storage.save(tmp_path / "damaged.npz", learned.kind, arrays, 12, 3)
    robot = agents.make("self_calibrating", learned.env)
    with pytest.raises(ValueError, match=f"damaged.npz is damaged: .*{error}"):
        robot.load(tmp_path / "damaged.npz")
    assert not robot.arrays()


def test_trials_that_do_not_count_from_0_are_an_error(learned):
    arrays = learned.arrays()
    with pytest.raises(ValueError, match="trial must count from 0"):
        Measurements.of_arrays({**arrays, "trial": arrays["trial"] + 1})


def test_of_many_measurements_the_latest_are_kept(learned):
    """Their trials are counted from 0 again."""
    measured = Measurements.of_arrays(learned.arrays())
    latest = measured.latest(3)
    np.testing.assert_array_equal(latest.points, measured.points[-3:])
    np.testing.assert_array_equal(latest.trial, measured.trial[-3:] - measured.trial[-3])


def test_what_is_not_needed_is_not_loaded():
    code = (
        "import gymnasium, agents, sys; e = gymnasium.make('calfree_gym:CalFree/Reach-v0');"
        "[agents.make(name, e) for name in ('model_based', 'self_calibrating')];"
        "print(sorted({'torch', 'scipy'} & sys.modules.keys()))"
    )
    root = Path(agents.__file__).parents[1]
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
