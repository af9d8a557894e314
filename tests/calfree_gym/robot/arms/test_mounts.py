"""What the work space is told that cameras see is what MuJoCo projects, on whatever they are fixed."""

from dataclasses import replace

import numpy as np
import pytest

from calfree_gym import WorldDistribution, nominal
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.simulation import ReachSimulation
from calfree_gym.robot.workspace import MIN_IN_VIEW, MIN_IN_VIEW_ON_A_LINK, in_view, least_in_view
from calfree_gym.vision.cameras import StereoCameras
from tests.arms.every import EVERY, arm_named, moved_by, three_mounts

POSTURES = 12


def mounts_of(robot):
    """Waist, stand, a link in the middle, the gripper's own, and pairs of different bodies."""
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


@pytest.mark.parametrize("name", ["movemaster", "hobby"])
def test_cameras_on_a_moving_link_may_see_less(name):
    robot = MOVEMASTER if name == "movemaster" else arm_named(name).robot
    first, other = robot.bodies[0], "forearm"
    for few in ("waist", "stand", first, ("stand", first)):
        assert least_in_view(robot, robot.mounts(few)) == MIN_IN_VIEW == 0.5
    for many in (other, ("stand", other), (other, "waist")):
        assert least_in_view(robot, robot.mounts(many)) == MIN_IN_VIEW_ON_A_LINK == 0.2


@pytest.mark.parametrize("mount", ["waist", "forearm", ("stand", "forearm")])
def test_in_view_is_a_share_of_what_mujoco_shows(mount):
    """Counted anew from MuJoCo's images, at home and with the gripper at the object."""
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
