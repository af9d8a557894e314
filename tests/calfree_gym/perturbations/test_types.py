"""Perturbations against what they mean for the images, and for rendered frames."""

import json
import textwrap
from dataclasses import replace
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import calfree_gym.perturbations.arm
from calfree_gym import nominal
from calfree_gym import perturbations as kinds
from calfree_gym.geometry import rotation_matrix
from calfree_gym.perturbations import Blur, Exposure, ImageNoise, Light
from calfree_gym.perturbations.schedule import undone
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.vision.image_formation import MAX_NOISE
from calfree_gym.world import WorldDistribution
from tests.calfree_gym.environments import OF_CAMERAS, begun, kinematic

RNG = np.random.default_rng


def seen(world, word=(0.05, -0.1, 0.1)):
    """True image points (gripper, object; left, right; x, y) in pixels after one motion."""
    env = begun(kinematic(world=world, camera_mount="stand"), options={"object": (0.42, 0.05, 0.12)})
    *_, info = env.step(np.array(word))
    return info["truth"]["points"].reshape(2, 2, 2) * 256


@pytest.mark.parametrize("degrees", [30.0, -120.0])
def test_a_roll_turns_the_image_about_its_centre_and_leaves_the_other_alone(degrees):
    before = seen(nominal())
    after = seen(kinds.CameraRoll("left", degrees).apply(nominal(), RNG(0)))
    radii = np.linalg.norm(before[:, 0], axis=1)
    np.testing.assert_allclose(np.linalg.norm(after[:, 0], axis=1), radii, rtol=1e-6)
    angles = [np.arctan2(*points[:, 0, ::-1].T) for points in (before, after)]
    turned = np.degrees(angles[1] - angles[0])
    np.testing.assert_allclose(np.abs((turned + 180) % 360 - 180), abs(degrees), atol=1e-4)
    np.testing.assert_array_equal(before[:, 1], after[:, 1])


def test_a_zoom_scales_the_image():
    before, after = seen(nominal()), seen(kinds.CameraZoom("right", 1.2).apply(nominal(), RNG(0)))
    np.testing.assert_allclose(after[:, 1], 1.2 * before[:, 1], rtol=1e-6)


def test_an_aim_moves_the_view_in_its_direction_by_its_angle():
    focal = nominal().focal_length[0]
    for direction, axis in ((0.0, 0), (90.0, 1)):
        world = kinds.CameraAim("left", 5.0, direction).apply(nominal(), RNG(0))
        moved = (seen(world) - seen(nominal()))[:, 0]
        assert (moved[:, axis] < -0.9 * focal * np.tan(np.radians(5))).all()
        assert (np.abs(moved[:, 1 - axis]) < 6).all()


def test_a_shift_moves_the_camera_by_its_distance_without_turning_it():
    world = kinds.CameraShift("left", 0.05).apply(nominal(), RNG(0))
    up = kinds.CameraShift("right", 0.05, elevation=90).apply(nominal(), RNG(0))
    np.testing.assert_allclose((up.camera_position - nominal().camera_position)[1], [0, 0, 0.05], atol=1e-12)
    apart = np.linalg.norm(world.camera_position - nominal().camera_position, axis=1)
    np.testing.assert_allclose(apart, [0.05, 0.0])
    np.testing.assert_array_equal(world.camera_orientation, nominal().camera_orientation)


def test_a_camera_that_is_nearer_goes_and_turns_to_the_other():
    built = nominal()
    apart = built.camera_position[1] - built.camera_position[0]
    world = kinds.CameraNearer("left", 0.75).apply(built, RNG(0))
    np.testing.assert_allclose(world.camera_position[1] - world.camera_position[0], 0.25 * apart)
    np.testing.assert_array_equal(world.camera_orientation[1], built.camera_orientation[1])
    left = [np.abs(each.camera_orientation[0] @ each.camera_orientation[1]) for each in (built, world)]
    assert np.arccos(left[1]) == pytest.approx(0.25 * np.arccos(left[0]))


def test_arm_and_motor_perturbations_do_what_they_say():
    built = nominal()
    assert kinds.JointZero("J2", 4.0).apply(built, RNG(0)).joint_zeros[1] == pytest.approx(np.radians(4))
    assert kinds.LinkLength("forearm", 1.1).apply(built, RNG(0)).link_lengths[3] == pytest.approx(0.22)
    assert kinds.MotorGain("elbow", 0.5).apply(built, RNG(0)).motor_gain.tolist() == [1, 1, 0.5]
    assert kinds.MotorSign("waist").apply(built, RNG(0)).motor_sign.tolist() == [-1, 1, 1]
    assert kinds.PointNoise(3.0).apply(built, RNG(0)).point_noise == 3.0
    reversed_ = seen(kinds.MotorSign("waist").apply(built, RNG(0)), (0.1, 0, 0))
    np.testing.assert_allclose(reversed_[0], seen(built, (-0.1, 0, 0))[0], atol=1e-9)


def test_perturbations_of_registers_are_of_all_motors_or_of_one_and_drifts_add_to_what_each_has():
    built = replace(nominal(), register_noise=[0.1, 0.2, 0.3], dead_zone=0.1)
    assert kinds.RegisterNoise(0.01).apply(built, RNG(0)).register_noise.tolist() == [0.01] * 3
    noisier = kinds.RegisterNoise(0.01).drift(built)
    np.testing.assert_allclose(noisier.register_noise, [0.11, 0.21, 0.31])
    with pytest.raises(ValueError, match=r"register_noise.registers is -0.*from 0 to 1"):
        kinds.RegisterNoise(0.15).drift(built, back=True)
    np.testing.assert_allclose(kinds.DeadZone("elbow", 0.02).drift(built).dead_zone, [0.1, 0.1, 0.12])
    assert kinds.Shortfall(0.2).apply(built, RNG(0)).shortfall.tolist() == [0.2] * 3
    shorter = kinds.LongestMotion(0.25).drift(built)
    assert shorter.longest_motion.tolist() == [0.75] * 3
    with pytest.raises(ValueError, match=r"longest_motion.words is 1.25"):
        kinds.LongestMotion(0.5).drift(shorter, back=True)


def test_a_gear_that_ripples_keeps_its_period_and_phase_as_it_wears():
    first, other = kinds.GearRipple("elbow", 0.2, 0.3, 90), kinds.GearRipple("elbow", 0.5, 0.1, 0)
    world = first.change(nominal())
    np.testing.assert_allclose(world.gear_ripple[2], [0.3, np.pi / 2, 0.2])
    assert (world.gear_ripple[:2] == nominal().gear_ripple[:2]).all()
    np.testing.assert_allclose(other.drift(world).gear_ripple[2], [0.3, np.pi / 2, 0.7])
    assert other.change(world).gear_ripple[2].tolist() == [0.1, 0, 0.5]
    with pytest.raises(ValueError, match=r"gear_ripple.depth is 1.2; it must be a number from 0 to 0.99"):
        other.drift(other.drift(world))


@pytest.mark.parametrize(
    "step",
    [
        *(kinds.PointDropout(0.3), kinds.Backlash("elbow", 0.3), kinds.DeadZone("elbow", 0.3)),
        kinds.GearRipple("elbow", 0.3, 0.3, 90),
    ],
    ids=lambda step: step.type,
)
def test_three_steps_of_a_drift_and_three_back_lead_to_where_it_began(step):
    world = nominal()
    for motion in range(6):
        world = step.drift(world, back=motion >= 3)
    assert_same(world, nominal())
    with pytest.raises(ValueError, match=f"{step.type}.* -0.3"):
        step.drift(world, back=True)


def assert_same(world, expected):
    for name, value in expected.to_dict().items():
        np.testing.assert_allclose(getattr(world, name), value, atol=1e-9, err_msg=name)


WITHOUT_INVERSE = {
    *("camera_replace", "lens", "backlash", "repeatability", "register_noise", "register_step", "shortfall"),
    *("longest_motion", "dead_zone", "gear_ripple", "point_noise", "point_outliers", "point_dropout"),
    *("latency", "light", "blur", "image_noise", "occluder", "slip"),
}


@pytest.mark.parametrize("name", sorted(kinds.TYPES))
@settings(max_examples=10)
@given(seed=st.integers(0, 10**6))
def test_a_perturbation_and_its_inverse_and_a_step_of_a_drift_and_one_back_are_nothing(name, seed):
    robot = kinds.TYPES[name].built
    world = WorldDistribution("wild").sample(seed, robot=robot)
    step = kinds.TYPES[name]().drawn(RNG(seed), slowly=True)
    there = step.drift(world, robot=robot)
    assert there != world
    assert_same(step.drift(there, back=True, robot=robot), world)
    drawn = kinds.TYPES[name]().drawn(RNG(seed))
    if name in WITHOUT_INVERSE:
        with pytest.raises(NotImplementedError, match=name):
            drawn.inverse()
    else:
        assert_same(drawn.inverse().change(drawn.change(world, robot), robot), world)


@pytest.mark.parametrize("name", sorted(kinds.TYPES))
def test_a_drift_is_slow_and_keeps_its_direction(name):
    drawn, slow = kinds.TYPES[name]().drawn(RNG(3)), kinds.TYPES[name]().drawn(RNG(3), slowly=True)
    for amount in ("degrees", "metres", "k1", "px", "share", "levels", "registers", "words", "depth"):
        if hasattr(drawn, amount):
            assert getattr(slow, amount) == pytest.approx(getattr(drawn, amount) / 100)
    if hasattr(drawn, "factor"):
        assert slow.factor**100 == pytest.approx(drawn.factor)
    pose = ("direction", "azimuth", "elevation", "strength", "ambient", "at", "seed", "period", "phase")
    for kept in ("camera", "joint", "link", "motor", "wheel", *pose):
        assert getattr(slow, kept, None) == getattr(drawn, kept, None)


def test_a_replaced_camera_is_of_its_worlds_kind():
    for name, wilder in (("wild", False), ("nominal", False), ("wilder", True)):
        world = WorldDistribution(name).sample(1)
        there = kinds.CameraReplace("left", seed=5).change(world)
        assert (there.camera_position[1] == world.camera_position[1]).all()
        assert (there.camera_position[0] != world.camera_position[0]).all()
        for field, square in (("pixel_aspect", 1), ("lens_k2", 0), ("principal_point", 0)):
            assert np.all(getattr(there, field)[0] != square) == wilder


@pytest.mark.parametrize("name", sorted(kinds.TYPES))
def test_every_type_draws_what_it_is_not_given_and_goes_to_a_dict_and_back(name):
    perturbation = kinds.parse_perturbation({"type": name})
    built = WorldDistribution("nominal").sample(0, robot=perturbation.built)
    one, same, other = (perturbation.apply(built, RNG(seed)) for seed in (1, 1, 2))
    assert one == same
    assert one != built
    assert name == "motor_sign" or one != other
    assert kinds.parse_perturbation(perturbation.to_dict()) == perturbation
    drawn = perturbation.drawn(RNG(1))
    assert kinds.parse_perturbation(json.loads(json.dumps(drawn.to_dict()))) == drawn
    assert drawn.change(built, perturbation.built) == one


def test_numbers_of_numpy_are_numbers():
    for number in (np.int64(2), np.float32(2), np.float64(2)):
        found = kinds.parse_perturbation({"type": "motor_gain", "motor": "waist", "factor": number})
        assert json.loads(json.dumps(found.to_dict()))["factor"] == 2
    assert kinds.parse_perturbation({"type": "latency", "motions": np.int32(3)}).to_dict()["motions"] == 3


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"type": "latency", "motions": np.bool_(True)}, "it must be a whole number"),
        ({"type": "camera_rol"}, "camera_rol.*did you mean camera_roll"),
        ({"type": "camera_roll", "degree": 3}, "'degree'.*did you mean degrees.*camera, degrees"),
        ({"type": "camera_roll", "camera": 0}, "camera is 0; it must name one of the robot's cameras"),
        ({"type": "camera_roll", "degrees": "30"}, "degrees is '30'; it must be a number"),
        ({"type": "camera_roll", "degrees": float("nan")}, "must be finite"),
        ({"type": "camera_zoom", "factor": 0}, "factor is 0; it must be a number from 0.001 to 1000"),
        ({"degrees": 3}, "must be a mapping with a type"),
        ({"type": ["camera_roll"]}, "allowed: camera_roll"),
        ({"type": "latency", "motions": 1.5}, "it must be a whole number"),
        ({"type": "latency", "motions": 99}, "from 0 to 10"),
        ({"type": "point_outliers", "share": 1.2}, "from 0 to 1"),
        ({"type": "light", "azimut": 3}, "'azimut'.*did you mean azimuth.*elevation, strength, ambient"),
        ({"type": "light", "elevation": -10}, "elevation is -10; it must be a number from 5 to 90"),
        ({"type": "exposure", "factor": -1}, "factor is -1; it must be a number from 0.001 to 1000"),
        ({"type": "blur", "px": -0.1}, "px is -0.1; it must be a number from 0 to 20"),
        ({"type": "image_noise", "levels": 31}, "levels is 31; it must be a number from 0 to 30"),
        ({"type": "occluder", "share": 0.9}, "share is 0.9; it must be a number from 0 to 0.8"),
        ({"type": "backlash", "degrees": -1}, "backlash.degrees is -1; it must be a number from 0 to 45"),
        ({"type": "register_noise", "px": 1}, "'px'; register_noise allows: registers"),
        ({"type": "register_step", "registers": -1}, "registers is -1; it must be a number from 0 to 1"),
        ({"type": "shortfall", "share": 0.95}, "share is 0.95; it must be a number from 0 to 0.9"),
        ({"type": "longest_motion", "words": 0}, "words is 0; it must be a number from 0.001 to 1"),
        ({"type": "dead_zone", "words": 1.5}, "words is 1.5; it must be a number from 0 to 1"),
        ({"type": "gear_ripple", "depth": 1}, "depth is 1; it must be a number from 0 to 0.99"),
        ({"type": "occluder", "at": 0}, "at is 0; it must be a number from 0.1 to 0.8"),
    ],
)
def test_damaged_perturbations(entry, message):
    with pytest.raises(ValueError, match=message) as caught:
        kinds.parse_perturbation(entry, "scenarios.0.perturbations.1.do")
    assert "scenarios.0.perturbations.1.do" in str(caught.value)


def test_the_recipe_of_the_package_makes_a_perturbation():
    recipe = calfree_gym.perturbations.__doc__
    example = textwrap.dedent(recipe[recipe.index("    @dataclass") :])
    names = {**vars(calfree_gym.perturbations.arm)}
    exec(example, names)
    kind = names["MotorCurvature"]
    drawn = kind().drawn(RNG(0))
    there = drawn.change(nominal())
    assert there.motor_curvature[MOVEMASTER.motors.index(drawn.motor)] == drawn.by
    assert_same(drawn.inverse().change(there), nominal())
    assert kind(**{k: v for k, v in drawn.to_dict().items() if k != "type"}) == drawn


def test_a_part_that_the_arm_does_not_have_is_told_when_the_environment_is_made():
    with pytest.raises(ValueError, match="link_length changes one of the robot's links; it has none"):
        kinds.LinkLength().check_fits(SimpleNamespace(links=()))
    schedule = [{"at": {"motion": 1}, "do": {"type": "camera_aim", "camera": "lft"}}]
    told = r"camera_aim.camera is 'lft' \(did you mean left\?\); allowed: left, right"
    with pytest.raises(ValueError, match=told):
        gym.make("calfree_gym:CalFree/Reach-v0", perturbations=schedule)


def test_a_robot_may_have_other_cameras():
    robot = SimpleNamespace(cameras=("front", "top", "wrist"))
    drawn = {kinds.CameraRoll().drawn(RNG(seed), robot=robot).camera for seed in range(30)}
    assert drawn == set(robot.cameras)
    world = nominal().replace(**{name: np.tile(getattr(nominal(), name)[:1].T, 3).T for name in OF_CAMERAS})
    there = kinds.Lens("wrist", 0.05).change(world, robot)
    assert there.lens_k1.tolist() == [0, 0, 0.05]
    with pytest.raises(ValueError, match="camera is 'left'; allowed: front, top, wrist"):
        kinds.Lens("left").check_fits(robot)


STILL = replace(nominal(), image_noise=np.zeros(2))
OBJECT = (0.42, 0.05, 0.12)


@pytest.fixture(scope="module")
def look(opengl):
    env = kinematic(world=STILL, camera_mount="stand", observation="rgb", image_size=512).unwrapped

    def images(world):
        env.set_world(world)
        observation, info = env.reset(seed=0, options={"object": OBJECT})
        places = (info["truth"]["points"].reshape(2, 2, 2)[1] + 1) * 256 - 0.5
        return observation["left_image"].astype(float), observation["right_image"].astype(float), places

    yield images
    env.close()


@pytest.mark.parametrize("factor", [0.5, 0.8, 1.3])
def test_exposure_scales_every_grey_level_up_to_white(look, factor):
    before, right, _ = look(STILL)
    after, same, _ = look(Exposure("left", factor).change(STILL))
    assert np.abs(after - np.minimum(factor * before, 255)).max() <= 1
    assert abs(after.mean() / before.mean() - factor) < 0.1
    np.testing.assert_array_equal(same, right)


@pytest.mark.parametrize("px", [1.5, 3.0])
def test_blur_widens_edges_by_its_standard_deviation(look, px):
    left, before, _ = look(STILL)
    same, after, _ = look(Blur("right", px).change(STILL))
    edge = np.abs(np.diff(before, axis=1)).max()
    assert np.abs(np.diff(after, axis=1)).max() == pytest.approx(edge / (px * np.sqrt(2 * np.pi)), rel=0.15)
    assert after.mean() == pytest.approx(before.mean(), abs=0.5)
    np.testing.assert_array_equal(same, left)


@pytest.mark.parametrize("levels", [2.0, 10.0, MAX_NOISE])
def test_noise_has_its_standard_deviation_and_no_mean(look, levels):
    dim = replace(STILL, exposure=np.full(2, 0.7))
    before, right, _ = look(dim)
    after, same, _ = look(ImageNoise("left", levels).change(dim))
    grey = (before > 4 * MAX_NOISE) & (before < 255 - 4 * MAX_NOISE)  # nothing is clipped
    assert grey.sum() > 10_000
    noise = (after - before)[grey]
    assert noise.std() == pytest.approx(levels, rel=0.05)
    assert abs(noise.mean()) < 0.05 * levels
    np.testing.assert_array_equal(same, right)


def test_the_bright_side_of_the_object_turns_with_the_light(look):
    to_the_right = rotation_matrix(STILL.camera_orientation[0])[:, 0]
    azimuth = float(np.degrees(np.arctan2(to_the_right[1], to_the_right[0])))
    shifts = []
    for turn in (0.0, 180.0):
        image, _, places = look(Light(azimuth + turn, 10.0, 0.8, 0.3).change(STILL))
        column, row = places[0].round().astype(int)
        ball = image[row - 3 : row + 4, column - 3 : column + 4, 1]
        shifts.append((ball * np.arange(-3, 4)).sum() / ball.sum())
    assert shifts[0] > 0.1
    assert shifts[1] < -0.1


def test_the_lamp_stands_where_it_is_said_to():
    above = Light(0.0, 90.0, 0.5, 0.4).change(STILL)
    np.testing.assert_allclose(above.light_direction, [0, 0, -1], atol=1e-12)
    along_y = Light(90.0, 30.0, 0.5, 0.4).change(STILL)
    np.testing.assert_allclose(along_y.light_direction, [0, -np.sqrt(3) / 2, -0.5], atol=1e-12)
    assert (along_y.light_strength, along_y.light_ambient) == (0.5, 0.4)


def test_undoing_a_light_brings_the_whole_lamp_back():
    """Two lamps at one height differ in two of three numbers; a third has all of them else."""
    first = Light(0.0, 50.0, 0.5, 0.4).change(STILL)
    second, third = (Light(*at, 0.5, 0.4).change(first) for at in ((90.0, 50.0), (10.0, 70.0)))
    assert undone(third, first, second) == first
