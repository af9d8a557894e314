"""Worlds of any arm: as long as the arm's parts, in view, and with objects that can be reached."""

from dataclasses import replace

import numpy as np
import pytest

from calfree_gym import DISTRIBUTIONS, World, WorldDistribution, nominal
from tests.arms.every import EVERY, arm_named, rows_of, three_mounts
from tests.arms.own import ARMS
from tests.calfree_gym.environments import make

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


@pytest.mark.parametrize("field", ["motor_gain", "motor_curvature", *OF_ALL_MOTORS])
def test_all_fields_of_motors_are_as_long_as_each_other(field):
    must = r"\(3, 3\)" if field == "gear_ripple" else r"\(3,\)"
    with pytest.raises(ValueError, match=rf"World.{field} has shape \(2,\); it must be {must}"):
        replace(nominal(), **{field: [0.1, 0.1]})


def test_a_world_of_another_arm_is_refused():
    with pytest.raises(ValueError, match=r"World.motor_sign has shape .7,.; it must be .3,."):
        make(world=nominal(arm_named("redundant").robot))
    env = make(arm=arm_named("scara"))
    with pytest.raises(ValueError, match="shoulder, elbow, lift, roll"):
        env.unwrapped.set_world(nominal())


@pytest.mark.parametrize("name", ["scara", "redundant"])
def test_worlds_as_drawn_have_no_new_errors_and_what_the_docs_say(name):
    robot = arm_named(name).robot
    worlds = [WorldDistribution("wild").sample(seed, robot=robot) for seed in range(200)]
    assert all(not (w.backlash.any() or w.repeatability.any()) for w in worlds)
    gains = np.array([w.motor_gain for w in worlds])
    assert 0.5 <= gains.min() < 0.55
    assert 1.8 < gains.max() <= 2
    assert {-1, 1} == set(np.ravel([w.motor_sign for w in worlds]))
    zeros = np.array([w.joint_zeros for w in worlds])
    most = np.where(robot.slides, np.radians(10) * robot.span / 2, np.radians(10))
    assert (np.abs(zeros) <= most).all()
    assert (np.abs(zeros).max(0) > 0.9 * most).all()
    stretch = np.array([w.link_lengths for w in worlds]) / robot.lengths
    assert 0.9 <= stretch.min() < 0.91
    assert 1.09 < stretch.max() <= 1.1
