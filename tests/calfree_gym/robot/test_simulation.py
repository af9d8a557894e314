"""Physics against closed form and where it should settle; errors of motors as measured at the joints."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from calfree_gym import MOUNTS, Arm, WorldDistribution, nominal
from calfree_gym.robot import workspace
from calfree_gym.robot.arms.arm import robot_of
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.kinematic import KinematicSimulation
from calfree_gym.robot.motors import MotorMap
from calfree_gym.robot.simulation import DYNAMICS, SUBSTEPS, ReachSimulation
from calfree_gym.robot.workspace import CHECKED, Workspaces, judging_draws
from tests.arms.every import EVERY as ALL_ARMS
from tests.arms.every import arm_named, rows_of
from tests.arms.own import three_hinges
from tests.calfree_gym.environments import begun, kinematic

ROWS = 32
EVERY = slice(None)


@pytest.fixture(params=MOUNTS)
def pair(request):
    worlds = [WorldDistribution("wild").sample(seed) for seed in range(ROWS)]
    made, motors = {}, MotorMap(ROWS, MOVEMASTER)
    for row, world in enumerate(worlds):
        motors.set_world(row, world)
    home, objects = motors.joints(np.zeros((ROWS, 3)), EVERY), np.tile([0.4, 0.1, 0.1], (ROWS, 1))
    for dynamics, kind in zip(DYNAMICS, (ReachSimulation, KinematicSimulation), strict=True):
        made[dynamics] = kind(ROWS, MOVEMASTER, MOVEMASTER.mounts(request.param), threads=1)
        for row, world in enumerate(worlds):
            made[dynamics].set_world(row, world)
        made[dynamics].place(EVERY, home, objects)
    return made["physics"], made["kinematic"], motors, worlds, request.param


def test_a_motion_ends_settled_to_a_tenth_of_a_pixel(pair):
    physics, kinematic, motors, _, _ = pair
    rng = np.random.default_rng(0)
    for _ in range(20):
        joints = motors.joints(rng.uniform(motors.lowest, motors.highest), EVERY)
        for simulation in (physics, kinematic):
            simulation.move(EVERY, joints)
            simulation.refresh()
        (a, _), (b, depth) = physics.pinhole_pixels(), kinematic.pinhole_pixels()
        near = (depth > 0.1) & (np.abs(b - 256) < 256).all(-1)
        assert near.sum() > ROWS
        assert np.abs(a - b)[near].max() < 0.1


@pytest.mark.parametrize("name", ["movemaster", *ALL_ARMS])
def test_an_arm_that_is_stepped_without_its_shapes_moves_as_the_whole_does(name):
    robot = robot_of(name if name == "movemaster" else arm_named(name))
    world, rng = WorldDistribution("wild").sample(3, robot=robot), np.random.default_rng(2)
    simulation, motors = ReachSimulation(1, robot, robot.mounts("waist"), threads=1), MotorMap(1, robot)
    simulation.set_world(0, world)
    motors.set_world(0, world)
    simulation.place(EVERY, motors.joints(np.zeros((1, len(robot.motors))), EVERY), robot.rig.target[None])
    model, data = simulation.show(0, simulation.picture())
    assert model.ngeom > simulation._batch.model.ngeom == 0
    data.ctrl[:], data.act[:] = simulation._all_ctrl[0], simulation._all_act[0]
    at_stops = 1e-8 if name == "movemaster" else 0.0  # only that model has stops, where its wrist may be
    for _ in range(4):
        simulation.move(EVERY, motors.joints(rng.uniform(motors.lowest, motors.highest), EVERY))
        simulation.refresh()
        data.ctrl[:] = simulation._all_ctrl[0]
        mujoco.mj_step(model, data, SUBSTEPS)
        np.testing.assert_allclose(data.qpos, simulation.configuration(0), rtol=0, atol=at_stops)
        data.qpos[:] = simulation.configuration(0)
        mujoco.mj_forward(model, data)
        first = simulation._scene.sensors
        np.testing.assert_array_equal(data.sensordata[first : first + 8], simulation._pixels[0].ravel())


def test_an_arm_whose_inertia_always_follows_from_its_shapes_keeps_both():
    text = three_hinges(90, 0.2).replace("<mujoco>", '<mujoco><compiler inertiafromgeom="true"/>')
    scene = Arm(text, "tip").robot.scene(("world", "world"))
    assert scene.stepped.ngeom == scene.model.ngeom
    np.testing.assert_array_equal(scene.stepped.body_inertia, scene.model.body_inertia)


def test_what_follows_in_closed_form_is_what_mujoco_computes(pair):
    physics, kinematic, motors, _, _ = pair
    rng = np.random.default_rng(1)
    for _ in range(10):
        joints = motors.joints(rng.uniform(motors.lowest, motors.highest), EVERY)
        objects = rng.uniform([0.2, -0.3, 0.0], [0.6, 0.3, 0.3], (ROWS, 3))
        for simulation in (physics, kinematic):
            simulation.place(EVERY, joints, objects)
            simulation.refresh()
        for computed, closed in zip(physics.positions(), kinematic.positions(), strict=True):
            np.testing.assert_allclose(closed, computed, atol=1e-9)
        (pixels, depth), (closed, closed_depth) = physics.pinhole_pixels(), kinematic.pinhole_pixels()
        np.testing.assert_allclose(closed_depth, depth, atol=1e-9)
        near = (depth > 0.1) & (np.abs(pixels - 256) < 512).all(-1)
        assert near.sum() > ROWS
        np.testing.assert_allclose(closed[near], pixels[near], atol=1e-4)


@pytest.mark.parametrize("mount", ["waist", "stand", "forearm"])
def test_a_world_is_judged_by_the_first_of_all_candidates(monkeypatch, mount):
    spaces = Workspaces(1, MOVEMASTER, MOVEMASTER.mounts(mount))
    draws = judging_draws(MOVEMASTER.candidates, len(MOVEMASTER.motors))
    for seed in range(12):
        spaces.set_world(0, WorldDistribution("wild").sample(seed))
        found = spaces.candidates(draws, np.array([0]))
        first = np.flatnonzero(found.within)[:CHECKED]
        for at_once in (workspace.PLACED_AT_ONCE, 1):
            monkeypatch.setattr(workspace, "PLACED_AT_ONCE", at_once * len(first))
            reached, good = spaces.judged(0)
            np.testing.assert_array_equal(reached, found.reached[0, first])
            np.testing.assert_array_equal(good, found.reached[0, first] & found.seen[0, first])


ARMS = ("movemaster", "scara", "gantry")
SWEEP, STEP = 10, 0.02
MANY, REPEATS = 100, 20
ERRORS = ("backlash", "repeatability")


class Bench:
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
    bench = begun(Bench(name, backlash=gaps(name)))
    half_gap = gaps(name) / 2 / bench.robot.span
    there = bench.move(0.2)
    for share in (-0.9, -0.9, 0.9, 0.9):  # of half a gap: never through it
        assert (bench.move(share * half_gap) == there).all()
    assert there - bench.move(-3 * half_gap) == pytest.approx(gaps(name)[None] / 2, rel=1e-6)


@pytest.mark.parametrize("name", ["movemaster", "gantry"])
def test_the_spread_of_motions_is_what_was_set(name):
    sigma = of_each_motor(name, 0.002, 0.006)
    bench, exact = Bench(name, MANY, repeatability=sigma), Bench(name)
    exact.reset()
    away, home = exact.move(0.1), exact.move(-0.1)
    homes = [bench.reset() - home]
    motions = [bench.move(-0.1) - home if i % 2 else bench.move(0.1) - away for i in range(REPEATS)]
    everybody = {"reset_mask": np.ones(MANY, bool)}
    homes += [bench.reset(None, options=everybody) - home for _ in range(REPEATS)]
    for found in (np.array(motions), np.array(homes)):
        n = found.shape[0] * MANY
        flat = found.reshape(n, -1) / sigma
        assert flat.std(0) == pytest.approx(np.ones(flat.shape[1]), abs=4.5 / np.sqrt(2 * n))
        assert flat.mean(0) == pytest.approx(np.zeros(flat.shape[1]), abs=4.5 / np.sqrt(n))
        of_motors = np.corrcoef(flat.T) - np.eye(flat.shape[1])
        of_motions = [np.corrcoef(found[:-1, :, m].ravel(), found[1:, :, m].ravel())[0, 1] for m in range(3)]
        assert np.abs(of_motors).max() < 4.5 / np.sqrt(n)
        assert np.abs(of_motions).max() < 4.5 / np.sqrt(n)
        assert np.abs(flat).max() < 6


def test_physics_settles_where_kinematics_places_it_also_at_a_stop():
    sigma, rng = np.full(3, 0.02), np.random.default_rng(3)  # twice as far as motors stop before joints do
    benches = [begun(Bench("movemaster", MANY, dynamics, repeatability=sigma)) for dynamics in DYNAMICS]
    limits, beyond = MOVEMASTER.stops.T, 0
    for _ in range(4):
        words = rng.choice([-1.0, 1.0], 3)
        physics, kinematic = (bench.move(words) for bench in benches)
        assert physics == pytest.approx(kinematic, abs=1e-5)
        beyond += ((kinematic < limits[0]) | (kinematic > limits[1])).sum()
    assert beyond > MANY


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
