"""Backlash and repeatability, measured at the joints as one would on a real arm, against what was set."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from calfree_gym import nominal
from calfree_gym.robot.arms.arm import robot_of
from tests.arms.every import arm_named

ID = "calfree_gym:CalFree/Reach-v0"
ARMS = ("movemaster", "scara", "gantry")
SWEEP = 10
STEP = 0.02


def arm_of(name):
    return name if name == "movemaster" else arm_named(name)


def made(name, rows=1, dynamics="kinematic", perturbations=None, **fields):
    """Rows in one world whose motors have these errors, on a stand, and the arm's motors."""
    arm = arm_of(name)
    robot = robot_of(arm)
    env = gym.make_vec(
        ID,
        num_envs=rows,
        threads=1,
        arm=arm,
        camera_mount="stand",
        dynamics=dynamics,
        world=replace(nominal(robot), **fields),
        perturbations=perturbations,
        terminate_on_success=False,
        autoreset_mode="Disabled",
        max_episode_steps=10**6,
    )
    return env, robot


def gaps(robot):
    """Another one a motor, in rad or m."""
    return np.linspace(0.004, 0.012, len(robot.motors)) * robot.span


def joints(infos, robot):
    """Positions of the motors' joints (rows, m)."""
    return infos["truth"]["joints"][:, : len(robot.motors)]


def sweep(env, robot, motor):
    """Where the joints come to rest on the way up and down (2, SWEEP, m), at the same registers."""
    word = np.zeros((1, len(robot.motors)))
    word[0, motor] = STEP
    env.reset(seed=0)
    env.step(-word)
    up = [joints(env.step(word)[-1], robot)[0] for _ in range(SWEEP)]
    env.step(word)
    down = [joints(env.step(-word)[-1], robot)[0] for _ in range(SWEEP)]
    return np.array([up, down[::-1]])


@pytest.mark.parametrize(
    ("dynamics", "share"), [("kinematic", 1e-9), ("physics", 0.02)], ids=["kinematic", "physics"]
)
@pytest.mark.parametrize("name", ARMS)
def test_the_hysteresis_loop_is_as_wide_as_was_set(name, dynamics, share):
    (env, robot), (exact, _) = (
        made(name, dynamics=dynamics, backlash=gaps(robot_of(arm_of(name)))),
        made(name, dynamics=dynamics),
    )
    for motor, gap in enumerate(gaps(robot)):
        up, down = sweep(env, robot, motor)
        true_up, true_down = sweep(exact, robot, motor)
        assert true_up[:, motor] == pytest.approx(true_down[:, motor], abs=share * gap)
        assert down[:, motor] - up[:, motor] == pytest.approx(np.full(SWEEP, gap), rel=share)
        assert true_up[:, motor] - up[:, motor] == pytest.approx(np.full(SWEEP, gap / 2), rel=2 * share)
        others = np.delete(np.arange(len(robot.motors)), motor)
        assert np.delete(up, motor, 1) == pytest.approx(
            np.broadcast_to(robot.home[others], (SWEEP, len(others))), abs=share * gap
        )


@pytest.mark.parametrize("name", ARMS)
def test_within_the_gap_a_joint_stays(name):
    """Play: after a turn the joint waits until the motor has gone through the gap."""
    env, robot = made(name, backlash=gaps(robot_of(arm_of(name))))
    env.reset(seed=0)
    half_gap = gaps(robot) / 2 / robot.span
    words = np.full((1, len(robot.motors)), 0.2)
    there = joints(env.step(words)[-1], robot)
    for share in (-0.9, -0.9, 0.9, 0.9):  # of half a gap: never through it
        assert (joints(env.step(share * half_gap[None])[-1], robot) == there).all()
    beyond = there - joints(env.step(-3 * half_gap[None])[-1], robot)
    assert beyond == pytest.approx(half_gap[None] * robot.span, rel=1e-6)


REPEATS = 20
ROWS = 100


def spread(name, sigma, seed=0):
    """Deviations (trials of motions, m) of motions between two registers from where they should end."""
    (env, robot), (exact, _) = (
        made(name, ROWS, repeatability=sigma(robot_of(arm_of(name)))),
        made(name),
    )
    word = np.full((1, len(robot.motors)), 0.1)
    exact.reset(seed=0)
    ends = [joints(exact.step(sign * word)[-1], robot) for sign in (1, -1)]
    homes = [joints(env.reset(seed=seed)[-1], robot) - ends[1]]
    motions = []
    for i in range(REPEATS):
        sign = 1 if i % 2 == 0 else -1
        motions.append(joints(env.step(sign * np.repeat(word, ROWS, 0))[-1], robot) - ends[i % 2])
    everybody = {"reset_mask": np.ones(ROWS, bool)}
    homes += [joints(env.reset(options=everybody)[-1], robot) - ends[1] for _ in range(REPEATS)]
    return np.array(motions), np.array(homes)


@pytest.mark.parametrize("name", ["movemaster", "gantry"])
def test_the_spread_of_motions_is_what_was_set(name):
    """The standard deviation of n numbers is that of their distribution within 1 / sqrt(2 n), one sigma."""

    def sigma(robot):
        return np.linspace(0.002, 0.006, len(robot.motors)) * robot.span

    robot = robot_of(arm_of(name))
    for found in spread(name, sigma):
        n = found.shape[0] * ROWS
        flat = found.reshape(n, -1) / sigma(robot)
        assert flat.std(0) == pytest.approx(np.ones(flat.shape[1]), abs=4.5 / np.sqrt(2 * n))
        assert flat.mean(0) == pytest.approx(np.zeros(flat.shape[1]), abs=4.5 / np.sqrt(n))
        of_motors = np.corrcoef(flat.T) - np.eye(flat.shape[1])
        of_motions = [np.corrcoef(found[:-1, :, m].ravel(), found[1:, :, m].ravel())[0, 1] for m in range(3)]
        assert np.abs(of_motors).max() < 4.5 / np.sqrt(n)
        assert np.abs(of_motions).max() < 4.5 / np.sqrt(n)
        assert np.abs(flat).max() < 6


@pytest.mark.parametrize("name", ARMS)
def test_a_motor_that_is_not_moved_stays_where_it_is(name):
    robot = robot_of(arm_of(name))
    env, _ = made(name, backlash=gaps(robot), repeatability=gaps(robot))
    env.reset(seed=3)
    before = joints(env.step(np.full((1, len(robot.motors)), 0.1))[-1], robot)
    nothing = np.zeros((1, len(robot.motors)))
    for _ in range(3):
        assert (joints(env.step(nothing)[-1], robot) == before).all()
    first = nothing.copy()
    first[0, 0] = 0.1
    after = joints(env.step(first)[-1], robot)
    assert after[0, 0] != before[0, 0]
    assert (after[0, 1:] == before[0, 1:]).all()


def test_each_seed_has_its_own_noise_and_repeats_it():
    robot = robot_of("movemaster")
    env, _ = made("movemaster", 2, repeatability=gaps(robot))

    def run(seed):
        found = [joints(env.reset(seed=seed)[-1], robot)]
        found += [joints(env.step(np.full((2, 3), 0.05))[-1], robot) for _ in range(3)]
        return np.array(found)

    zero, one = run(0), run(1)
    assert (run(0) == zero).all()
    assert (zero[:, 1] == one[:, 0]).all()
    assert (zero[:, 0] != one[:, 0]).all()


SCHEDULED = [("movemaster", "elbow", np.pi / 180), ("gantry", "y", 0.01)]


@pytest.mark.parametrize(("name", "motor", "unit"), SCHEDULED)
@pytest.mark.parametrize("error", ["backlash", "repeatability"])
def test_perturbations_set_a_motors_errors_and_drifts_add_to_them(error, name, motor, unit):
    robot = robot_of(arm_of(name))
    place = robot.motors.index(motor)

    def errors(entry, motions=4, **fields):
        entry = {**entry, "do": {"type": error, "motor": motor, "degrees": 0.5}}
        env, _ = made(name, perturbations=[entry], **fields)
        env.reset(seed=0)
        found = []
        for _ in range(motions):
            env.step(np.zeros((1, len(robot.motors))))
            found.append(getattr(env.unwrapped.worlds[0], error))
        assert (np.delete(found, place, 1) == 0).all()
        return np.array(found)[:, place] / unit

    other = {error: np.where(np.arange(len(robot.motors)) == place, 2 * unit, 0.0)}
    assert errors({"at": {"motion": 2}}) == pytest.approx([0, 0, 0.5, 0.5])
    assert errors({"at": {"motion": 2}}, **other) == pytest.approx([2, 2, 0.5, 0.5])
    assert np.diff(errors({"drift": {"per": "motion"}})) == pytest.approx([0.5, 0.5, 0.5])


@pytest.mark.parametrize("error", ["backlash", "repeatability"])
def test_errors_below_zero_are_refused_before_any_simulation(error):
    entry = {"at": {"motion": 2}, "do": {"type": error, "motor": "waist", "degrees": -1}}
    with pytest.raises(ValueError, match=rf"{error}.degrees is -1; it must be a number from 0 to 45"):
        made("movemaster", perturbations=[entry])


def test_a_backlash_that_comes_is_felt():
    """From the motion before which it comes: the joint then lags behind by half of it."""
    entry = {"at": {"motion": 2}, "do": {"type": "backlash", "motor": "waist", "degrees": 2.0}}
    (env, robot), (exact, _) = made("movemaster", perturbations=[entry]), made("movemaster")
    word = np.array([[0.05, 0, 0]])
    lags = []
    for each in (env, exact):
        each.reset(seed=0)
    for _ in range(4):
        lags.append(joints(exact.step(word)[-1], robot)[0, 0] - joints(env.step(word)[-1], robot)[0, 0])
    assert np.degrees(lags) == pytest.approx([0, 0, 1, 1])


@pytest.mark.parametrize("error", ["backlash", "repeatability"])
def test_an_error_that_begins_moves_no_motor_that_rests_whatever_other_rows_have(error):
    begins = [{"at": {"motion": 3}, "do": {"type": error, "motor": "shoulder", "degrees": 4}}]
    inexact = replace(nominal(), backlash=np.full(3, 0.02))
    arguments = {"dynamics": "kinematic", "perturbations": begins, "terminate_on_success": False}
    one = gym.make("CalFree/Reach-v0", world=nominal(), **arguments)
    rows = gym.make_vec("CalFree/Reach-v0", num_envs=2, world=[nominal(), inexact], **arguments)
    one.reset(seed=0)
    rows.reset(seed=[0, 1])
    stood = []
    for word in [np.array([0.0, -0.1, 0.0])] * 3 + [np.zeros(3)] * 3:
        alone = one.step(word)[-1]["truth"]["joints"]
        np.testing.assert_array_equal(rows.step(np.tile(word, (2, 1)))[-1]["truth"]["joints"][0], alone)
        stood.append(alone)
    np.testing.assert_array_equal(stood[2:], stood[2:3] * 4)
