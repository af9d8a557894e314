"""Backlash and repeatability, measured at the joints as one would on a real arm, against what was set."""

from dataclasses import replace

import numpy as np
import pytest

from calfree_gym import nominal
from calfree_gym.robot.arms.arm import robot_of
from tests.arms.every import arm_named, rows_of
from tests.calfree_gym.environments import kinematic

ARMS = ("movemaster", "scara", "gantry")
SWEEP, STEP = 10, 0.02
ROWS, REPEATS = 100, 20
ERRORS = ("backlash", "repeatability")


class Bench:
    """Rows of an arm in one world, whose motors have these errors; what becomes of their joints."""

    def __init__(self, name, rows=1, dynamics="kinematic", perturbations=None, **errors):
        arm = name if name == "movemaster" else arm_named(name)
        self.robot = robot_of(arm)
        self.motors = len(self.robot.motors)
        given = {"camera_mount": "stand", "terminate_on_success": False, "max_episode_steps": 10**6}
        given |= {"world": replace(nominal(self.robot), **errors), "perturbations": perturbations}
        self.env = rows_of(arm, rows, dynamics=dynamics, **given)
        self.rows = rows

    def reset(self, seed=0, **options):
        return self._joints(self.env.reset(seed=seed, **options)[-1])

    def move(self, words):
        """Where the joints are (rows, m) after a motion by words (m,), or by the same word of each motor."""
        return self._joints(self.env.step(np.broadcast_to(words, (self.rows, self.motors)))[-1])

    def _joints(self, infos):
        return infos["truth"]["joints"][:, : self.motors]

    def sweep(self, motor):
        """Where the joints come to rest on the way up and down (2, SWEEP, m), at the same registers."""
        word = STEP * np.eye(self.motors)[motor]
        self.reset()
        self.move(-word)
        up = [self.move(word)[0] for _ in range(SWEEP)]
        self.move(word)
        down = [self.move(-word)[0] for _ in range(SWEEP)]
        return np.array([up, down[::-1]])


def of_each_motor(name, low, high):
    """Another value a motor, in rad or m."""
    robot = robot_of(name if name == "movemaster" else arm_named(name))
    return np.linspace(low, high, len(robot.motors)) * robot.span


def gaps(name):
    return of_each_motor(name, 0.004, 0.012)


@pytest.mark.parametrize(("dynamics", "share"), [("kinematic", 1e-9), ("physics", 0.02)])
@pytest.mark.parametrize("name", ARMS)
def test_the_hysteresis_loop_is_as_wide_as_was_set(name, dynamics, share):
    bench, exact = Bench(name, dynamics=dynamics, backlash=gaps(name)), Bench(name, dynamics=dynamics)
    for motor, gap in enumerate(gaps(name)):
        up, down = bench.sweep(motor)
        true_up, true_down = exact.sweep(motor)
        assert true_up[:, motor] == pytest.approx(true_down[:, motor], abs=share * gap)
        assert down[:, motor] - up[:, motor] == pytest.approx(np.full(SWEEP, gap), rel=share)
        assert true_up[:, motor] - up[:, motor] == pytest.approx(np.full(SWEEP, gap / 2), rel=2 * share)
        others = np.delete(up - bench.robot.home, motor, 1)
        assert others == pytest.approx(np.zeros_like(others), abs=share * gap)


@pytest.mark.parametrize("name", ARMS)
def test_within_the_gap_a_joint_stays(name):
    """Play: after a turn the joint waits until the motor has gone through the gap."""
    bench = Bench(name, backlash=gaps(name))
    bench.reset()
    half_gap = gaps(name) / 2 / bench.robot.span
    there = bench.move(0.2)
    for share in (-0.9, -0.9, 0.9, 0.9):  # of half a gap: never through it
        assert (bench.move(share * half_gap) == there).all()
    assert there - bench.move(-3 * half_gap) == pytest.approx(gaps(name)[None] / 2, rel=1e-6)


@pytest.mark.parametrize("name", ["movemaster", "gantry"])
def test_the_spread_of_motions_is_what_was_set(name):
    """The standard deviation of n numbers is that of their distribution within 1 / sqrt(2 n), one sigma."""
    sigma = of_each_motor(name, 0.002, 0.006)
    bench, exact = Bench(name, ROWS, repeatability=sigma), Bench(name)
    exact.reset()
    away, home = exact.move(0.1), exact.move(-0.1)
    homes = [bench.reset() - home]
    motions = [bench.move(-0.1) - home if i % 2 else bench.move(0.1) - away for i in range(REPEATS)]
    everybody = {"reset_mask": np.ones(ROWS, bool)}
    homes += [bench.reset(None, options=everybody) - home for _ in range(REPEATS)]
    for found in (np.array(motions), np.array(homes)):
        n = found.shape[0] * ROWS
        flat = found.reshape(n, -1) / sigma
        assert flat.std(0) == pytest.approx(np.ones(flat.shape[1]), abs=4.5 / np.sqrt(2 * n))
        assert flat.mean(0) == pytest.approx(np.zeros(flat.shape[1]), abs=4.5 / np.sqrt(n))
        of_motors = np.corrcoef(flat.T) - np.eye(flat.shape[1])
        of_motions = [np.corrcoef(found[:-1, :, m].ravel(), found[1:, :, m].ravel())[0, 1] for m in range(3)]
        assert np.abs(of_motors).max() < 4.5 / np.sqrt(n)
        assert np.abs(of_motions).max() < 4.5 / np.sqrt(n)
        assert np.abs(flat).max() < 6


@pytest.mark.parametrize("name", ARMS)
def test_a_motor_that_is_not_moved_stays_where_it_is(name):
    bench = Bench(name, backlash=gaps(name), repeatability=gaps(name))
    bench.reset(seed=3)
    before = bench.move(0.1)
    for _ in range(3):
        assert (bench.move(0) == before).all()
    after = bench.move(0.1 * np.eye(bench.motors)[0])
    assert after[0, 0] != before[0, 0]
    assert (after[0, 1:] == before[0, 1:]).all()


def test_each_seed_has_its_own_noise_and_repeats_it():
    bench = Bench("movemaster", 2, repeatability=gaps("movemaster"))

    def run(seed):
        return np.array([bench.reset(seed), *(bench.move(0.05) for _ in range(3))])

    zero, one = run(0), run(1)
    assert (run(0) == zero).all()
    assert (zero[:, 1] == one[:, 0]).all()
    assert (zero[:, 0] != one[:, 0]).all()


@pytest.mark.parametrize(
    ("name", "motor", "unit"), [("movemaster", "elbow", np.pi / 180), ("gantry", "y", 0.01)]
)
@pytest.mark.parametrize("error", ERRORS)
def test_perturbations_set_a_motors_errors_and_drifts_add_to_them(error, name, motor, unit):
    def errors(entry, **fields):
        entry = {**entry, "do": {"type": error, "motor": motor, "degrees": 0.5}}
        bench = Bench(name, perturbations=[entry], **fields)
        bench.reset()
        found = []
        for _ in range(4):
            bench.move(0)
            found.append(getattr(bench.env.unwrapped.worlds[0], error))
        assert (np.delete(found, place, 1) == 0).all()
        return np.array(found)[:, place] / unit

    motors = Bench(name).robot.motors
    place = motors.index(motor)
    other = {error: 2 * unit * np.eye(len(motors))[place]}
    assert errors({"at": {"motion": 2}}) == pytest.approx([0, 0, 0.5, 0.5])
    assert errors({"at": {"motion": 2}}, **other) == pytest.approx([2, 2, 0.5, 0.5])
    assert np.diff(errors({"drift": {"per": "motion"}})) == pytest.approx([0.5, 0.5, 0.5])


@pytest.mark.parametrize("error", ERRORS)
def test_errors_below_zero_are_refused_before_any_simulation(error):
    entry = {"at": {"motion": 2}, "do": {"type": error, "motor": "waist", "degrees": -1}}
    with pytest.raises(ValueError, match=rf"{error}.degrees is -1; it must be a number from 0 to 45"):
        Bench("movemaster", perturbations=[entry])


def test_a_backlash_that_comes_is_felt():
    """From the motion before which it comes: the joint then lags behind by half of it."""
    entry = {"at": {"motion": 2}, "do": {"type": "backlash", "motor": "waist", "degrees": 2.0}}
    bench, exact = Bench("movemaster", perturbations=[entry]), Bench("movemaster")
    word = np.array([0.05, 0, 0])
    bench.reset()
    exact.reset()
    lags = [(exact.move(word) - bench.move(word))[0, 0] for _ in range(4)]
    assert np.degrees(lags) == pytest.approx([0, 0, 1, 1])


@pytest.mark.parametrize("error", ERRORS)
def test_an_error_that_begins_moves_no_motor_that_rests_whatever_other_rows_have(error):
    begins = [{"at": {"motion": 3}, "do": {"type": error, "motor": "shoulder", "degrees": 4}}]
    inexact = replace(nominal(), backlash=np.full(3, 0.02))
    one = kinematic(world=nominal(), perturbations=begins, terminate_on_success=False)
    rows = kinematic(rows=2, world=[nominal(), inexact], perturbations=begins, terminate_on_success=False)
    one.reset(seed=0)
    rows.reset(seed=[0, 1])
    stood = []
    for word in [np.array([0.0, -0.1, 0.0])] * 3 + [np.zeros(3)] * 3:
        alone = one.step(word)[-1]["truth"]["joints"]
        np.testing.assert_array_equal(rows.step(np.tile(word, (2, 1)))[-1]["truth"]["joints"][0], alone)
        stood.append(alone)
    np.testing.assert_array_equal(stood[2:], stood[2:3] * 4)
