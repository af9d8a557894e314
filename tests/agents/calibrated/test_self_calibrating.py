"""The robot that identifies itself, against the simulation and the numbers asked of it."""

import numpy as np
import pytest

import agents
import calfree_gym
from agents.base.observation import Observation
from agents.calibrated.identification import identify
from agents.calibrated.prediction import Measurements, named
from agents.calibrated.robot_model import RobotModel
from agents.calibrated.self_calibrating import Validity, ValidityCheck
from calfree_gym.image import lengths_px
from experiments.evaluation import evaluate
from tests.agents.trials import STAND_FIRST

PLACES = ((0.38, 0.1, 0.1), (0.42, -0.1, 0.2), (0.45, 0.05, 0.06), (0.36, -0.05, 0.15))


def wandering(env, place, motions, rng):
    """Observations of a trial of random motions about home, and the joints of the arm at each."""
    observation, info = env.reset(options={"object": place})
    observations, joints = [Observation.of(observation)], [info["truth"]["joints"][:4]]
    for _ in range(motions):
        words = rng.uniform(-0.12, 0.12, 3) - observations[-1].registers
        observation, *_, info = env.step(words)
        observations.append(Observation.of(observation))
        joints.append(info["truth"]["joints"][:4])
    return observations, np.array(joints)


@pytest.mark.parametrize("seed", [3000, 3007, 3013])
def test_what_is_identified_predicts_what_was_not_seen(noise_free, mount, seed):
    env, rng = noise_free(mount, seed, terminate_on_success=False), np.random.default_rng(seed)
    measured, held_out = Measurements.none(), []
    for place in PLACES[:3]:
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


@pytest.mark.parametrize(
    ("worlds", "trials", "least", "typical"),
    [
        (range(3040, 3042), 8, 0.93, np.mean),
        pytest.param(range(3050, 3080), 5, 0.95, np.median, marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize("mount", STAND_FIRST)
def test_after_sixty_motions_it_reaches_at_once(make_env, mount, worlds, trials, least, typical):
    records = []
    for seed in worlds:
        env = make_env(mount)
        env.reset(seed=seed)
        agent = agents.make("self_calibrating", env, camera_mount=mount).learn(60)
        held_out = make_env(mount, world=env.unwrapped.world)
        records += evaluate(agent, held_out, trials, seed=seed + 10_000)
    assert np.mean([record.rendezvous for record in records]) >= least
    assert typical([record.motions for record in records]) <= 2


@pytest.mark.parametrize("change", ["camera_roll", "motor_sign"])
def test_it_keeps_determining_the_parameters(live, make_env, mount, change):
    env = make_env(mount, perturbations=[{"at": {"trial": 3}, "do": {"type": change}}])
    env.reset(seed=3003)
    _, motions = live("self_calibrating", env, trials=9, camera_mount=mount)
    assert motions[2] > motions[1]
    assert motions[2] <= 15
    assert np.mean(motions[5:]) <= 2.5


def test_a_model_that_is_wrong_in_kind_lacks_curvature_and_distortion(make_env):
    env = make_env()
    env.reset(seed=3004)
    robot = agents.make("self_calibrating", env, motor_curve="linear", lens="none").learn(25)
    for name, values in named(robot.calibration.known.parameters).items():
        assert (np.abs(values) < 1e-6).all() == (name in ("motor_curvature", "lens_k1"))
    assert all(record.rendezvous for record in evaluate(robot, env, trials=4, seed=8))


USUAL, INCONSISTENT, NEAR_PX, FAR_PX, NOISE_PX = 4.0, 60.0, 1.0, 5.0, 0.5
VALID, DOUBTED, UNKNOWN, INVALID = Validity.VALID, Validity.DOUBTED, Validity.NOISE_UNKNOWN, Validity.INVALID


@pytest.mark.parametrize(
    ("innovations", "off_px", "noise_px", "judged"),
    [
        ([USUAL, INCONSISTENT] * 2, FAR_PX, NOISE_PX, [VALID, DOUBTED] * 2),  # single ones are doubts only
        ([INCONSISTENT] * 5, NEAR_PX, NOISE_PX, [DOUBTED, UNKNOWN, INVALID, DOUBTED, INVALID]),
        ([USUAL] * 8, FAR_PX, NOISE_PX, [VALID] * 6 + [DOUBTED, UNKNOWN]),  # missing again and again
        ([USUAL] * 20, FAR_PX, 2.0, [VALID] * 20),  # in noise a distance is no miss
    ],
)
def test_what_was_identified_ceases_to_hold_by_contradictions_in_a_row(innovations, off_px, noise_px, judged):
    check = ValidityCheck()
    assert [check.judge(each, off_px, noise_px) for each in innovations] == judged
    check.begin()
    assert check.judge(USUAL, FAR_PX, NOISE_PX) is VALID, "until something new is identified"


def test_how_noisy_points_are_is_known_in_the_next_trial(make_env, tmp_path):
    noise = {"at": {"motion": 0}, "do": {"type": "point_noise", "px": 8}}
    env = make_env(tolerance_px=16, perturbations=[noise])
    env.reset(seed=3000)
    agents.make("self_calibrating", env).learn(40).save(tmp_path / "known.npz")
    agent = agents.make("self_calibrating", env).load(tmp_path / "known.npz")
    assert 4 < agent.new_findings().filter.noise.px < 16
