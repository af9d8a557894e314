"""Perturbations against what they mean for the images, and schedules against when they strike."""

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calfree_gym import nominal
from calfree_gym.perturbations import (
    TYPES,
    CameraAim,
    CameraRoll,
    CameraShift,
    CameraZoom,
    JointZero,
    LinkLength,
    MotorGain,
    MotorSign,
    PointNoise,
    parse_perturbation,
)
from calfree_gym.schedule import parse_schedule

RNG = np.random.default_rng


def seen(world, word=(0.05, -0.1, 0.1)):
    """True image points (gripper, object; left, right; x, y) in pixels after one motion."""
    env = gym.make("CalFree/Reach-v0", world=world, camera_mount="stand", dynamics="kinematic").unwrapped
    env.reset(seed=0, options={"object": (0.42, 0.05, 0.12)})
    *_, info = env.step(np.array(word))
    return info["truth"]["points"].reshape(2, 2, 2) * 256


@pytest.mark.parametrize("degrees", [30.0, -120.0])
def test_a_roll_turns_the_image_about_its_centre_and_leaves_the_other_alone(degrees):
    before = seen(nominal())
    after = seen(CameraRoll("left", degrees).apply(nominal(), RNG(0)))
    radii = np.linalg.norm(before[:, 0], axis=1)
    np.testing.assert_allclose(np.linalg.norm(after[:, 0], axis=1), radii, rtol=1e-6)
    turned = np.degrees(
        np.arctan2(after[:, 0, 1], after[:, 0, 0]) - np.arctan2(before[:, 0, 1], before[:, 0, 0])
    )
    np.testing.assert_allclose(np.abs((turned + 180) % 360 - 180), abs(degrees), atol=1e-4)
    np.testing.assert_array_equal(before[:, 1], after[:, 1])


def test_a_zoom_scales_the_image():
    before, after = seen(nominal()), seen(CameraZoom("right", 1.2).apply(nominal(), RNG(0)))
    np.testing.assert_allclose(after[:, 1], 1.2 * before[:, 1], rtol=1e-6)


def test_an_aim_moves_the_view_in_its_direction_by_its_angle():
    focal = nominal().focal_length[0]
    for direction, axis in ((0.0, 0), (90.0, 1)):
        world = CameraAim("left", 5.0, direction).apply(nominal(), RNG(0))
        moved = (seen(world) - seen(nominal()))[:, 0]
        assert (moved[:, axis] < -0.9 * focal * np.tan(np.radians(5))).all()
        assert (np.abs(moved[:, 1 - axis]) < 6).all()


def test_a_shift_moves_the_camera_by_its_distance_without_turning_it():
    world = CameraShift("left", 0.05).apply(nominal(), RNG(0))
    up = CameraShift("right", 0.05, elevation=90).apply(nominal(), RNG(0))
    np.testing.assert_allclose((up.camera_position - nominal().camera_position)[1], [0, 0, 0.05], atol=1e-12)
    apart = np.linalg.norm(world.camera_position - nominal().camera_position, axis=1)
    np.testing.assert_allclose(apart, [0.05, 0.0])
    np.testing.assert_array_equal(world.camera_orientation, nominal().camera_orientation)


def test_arm_and_motor_perturbations_do_what_they_say():
    built = nominal()
    assert JointZero("J2", 4.0).apply(built, RNG(0)).joint_zeros[1] == pytest.approx(np.radians(4))
    assert LinkLength("forearm", 1.1).apply(built, RNG(0)).link_lengths[3] == pytest.approx(0.22)
    assert MotorGain("elbow", 0.5).apply(built, RNG(0)).motor_gain.tolist() == [1, 1, 0.5]
    assert MotorSign("waist").apply(built, RNG(0)).motor_sign.tolist() == [-1, 1, 1]
    assert PointNoise(3.0).apply(built, RNG(0)).point_noise == 3.0
    reversed_ = seen(MotorSign("waist").apply(built, RNG(0)), (0.1, 0, 0))
    np.testing.assert_allclose(reversed_[0], seen(built, (-0.1, 0, 0))[0], atol=1e-9)


@pytest.mark.parametrize(
    "pair",
    [
        (CameraRoll("left", 33.0), CameraRoll("left", -33.0)),
        (CameraAim("right", 7.0, 20.0), CameraAim("right", -7.0, 20.0)),
        (CameraZoom("left", 1.25), CameraZoom("left", 0.8)),
        (CameraShift("left", 0.05, 30.0, 10.0), CameraShift("left", -0.05, 30.0, 10.0)),
        (JointZero("J3", 3.0), JointZero("J3", -3.0)),
        (LinkLength("hand", 2.0), LinkLength("hand", 0.5)),
        (MotorGain("waist", 2.0), MotorGain("waist", 0.5)),
        (MotorSign("elbow"), MotorSign("elbow")),
    ],
    ids=lambda pair: pair[0].type,
)
def test_a_perturbation_and_its_inverse_are_nothing(pair):
    world = nominal()
    for perturbation in pair:
        world = perturbation.apply(world, RNG(0))
    for name, value in nominal().to_dict().items():
        np.testing.assert_allclose(getattr(world, name), value, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("name", sorted(TYPES))
def test_every_type_draws_what_it_is_not_given_and_goes_to_a_dict_and_back(name):
    perturbation = parse_perturbation({"type": name})
    one, same, other = (perturbation.apply(nominal(), RNG(seed)) for seed in (1, 1, 2))
    assert one == same
    assert one != nominal()
    assert name == "motor_sign" or one != other
    assert parse_perturbation(perturbation.to_dict()) == perturbation
    drawn = perturbation.drawn(RNG(1))
    assert parse_perturbation(drawn.to_dict()) == drawn
    assert drawn.change(nominal()) == one


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"type": "camera_rol"}, "camera_rol.*did you mean camera_roll"),
        ({"type": "camera_roll", "degree": 3}, "'degree'.*did you mean degrees.*camera, degrees"),
        ({"type": "camera_roll", "camera": "middle"}, "camera is 'middle'; allowed: left, right"),
        ({"type": "camera_roll", "degrees": "30"}, "degrees is '30'; it must be a number"),
        ({"type": "camera_roll", "degrees": float("nan")}, "must be finite"),
        ({"type": "camera_zoom", "factor": 0}, "factor is 0; it must be a number from 0.001 to 1000"),
        ({"degrees": 3}, "must be a mapping with a type"),
        ({"type": ["camera_roll"]}, "allowed: camera_roll"),
        ({"type": "latency", "motions": 1.5}, "it must be a whole number"),
        ({"type": "latency", "motions": 99}, "from 0 to 10"),
        ({"type": "point_outliers", "share": 1.2}, "from 0 to 1"),
    ],
)
def test_damaged_perturbations(entry, message):
    with pytest.raises(ValueError, match=message) as caught:
        parse_schedule([{"at": {"trial": 1}, "do": entry}])
    assert "perturbations[0].do" in str(caught.value)


@pytest.mark.parametrize(
    ("at", "message"),
    [
        ({"motion": -1}, r"perturbations\[0\].at.motion is -1"),
        ({"motion": 1.5}, "1.5; it must be a whole number"),
        ({"motion": True}, "True; it must be a whole number"),
        ({"every": {"trial": 0}}, "at.every.trial is 0"),
        ({"motion": 1, "trial": 2}, "must be one of"),
        (7, "must be one of"),
    ],
)
def test_damaged_times(at, message):
    with pytest.raises(ValueError, match=message):
        parse_schedule([{"at": at, "do": {"type": "camera_roll"}}])


def strikes(schedule, trials=4, motions=3):
    """(trial, motion of the trial) before which something struck; motion 0 is the reset."""
    env = gym.make("CalFree/Reach-v0", perturbations=schedule, dynamics="kinematic").unwrapped
    found, seed = [], 0
    for trial in range(trials):
        _, info = env.reset(seed=seed)
        seed = None
        found += [(trial, 0)] * len(info["perturbed"])
        for motion in range(1, motions + 1):
            *_, info = env.step(np.full(3, 0.01))
            found += [(trial, motion)] * len(info["perturbed"])
    return found


def test_schedules_strike_when_they_say():
    roll = {"type": "camera_roll"}
    assert strikes([{"at": {"motion": 4}, "do": roll}]) == [(1, 2)]
    assert strikes([{"at": {"motion": 0}, "do": roll}]) == [(0, 1)]
    assert strikes([{"at": {"trial": 2}, "do": roll}]) == [(2, 0)]
    assert strikes([{"at": {"every": {"trial": 1}}, "do": roll}]) == [(1, 0), (2, 0), (3, 0)]
    assert strikes([{"at": {"every": {"motion": 5}}, "do": roll}]) == [(1, 3), (3, 2)]


@settings(max_examples=15, deadline=None)
@given(
    st.lists(
        st.tuples(st.sampled_from(sorted(TYPES)), st.sampled_from(["motion", "trial"]), st.integers(0, 6)),
        max_size=4,
    ),
    st.integers(0, 100),
)
def test_any_schedule_runs_and_stays_in_bounds(entries, seed):
    schedule = [{"at": {clock: count}, "do": {"type": name}} for name, clock, count in entries]
    env = gym.make("CalFree/Reach-v0", perturbations=schedule, dynamics="kinematic").unwrapped
    rng = RNG(seed)
    for trial in range(3):
        observation, _ = env.reset(seed=seed if trial == 0 else None)
        for _ in range(4):
            assert env.observation_space.contains(observation)
            observation, *_ = env.step(rng.uniform(-1, 1, 3))


def test_what_strikes_does_not_depend_on_what_the_agent_did():
    def worlds(words):
        schedule = [{"at": {"every": {"motion": 3}}, "do": {"type": "camera_replace"}}]
        env = gym.make("CalFree/Reach-v0", perturbations=schedule, dynamics="kinematic").unwrapped
        env.reset(seed=9)
        found = []
        for i in range(12):
            env.step(np.full(3, words))
            if i % 4 == 3 and words > 0.1:
                env.reset()
            found.append(env.world)
        return found

    assert worlds(0.01) == worlds(0.3)


def test_a_perturbation_that_is_never_in_view_is_an_error_that_names_it():
    schedule = [{"at": {"motion": 0}, "do": {"type": "camera_aim", "camera": "left", "degrees": 180}}]
    env = gym.make("CalFree/Reach-v0", perturbations=schedule, dynamics="kinematic").unwrapped
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"camera_aim.*never in view"):
        env.step(np.zeros(3))


def test_infos_tell_all_that_a_perturbation_drew():
    schedule = [{"at": {"motion": 1}, "do": {"type": "camera_roll"}}]
    env = gym.make("CalFree/Reach-v0", perturbations=schedule, dynamics="kinematic").unwrapped
    env.reset(seed=0)
    env.step(np.zeros(3))
    before = env.world
    *_, info = env.step(np.zeros(3))
    (drawn,) = info["perturbed"]
    assert drawn.degrees is not None
    assert drawn.change(before) == env.world
