"""Worlds of any arm, in view and reachable; its cameras against MuJoCo's; and that it settles."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from calfree_gym import DISTRIBUTIONS, Arm, World, WorldDistribution, nominal
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.simulation import ReachSimulation
from calfree_gym.robot.workspace import in_view, least_in_view
from calfree_gym.vision.cameras import StereoCameras
from tests.arms.every import EVERY, arm_named, moved_by, rows_of, three_mounts
from tests.arms.fetched import FETCHED
from tests.arms.own import ARMS, three_hinges
from tests.calfree_gym.environments import begun, make

WORLDS = 4
OF_ALL_MOTORS = (
    *("backlash", "repeatability", "register_noise", "register_step", "shortfall", "longest_motion"),
    *("word_gain", "dead_zone", "gear_ripple", "motor_coupling"),
)


@pytest.mark.parametrize("kind", DISTRIBUTIONS)
@pytest.mark.parametrize("name", EVERY)
def test_every_kind_of_world_is_in_view_and_its_objects_are_reachable(name, kind):
    arm = arm_named(name)
    for mount in three_mounts(arm.robot):
        arguments = {"camera_mount": mount, "world": kind, "tell": ("object_registers",)}
        env = rows_of(arm, WORLDS, dynamics="kinematic", **arguments)
        observation, infos = env.reset(seed=10)
        assert (observation["observation"][:, :4] == 1).all(), "gripper and object are seen at home"
        assert np.abs(observation["object_registers"]).max() <= 0.9 + 1e-6
        assert (infos["truth"]["error_px"] > 4).all()
        for world in env.unwrapped.worlds:
            world.check_fits(arm.robot)
            assert World.from_dict(world.to_dict()) == world


@pytest.mark.parametrize("degrees", [0.5, 1, 30])
def test_objects_are_where_motors_come_also_where_hinges_hardly_turn(degrees):
    env = rows_of(
        Arm(three_hinges(degrees, 0.2), "tip"),
        8,
        dynamics="kinematic",
        world="wild",
        tell=("object_registers",),
    )
    observation, _ = env.reset(seed=0)
    *_, infos = env.step(observation["object_registers"].astype(np.float32))
    assert infos["truth"]["error_px"].max() < 0.01


def test_worlds_are_drawn_for_an_arm_as_environments_draw_them():
    arm = arm_named("scara")
    built, coarse = (
        begun(make(arm=arm, world=kind, keep_in_view=False), seed=4).unwrapped.world
        for kind in ("nominal", "coarse")
    )
    for given in (arm, arm.to_dict(), arm.robot):
        assert nominal(given) == built
        assert WorldDistribution("coarse").sample(4, robot=given) == coarse
    assert nominal("movemaster") == nominal()
    with pytest.raises(ValueError, match=r"arm is 'scara'; it must be 'movemaster', a calfree_gym.Arm"):
        nominal("scara")


@pytest.mark.parametrize("name", ARMS)
def test_lengths_follow_the_arm_and_others_are_refused_by_name(name):
    robot = arm_named(name).robot
    world = nominal(robot)
    assert world.motor_sign.shape == world.backlash.shape == (len(robot.motors),)
    assert world.link_lengths == pytest.approx(robot.lengths)
    of_motors = ("motor_sign", "motor_gain", "motor_curvature", *OF_ALL_MOTORS)
    for parts, fields in (("motors", of_motors), ("joints", ["joint_zeros"]), ("links", ["link_lengths"])):
        field, names = fields[0], getattr(robot, parts)
        other = replace(world, **{each: [*getattr(world, each), getattr(world, each)[0]] for each in fields})
        message = rf"World.{field} has shape \({len(names) + 1},\); it must be \({len(names)},\)"
        with pytest.raises(ValueError, match=message) as caught:
            make(arm=arm_named(name), world=other)
        assert ", ".join(names) in str(caught.value)


POSTURES = 12


def mounts_of(robot):
    if robot is MOVEMASTER:
        return ["waist", "stand", *robot.bodies[1:], ("stand", "forearm"), ("hand", "waist")]
    last, (_, _, middle) = moved_by(robot, -1), three_mounts(robot)
    return ["waist", "stand", middle, last, ("stand", middle), (middle, "waist"), (last, middle)]


def seen_and_thought(robot, mounts, world, angles, points):
    """Image points of points (n, 3) with joints at (n, j): MuJoCo's, and the work space's (n, 2, 2)."""
    simulation, cameras = ReachSimulation(1, robot, mounts, 1), StereoCameras(1)
    simulation.set_world(0, world)
    cameras.set_world(0, world)
    one, seen = np.array([0]), []
    for posture, point in zip(angles, points, strict=True):
        simulation.place(one, posture[None], point[None])
        simulation.refresh()
        pixels, depth = simulation.pinhole_pixels()
        images, shown = cameras.through_lens(pixels)
        seen.append((images[0, 2:], (shown & (depth > 0))[0, 2:]))
    lengths = np.repeat(world.link_lengths[None], len(points), 0)
    rays = robot.into_mounts(points, angles, lengths, mounts)
    thought, shown = cameras.project(rays, np.zeros(len(points), int))
    return (*map(np.array, zip(*seen, strict=True)), thought, shown)


def check(robot, camera_mount, world):
    mounts = robot.mounts(camera_mount)
    rng = np.random.default_rng(0)
    positions = robot.lowest + rng.random((POSTURES, len(robot.motors))) * (robot.highest - robot.lowest)
    positions[0] = robot.home
    rest = robot.rest(world.joint_zeros)
    angles = robot.angles(positions, rest)
    lengths = np.repeat(world.link_lengths[None], POSTURES, 0)
    objects = robot.gripper_position(robot.angles(rng.permutation(positions), rest), lengths)
    seen, shown, thought, thought_shown = seen_and_thought(robot, mounts, world, angles, objects)
    assert (shown == thought_shown).all()
    near = shown & (np.abs(seen).max(-1) < 3)  # an image point at the horizon has no place
    assert thought[near] == pytest.approx(seen[near], abs=1e-6)
    return near


@pytest.mark.parametrize("name", ["movemaster", *EVERY])
def test_the_work_space_knows_what_cameras_see(name):
    robot = MOVEMASTER if name == "movemaster" else arm_named(name).robot
    for seed, mount in enumerate(mounts_of(robot)):
        assert check(robot, mount, WorldDistribution("wild").sample(seed, robot=robot)).any(), mount


@pytest.mark.parametrize("mount", ["waist", "forearm", ("stand", "forearm")])
def test_in_view_is_a_share_of_what_mujoco_shows(mount):
    robot = MOVEMASTER
    assert in_view(nominal(), robot, robot.mounts(mount))
    mounts, rng, verdicts = robot.mounts(mount), np.random.default_rng(1), []
    for seed in range(8):
        world = WorldDistribution("wild").sample(seed)
        world = replace(world, motor_gain=np.full(3, 1.5), joint_zeros=np.zeros(4))
        draws = rng.random((400, 3))
        angles = robot.angles(robot.lowest + draws * (robot.highest - robot.lowest), robot.rest(np.zeros(4)))
        points = robot.gripper_position(angles, np.repeat(world.link_lengths[None], 400, 0))
        kept = robot.within(points)
        angles, points = angles[kept], points[kept]
        home = robot.angles(robot.home[None], robot.rest(np.zeros(4)))
        inside = []
        for at in (np.repeat(home, len(points), 0), angles):
            images, shown, *_ = seen_and_thought(robot, mounts, world, at, points)
            inside.append((shown & (np.abs(images).max(-1) <= 1 - 16 / 256)).all(-1))
        gripper = robot.gripper_position(home, world.link_lengths[None])
        images, shown, *_ = seen_and_thought(robot, mounts, world, home, gripper)
        share = (inside[0] & inside[1]).mean()
        least = least_in_view(robot, mounts)
        if abs(share - least) < 0.1:  # 200 other draws decide
            continue
        at_home = bool((shown & (np.abs(images).max(-1) <= 1 - 16 / 256)).all())
        verdicts.append(at_home and share > least)
        assert in_view(world, robot, mounts) == verdicts[-1]
    assert len(verdicts) >= 3


FEW, MANY = 4, 50
CASES = [
    *((name, FEW) for name in ARMS),
    *(pytest.param(name, MANY, marks=pytest.mark.slow) for name in [*ARMS, *FETCHED]),
]


def reached(arm, mount, worlds):
    arguments = {"camera_mount": mount, "terminate_on_success": False, "tell": ("object_registers",)}
    env = rows_of(arm, worlds, dynamics="kinematic", **arguments)
    observation, infos = env.reset(seed=100)
    motors = len(arm.robot.motors)
    done = infos["is_success"].copy()
    for _ in range(2):
        words = observation["object_registers"] - observation["observation"][:, 4 : 4 + motors]
        observation, *_, infos = env.step(words)
        done |= infos["is_success"]
    return int(done.sum())


@pytest.mark.parametrize(("name", "worlds"), CASES)
def test_the_oracle_reaches(name, worlds):
    arm = arm_named(name)
    counts = {mount: reached(arm, mount, worlds) for mount in three_mounts(arm.robot)}
    assert sum(counts.values()) >= 0.99 * worlds * len(counts), counts


ROWS, MOTIONS = 4, 8
HALF_AN_IMAGE = 256


def both(arm, **arguments):
    made = [
        rows_of(arm, ROWS, dynamics=dynamics, terminate_on_success=False, **arguments)
        for dynamics in ("physics", "kinematic")
    ]
    assert [env.reset(seed=0)[0]["observation"][:, :4].min() for env in made] == [1, 1]
    return made


@pytest.mark.parametrize("mount", ["waist", "stand"])
@pytest.mark.parametrize("name", EVERY)
def test_physics_settles_where_kinematics_places_it(name, mount):
    envs, rng = both(arm_named(name), camera_mount=mount), np.random.default_rng(1)
    compared = 0
    for _ in range(MOTIONS):
        words = rng.uniform(-1, 1, envs[0].action_space.shape)
        physics, kinematic = (env.step(words)[-1]["truth"]["points"] for env in envs)
        shown = np.abs(kinematic) <= 1
        compared += shown[:, :4].sum()
        assert physics[shown] * HALF_AN_IMAGE == pytest.approx(kinematic[shown] * HALF_AN_IMAGE, abs=0.2)
    assert compared > ROWS * MOTIONS


@pytest.mark.parametrize("name", EVERY)
def test_all_other_joints_stay_at_home(name):
    robot, rng = arm_named(name).robot, np.random.default_rng(2)
    env = both(arm_named(name))[0]
    for _ in range(MOTIONS):
        env.step(rng.uniform(-1, 1, env.action_space.shape))
    moved = np.zeros(robot.model.nq, bool)
    moved[robot.qpos_of_motors] = True
    for row in range(ROWS):
        batch = env.unwrapped.arms.simulation._batch
        model, data = batch.get_model(row), batch.get_data(row)
        mujoco.mj_forward(model, data)
        assert data.qpos[~moved] == pytest.approx(robot.home_qpos[~moved], abs=1e-4)
        assert (data.qpos[moved] != robot.home_qpos[moved]).all()
        for key in range(robot.model.nkey):
            assert (model.key_qpos[key] == robot.model.key_qpos[key]).all()
        assert np.abs(data.qvel).max() < 0.02
        assert not data.ncon
        assert model.opt.timestep == 0.005
        assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST


@pytest.mark.parametrize("name", ["scara", "redundant"])
def test_zeros_of_wild_worlds_are_within_ten_degrees_or_that_share_of_a_slides_span(name):
    robot = arm_named(name).robot
    zeros = np.array([WorldDistribution("wild").sample(seed, robot=robot).joint_zeros for seed in range(200)])
    most = np.where(robot.slides, np.radians(10) * robot.span / 2, np.radians(10))
    assert (np.abs(zeros) <= most).all()
    assert (np.abs(zeros).max(0) > 0.9 * most).all()
