"""An arm is a value: equal wherever its files are, plain text in a dict, the same after every way round."""

import copy
import gc
import json
import pickle
import weakref

import mujoco
import numpy as np
import pytest

from calfree_gym import Arm
from calfree_gym.robot.arms.arm import robot_of
from tests.arms.every import EVERY, arm_named
from tests.arms.own import ARMS, MOTORS
from tests.calfree_gym.environments import kinematic, make
from tests.calfree_gym.robot.arms.test_chain import ALL_KINDS, all_kinds

CHAIN = """
<mujoco><compiler angle="degree"/><worldbody>
  <body name="base"><geom type="cylinder" size="0.05 0.1" pos="0 0 0.1"/>
    <body pos="0 0 0.2"><joint name="j1" axis="0 0 1" range="-150 150"/>
    <geom type="capsule" fromto="0 0 0 0 0 0.05" size="0.03"/>
      <body pos="0 0 0.05"><joint name="j2" axis="0 1 0" range="-90 90"/>
    <geom type="capsule" fromto="0 0 0 0.25 0 0" size="0.02"/>
        <body pos="0.25 0 0"><joint name="j3" axis="0 1 0" range="-10 120"/>
    <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02"/>
          <site name="tip" pos="0.2 0 0"/>
        </body></body></body></body>
</worldbody></mujoco>
"""


@pytest.mark.parametrize("name", EVERY)
def test_an_arm_goes_through_json_pickle_and_copies_exactly(name):
    arm = arm_named(name)
    plain = json.loads(json.dumps(arm.to_dict()))
    assert arm.motors == arm.robot.motors == MOTORS.get(name, arm.motors)
    for again in (Arm.from_dict(plain), pickle.loads(pickle.dumps(arm)), copy.deepcopy(arm), copy.copy(arm)):
        assert again == arm
        assert hash(again) == hash(arm)
        assert again.to_dict() == plain
        assert (again.robot.home_qpos == arm.robot.home_qpos).all()
        assert (again.robot.rig.position == arm.robot.rig.position).all()


def test_arms_are_different_values():
    arms = [arm_named(name) for name in ARMS]
    arms += [
        Arm(**ARMS["hobby"] | {"home": {"elbow": 0.5}}),
        Arm(**ARMS["hobby"] | {"motors": ["turn", "shoulder", "elbow"]}),
        Arm(**ARMS["gripper"] | {"gripper": "hand"}),
    ]
    assert len(set(arms)) == len(arms)
    assert all((a == b) == (a is b) for a in arms for b in arms)
    assert arms[0] != "scara"


def test_arms_that_nobody_uses_leave_memory_but_for_a_few():
    robots, hidden = [], [{"at": {"trial": 0}, "do": {"type": "occluder"}}]
    for angle in range(8):
        arm = Arm(CHAIN, "tip", home={"j2": 0.1 * angle})
        make("SafeReach", arm=arm, perturbations=hidden).reset(seed=0)
        robots.append(weakref.ref(arm.robot))
    del arm
    gc.collect()
    assert sum(robot() is not None for robot in robots) <= 4


def test_a_path_its_text_and_its_spec_are_the_same_arm_and_a_spec_is_not_changed():
    path, arm = ARMS["scara"]["model"], arm_named("scara")
    spec = mujoco.MjSpec.from_file(str(path))
    before = spec.to_xml()
    for same in (Arm(model=path.read_text(), gripper="tip"), Arm(model=spec, gripper="tip")):
        assert same.home == pytest.approx(arm.home, abs=1e-5)
        assert same.motors == arm.motors
        make(arm=same).reset(seed=0)
    assert spec.to_xml() == before
    assert arm == Arm(model=str(path), gripper="tip")


def test_what_has_no_name_is_called_by_its_place_and_by_a_name_that_is_free():
    text = ARMS["gripper"]["model"].read_text().replace('name="ready" ', "")
    keyed = Arm(model=text, gripper="pinch", home="key_0")
    assert keyed.robot.home == pytest.approx(arm_named("gripper").robot.home)
    text = ALL_KINDS.replace('<body name="hand" ', "<body ").replace('name="wrist" ', "")
    arm = Arm(model=text, gripper="tip", motors=["lift", "tilt", "turn", "joint_6"], home="about")
    assert arm.robot.links[-2] == "body_4"
    assert arm.robot.home == pytest.approx(all_kinds().robot.home)
    named = CHAIN.replace('<joint name="j1"', '<joint name="joint_2"').replace('<joint name="j3"', "<joint")
    assert len(Arm(named, "tip").motors) == 3


def test_home_by_keyframe_by_name_and_none():
    robot = arm_named("gripper").robot
    assert robot.home == pytest.approx([0, -0.4, 0.9, 0.6, 0])
    assert robot.home_qpos == pytest.approx([0.3, 0.1, 0.02, 1, 0, 0, 0, *robot.home, 0.03, 0.03])

    named = Arm(**ARMS["gripper"] | {"home": {"elbow_flex": 0.7}})
    assert named.home["elbow_flex"] == 0.7
    assert named.home["shoulder_lift"] == 0
    assert named.home["left_finger"] == 0.005, "where the model has it, within its range"

    model, none = arm_named("gripper").robot.model, Arm(**ARMS["gripper"] | {"home": None})
    for motor in none.motors:
        low, high = model.joint(motor).range
        assert low < none.home[motor] < high
    assert none == Arm(**ARMS["gripper"] | {"home": None}), "the same each time"


def test_a_base_has_its_own_joints_before_it():
    arm, high = arm_named("mobile"), Arm(**ARMS["mobile"] | {"home": {"torso_lift": 0.3, "drive_x": 1.0}})
    assert arm.base == "mount"
    assert not {"drive_x", "drive_y", "torso_lift"} & set(arm.motors)
    assert "mount" not in arm.robot.links
    assert arm.home["torso_lift"] == pytest.approx(0.05)
    at, moved = (each.robot.frames("mount", each.robot.home, each.robot.lengths)[0] for each in (arm, high))
    ahead = [np.cos(np.radians(120)), np.sin(np.radians(120)), 0.25]
    assert moved - at == pytest.approx(ahead, abs=1e-5)
    seen = make(arm=high, dynamics="kinematic").reset(seed=0)[0]
    assert (seen["observation"][:4] == 1).all()


def test_a_free_base_and_balls_are_held_in_physics():
    arguments = {"arm": all_kinds(), "camera_mount": "stand", "terminate_on_success": False}
    envs = [make(**arguments), kinematic(**arguments)]
    for env in envs:
        env.reset(seed=2)
    rng = np.random.default_rng(0)
    for _ in range(10):
        words = rng.uniform(-1, 1, 4).astype(np.float32)
        points, other = (env.step(words)[-1]["truth"]["points"] for env in envs)
        shown = np.abs(other) <= 1
        assert points[shown] * 256 == pytest.approx(other[shown] * 256, abs=0.2)


def test_from_dict_names_what_is_unknown_and_what_is_missing():
    with pytest.raises(ValueError, match="an arm has no grip; allowed: model, gripper, motors, home, base"):
        Arm.from_dict({"model": "a.xml", "grip": "tip"})
    with pytest.raises(ValueError, match="an arm lacks gripper"):
        Arm.from_dict({"model": "a.xml"})
    for none in ([1], None, "a.xml"):
        with pytest.raises(ValueError, match=r"an arm is .*; it must be a mapping of model, gripper, motors"):
            Arm.from_dict(none)
    with pytest.raises(ValueError, match="an arm has no 5, grip; allowed: model"):
        Arm.from_dict({"grip": 1, 5: 1})
    for home, said in (
        ({"elbow_flex": 10**400}, "home has 'elbow_flex' at 1000.*; it must be a number"),
        ({"elbow_flex": 0.1, 5: 0.1}, "home names 5; the arm's hinges and slides are"),
    ):
        with pytest.raises(ValueError, match=said):
            Arm(**ARMS["gripper"] | {"home": home})


def wide(joint):
    return (
        f'<mujoco><worldbody><body><joint name="turn" axis="0 0 1" {joint}/><geom size="0.02"/>'
        '<body pos="0 0 0.1"><joint name="lift" axis="0 1 0" range="-60 60"/><geom size="0.02"/>'
        '<body pos="0.2 0 0"><joint name="bend" axis="0 1 0" range="-60 60"/><geom size="0.02"/>'
        '<site name="tip" pos="0.2 0 0"/></body></body></body></worldbody></mujoco>'
    )


@pytest.mark.parametrize(
    ("range_", "home", "stops"),
    [
        (None, 30, (-150, 210)),
        ("-20 320", 0, (-20, 320)),
        ("-180 180", 30, (-180, 180)),
        ("-200 200", 30, (-160, 200)),
        ("-3000 3600", 60, (-120, 240)),
        ("-360 360", 300, (0, 360)),
        ("-360 360", -190, (-360, 0)),
    ],
)
def test_a_hinge_loses_no_posture_by_that(range_, home, stops):
    turn = wide(f'range="{range_}"' if range_ else "")
    robot = pickle.loads(pickle.dumps(Arm(turn, "tip", home={"turn": np.radians(home)}))).robot
    assert np.rad2deg(robot.stops[0]) == pytest.approx(stops)
    assert robot.home[0] == pytest.approx(np.radians(home))


def test_home_is_at_a_stop_where_a_worlds_zero_error_would_put_it_beyond():
    text = CHAIN.replace('range="-90 90"', 'range="0 90"', 1)
    assert text != CHAIN
    arm = Arm(text, "tip", home={"j2": 0.0, "j3": 0.5})
    env = kinematic(arm=arm, camera_mount="stand", keep_in_view=False)
    for seed in range(4):
        _, info = env.reset(seed=seed)
        home = info["truth"]["joints"]
        observation, *_, info = env.step(np.zeros(env.action_space.shape))
        np.testing.assert_array_equal(info["truth"]["joints"], home)
        assert not observation["observation"][4:].any()
        assert home[1] >= 0


def test_home_of_an_arm_that_moves_in_a_plane_is_not_told_by_rounding(tmp_path, monkeypatch):
    """What its motors move across that plane is nothing, in any posture."""
    (tmp_path / "flat.xml").write_text(CHAIN.replace('axis="0 0 1"', 'axis="0 1 0"'))
    robot, svd = robot_of(Arm(tmp_path / "flat.xml", gripper="tip")), np.linalg.svd
    homes = []
    for seed in range(3):
        rng = np.random.default_rng(seed)

        def another(matrices, rng=rng, **options):
            lengths = svd(matrices, **options)
            return np.abs(lengths + 1e-15 * lengths.max() * rng.normal(size=lengths.shape))

        monkeypatch.setattr(np.linalg, "svd", another)
        homes.append(robot._best_posture())
    assert np.ptp(homes, axis=0).max() == 0
