"""What an occluder hides, against MuJoCo's rays and against what the environment sees."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from calfree_gym import Arm, WorldDistribution, nominal
from calfree_gym.image import CAMERAS
from calfree_gym.perturbations import CameraShift, Occluder
from calfree_gym.perturbations.occluder import nearest, work_space
from calfree_gym.perturbations.schedule import undone
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.kinematic import KinematicSimulation
from tests.arms.every import arm_named
from tests.arms.own import ARMS
from tests.calfree_gym.environments import kinematic, make

COLLIDING = '<worldbody><geom type="box" size=".1 .1 .01" pos="2 {} 0"/>'


@pytest.fixture(params=["RV-M2", "gantry", "room"])
def robot(request):
    if request.param == "RV-M2":
        return MOVEMASTER
    if request.param == "gantry":
        return arm_named("gantry").robot
    text = ARMS["scara"]["model"].read_text()
    for y in (2, -2):
        text = text.replace("<worldbody>", COLLIDING.format(y), 1)
    return Arm(text, "tip").robot


class Rays:
    def __init__(self, robot):
        self.simulation = KinematicSimulation(1, robot, robot.mounts("stand"), threads=1)
        self.picture = self.simulation.picture()
        model = self.picture[0]
        model.geom_group[:] = 0
        model.geom_group[model.geom(self.simulation.prefix + "occluder").id] = 3

    def stopped(self, world, camera, points):
        self.simulation.set_world(0, world)
        self.simulation.refresh()
        model, data = self.simulation.show(0, self.picture)
        rays, only = len(points), np.array([0, 0, 0, 1, 0, 0], np.uint8)
        ways, geoms, lengths = (points - camera).ravel(), np.empty(rays, np.int32), np.empty(rays)
        mujoco.mj_multiRay(
            model, data, camera, ways, only, 1, -1, geoms, lengths, None, rays, mujoco.mjMAXVAL
        )
        return (lengths >= 0) & (lengths < 1)


def test_rays_say_that_the_share_is_hidden_which_was_asked_for_and_the_gripper_at_home_is_not(robot):
    rays = Rays(robot)
    for seed in range(4):
        world = WorldDistribution("wild").sample(seed, robot=robot)
        for camera, name in enumerate(CAMERAS):
            position = world.camera_position[camera]
            for share in (0.1, 0.25, 0.4):
                there = Occluder(name, share, 0.4).change(world, robot)
                home, points = work_space(there, robot)
                stopped = rays.stopped(there, position, points)
                assert stopped.mean() == pytest.approx(share, abs=0.005)
                assert not rays.stopped(there, position, home[None]).any()
                distances, _ = nearest(position, points, there.occluder[:2])
                sure = np.abs(distances - there.occluder[3]) > 1e-6
                np.testing.assert_array_equal(stopped[sure], (distances <= there.occluder[3])[sure])


@pytest.mark.parametrize("how", [{"at": {"trial": 1}}, {"drift": {"per": "trial"}}], ids=["once", "drift"])
def test_cameras_that_joint_zeros_turn_lose_the_share_too(how):
    do = {"type": "occluder", "camera": "right", "share": 0.25, "at": 0.4}
    env = kinematic(camera_mount="waist", occlusion=True, perturbations=[{**how, "do": do}]).unwrapped
    rays = Rays(MOVEMASTER)
    for seed in range(10):
        env.reset(seed=seed)
        before = env.world.camera_position
        env.reset()
        np.testing.assert_array_equal(env.world.camera_position, before)
        assert env.arms.visible[0].all()
        model, data = env.arms.simulation.show(0, env.arms.simulation.picture())
        camera = data.cam_xpos[model.camera("right").id]
        _, points = work_space(env.world, MOVEMASTER)
        assert rays.stopped(env.world, camera, points).mean() == pytest.approx(0.25, abs=0.005)


def test_a_drift_hides_more_and_more_and_turns_back_at_the_end():
    step, world, shares = Occluder("left", 0.05, 0.4), nominal(), []
    _, points = work_space(world, MOVEMASTER)
    for _ in range(6):
        world = step.drift(world)
        x, y, _, radius, _ = world.occluder
        distances, _ = nearest(world.camera_position[0], points, np.array([x, y]))
        shares.append((distances <= radius).mean())
    np.testing.assert_allclose(shares, np.arange(0.05, 0.31, 0.05), atol=0.003)
    world = step.drift(Occluder("left", 0.74, 0.4).change(world))
    with pytest.raises(ValueError, match=r"occluder.share is .*; it must be a number from 0 to 0.8"):
        step.drift(world)
    with pytest.raises(ValueError, match=r"occluder.share is -0.05"):
        step.drift(nominal(), back=True)


def test_share_0_and_undoing_take_the_whole_post_away_and_leave_the_rest():
    there = Occluder("left", 0.3, 0.4).change(nominal())
    assert there.occluder[3] > 0.01
    assert Occluder("right", 0.0, 0.5).change(there) == nominal()
    shifted = CameraShift("right", 0.05, 0.0, 0.0).change(there)
    assert undone(shifted, nominal(), there) == CameraShift("right", 0.05, 0.0, 0.0).change(nominal())
    wider = Occluder("left", 0.35, 0.4).change(there)
    assert undone(wider, nominal(), there) == nominal()


def test_a_trial_ends_only_where_all_is_seen():
    there = Occluder("left", 0.3, 0.4).change(nominal())
    env = kinematic(world=there, camera_mount="stand", occlusion=True, keep_in_view=False).unwrapped
    _, points = work_space(there, MOVEMASTER)
    ended = {True: 0, False: 0}
    for point in points[:50]:
        env.reset(seed=0, options={"object": point})
        words = env.arms.object_registers()[0] - env.arms.registers[0]
        _, reward, terminated, _, info = env.step(words.astype(np.float32))
        assert env.arms.error_px()[0] < 4
        all_seen = bool(env.arms.visible[0].all())
        assert info["is_success"] == terminated == (reward == 0)
        assert terminated <= all_seen
        ended[all_seen] += 1
    assert ended[False] > 10
    assert ended[True] > 10


def test_it_stands_in_the_images_of_a_grasp_too():
    env = make("Grasp", observation="pixels", camera_mount="stand", image_size=128)
    before = env.reset(seed=0)[0]["pixels"]
    assert (env.reset(seed=0)[0]["pixels"] == before).all()
    env.unwrapped.set_world(Occluder("left", 0.3, 0.4).change(env.unwrapped.world, env.unwrapped.arms.robot))
    changed = (env.reset(seed=0)[0]["pixels"] != before)[..., :3].any(-1)
    assert changed.mean() > 0.02
    env.close()


def test_rays_see_occluders_of_any_size_anywhere(robot):
    rng, rays, hit = np.random.default_rng(0), Rays(robot), 0
    for _ in range(20):
        x, y, z, radius, half = rng.uniform([-0.3, -0.3, 0, 0.01, 0.02], [0.5, 0.5, 0.5, 0.2, 0.6])
        world = replace(nominal(robot), occluder=np.array([x, y, z, radius, half]))
        camera, points = rng.uniform([-1, -1, -0.5], [1, 1, 1.5]), rng.uniform(-0.5, 0.5, (100, 3))
        ways = camera + np.linspace(0, 1, 2001)[:, None, None] * (points - camera)
        level = np.hypot(ways[..., 0] - x, ways[..., 1] - y)
        inside = ((level <= radius) & (np.abs(ways[..., 2] - z) <= half)).any(0)
        hit += inside.sum()
        assert (rays.stopped(world, camera, points) != inside).sum() <= 1  # one may graze
    assert hit > 100
