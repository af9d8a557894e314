"""What cannot be an arm is refused before any simulation: what was found, where, and what is allowed."""

from dataclasses import replace

import gymnasium as gym
import mujoco
import numpy as np
import pytest

from calfree_gym import Arm, nominal
from calfree_gym.geometry import looking_at
from calfree_gym.robot import simulation
from tests.arms.every import arm_named
from tests.arms.own import ARMS, MODELS
from tests.calfree_gym.robot.arms.test_chain import ALL_KINDS

AXES = ("0 0 1", "0 1 0", "1 0 0")
ID = "calfree_gym:CalFree/Reach-v0"


@pytest.fixture(autouse=True)
def no_simulation(monkeypatch):
    """Nothing is stepped or placed."""
    for name in ("place", "move", "refresh"):
        monkeypatch.setattr(simulation.ReachSimulation, name, None)


def refused(message, **arguments):
    with pytest.raises(ValueError, match=message) as caught:
        Arm(**arguments)
    with pytest.raises(ValueError, match=message):
        gym.make(ID, arm=arguments)
    return str(caught.value)


def refused_change(name, message, **arguments):
    return refused(message, **ARMS[name] | arguments)


@pytest.mark.parametrize(
    ("model", "message"),
    [
        ("no/such/arm.xml", r"no/such/arm.xml: there is no such MJCF file"),
        ("<robot name='urdf?'><link/></robot>", "the MJCF text (is no MJCF that MuJoCo|cannot be compiled)"),
        ("<mujoco><worldbody><body></mujoco>", "the MJCF text is no MJCF that MuJoCo can read"),
        ("<mujoco><worldbody><bodi/></worldbody></mujoco>", "is no MJCF that MuJoCo can read[^']*'bodi'"),
        (MODELS, "there is no such MJCF file"),
    ],
)
def test_no_mjcf(model, message):
    refused(message, model=model, gripper="tip")


def test_a_file_that_is_no_mjcf(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_bytes(b"\x00\x01 not an arm")
    refused(r"arm.xml is no MJCF that MuJoCo can read", model=path, gripper="tip")


def test_a_missing_mesh(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(ARMS["names"]["model"].read_text())
    message = refused(r"names wedge.stl, which cannot be read at", model=path, gripper="left.arm/tip")
    assert str(tmp_path / "meshes" / "wedge.stl") in message


def test_a_spec_with_assets_in_memory():
    spec = mujoco.MjSpec.from_string("<mujoco/>")
    spec.assets = {"a.stl": b"x"}
    refused("the MjSpec holds assets in memory", model=spec, gripper="tip")


def test_assets_that_are_no_mapping():
    refused_change("scara", r"assets is \['a.stl'\]; it must be digests by file", assets=["a.stl"])


@pytest.mark.parametrize("gripper", ["tipp", "", "world", "shoulder"])
def test_no_such_gripper(gripper):
    message = refused_change("scara", "the arm has no site or body", gripper=gripper)
    assert "its sites: tip;" in message
    assert "inner arm, outer arm, quill, flange" in message
    assert ("did you mean tip" in message) == (gripper == "tipp")


def test_a_gripper_that_nothing_moves():
    refused_change("gripper", "it must have 3 to 7", gripper="base")
    text = ARMS["scara"]["model"].read_text().replace("<worldbody>", '<worldbody><site name="wall"/>')
    refused("the gripper 'wall' is fixed in the room", model=text, gripper="wall")


@pytest.mark.parametrize(
    ("name", "motors", "message"),
    [
        ("gripper", ["shoulder_pan", "elbow_flex", "left_finger"], "'left_finger' is not between the base"),
        ("mobile", ["drive_x", "pan", "lift"], "'drive_x' is not between the base 'mount' and the gripper"),
        (
            "scara",
            ["shoulder", "elbow", "lft"],
            "no joint 'lft' .did you mean lift.*shoulder, elbow, lift, roll",
        ),
        ("scara", ["shoulder", "elbow"], "has 2 motors, shoulder, elbow; it must have 3 to 7"),
        ("scara", [], "has 0 motors, none; it must have 3 to 7"),
        ("scara", ["shoulder", "elbow", "elbow"], "must be a list of different joints' names"),
        ("scara", "shoulder", "must be a list of different joints' names"),
    ],
)
def test_motors_that_are_none(name, motors, message):
    refused_change(name, message, motors=motors)


@pytest.mark.parametrize(("motor", "kind"), [("neck", "ball"), ("cart", "free")])
def test_balls_and_free_joints_are_no_motors(motor, kind):
    refused(
        f"the motor '{motor}' is a {kind} joint; a motor is a hinge or a slide; allowed: lift, tilt, stuck",
        model=ALL_KINDS,
        gripper="tip",
        motors=[motor, "lift", "tilt", "turn"],
    )


def chain(joints, equality="", mocap=""):
    """An arm of hinges one behind the other."""
    bodies = "".join(
        f'<body name="link {i}" pos="{0 if i == 0 else 0.1} 0 {0.05 if i == 0 else 0}">'
        f'<joint name="{name}" axis="0 {i % 2} {1 - i % 2}" range="-90 90"/><geom size="0.03"/>'
        for i, name in enumerate(joints)
    )
    return (
        f"<mujoco><worldbody>{bodies}<site name='tip' pos='0.1 0 0'/>{'</body>' * len(joints)}{mocap}"
        f"</worldbody>{equality}</mujoco>"
    )


def test_too_few_motors_say_where_the_chain_was_taken_to_begin_and_to_end():
    refused(
        "has 2 motors, a, b; .* starts at base='link 0' and ends where gripper='link 1' is, at .* 'link 1'",
        model=chain("abcd"),
        gripper="link 1",
    )


def test_more_than_seven_motors_must_be_chosen():
    model = chain("abcdefgh")
    refused(
        "has 8 motors, a, b, c, d, e, f, g, h; it must have 3 to 7. motors= chooses",
        model=model,
        gripper="tip",
    )
    assert Arm(model=model, gripper="tip", motors=list("acdfgh")).motors == tuple("acdfgh")
    assert Arm(model=model, gripper="tip", base="link 5").motors == tuple("fgh")


TIED = {
    "a mimic joint": ('<joint name="tie" joint1="b" joint2="c"/>', "'tie' ties the motors b, c"),
    "a locked joint": ('<joint joint1="c"/>', "equality 0 ties the motors c"),
    "a closed loop": (
        '<connect name="rod" body1="link 0" body2="link 3" anchor="0 0 0"/>',
        "'rod' ties the motors b, c, d",
    ),
    "a fixed end": ('<weld body1="link 3"/>', "ties the motors a, b, c, d"),
    "a tendon": ('<tendon name="belt" tendon1="both"/>', "'belt' ties the motors a, d"),
}
TENDON = "<tendon><fixed name='both'><joint joint='a' coef='1'/><joint joint='d' coef='-1'/></fixed></tendon>"


@pytest.mark.parametrize("tie", TIED)
def test_motors_that_are_tied_to_other_parts(tie):
    equality, message = TIED[tie]
    model = chain("abcd", f"{TENDON}<equality>{equality}</equality>")
    refused(message + ".*only open chains of motors can be simulated", model=model, gripper="tip")


def test_equalities_that_hold_no_motor_are_no_hindrance():
    loose = '<weld body1="hand" body2="link 3"/>'
    hand = '<body name="hand" mocap="true" pos="0.4 0 0.05"/>'
    off = '<joint joint1="b" joint2="c" active="false"/>'
    arm = Arm(model=chain("abcd", f"<equality>{loose}{off}</equality>", hand), gripper="tip")
    assert arm.motors == tuple("abcd")


def test_homes_that_cannot_be():
    refused_change("hobby", "home has 'elbow' at 3; its range is", home={"elbow": 3})
    refused_change("scara", r"home has 'lift' at -0.1; its range is 0 to 0.2", home={"lift": -0.1})
    refused_change(
        "gripper", "home has 'left_finger' at 0.5; its range is 0.005 to 0.04", home={"left_finger": 0.5}
    )
    refused_change("scara", "home names 'lft' .did you mean lift", home={"lft": 0.1})
    refused_change("scara", "home has 'lift' at 'up'; it must be a number", home={"lift": "up"})
    refused_change("scara", "home has 'lift' at nan; it must be a number", home={"lift": float("nan")})
    refused_change("gripper", "no keyframe 'redy' .did you mean ready.*; it has ready", home="redy")
    refused_change("scara", "no keyframe 'home'; it has none", home="home")
    out = ARMS["gripper"]["model"].read_text().replace("0 -0.4 0.9 0.6", "0 -0.4 1.9 0.6")
    refused(
        "home has 'elbow_flex' at 1.9; its range is -1.69 to 1.69", model=out, gripper="pinch", home="ready"
    )


def test_bases_that_cannot_be():
    refused_change("mobile", "base is 'mont' .did you mean mount", base="mont")
    refused_change("mobile", "base is 'world'", base="world")
    refused_change("mobile", r"has 2 motors.*the chain starts at base='wrist'", base="wrist")


def test_ranges_that_cannot_be():
    text = ARMS["gantry"]["model"].read_text()
    endless = text.replace('axis="1 0 0" range="-0.6 0.6"', 'axis="1 0 0"')
    refused("the motor 'x' slides without limits; give its joint a range", model=endless, gripper="hook")
    still = text.replace('axis="1 0 0" range="-0.6 0.6"', 'axis="1 0 0" range="0.6 0.6" limited="true"')
    refused(
        "the motor 'x' ranges from 0.6 to 0.6; it cannot move|cannot be compiled", model=still, gripper="hook"
    )


def test_a_gripper_that_motors_only_turn():
    still = '<mujoco><worldbody><body>{}<geom size="0.03"/><site name="tip"/></body></worldbody></mujoco>'
    joints = "".join(f'<joint name="{name}" axis="{axis}"/>' for name, axis in zip("abc", AXES, strict=True))
    refused(
        "the motors a, b, c turn the site 'tip' and do not move it; gripper= names",
        model=still.format(joints),
        gripper="tip",
    )


@pytest.mark.parametrize("arm", ["movmaster", 7, None, MODELS, ["movemaster"]])
def test_an_arm_of_a_wrong_type(arm):
    with pytest.raises(
        ValueError, match=r"arm is .* it must be 'movemaster', a calfree_gym.Arm, or a mapping"
    ):
        gym.make(ID, arm=arm)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"gripper": None}, "gripper is None; it must be the name of a site or body"),
        ({"gripper": ["tip"]}, "gripper is .'tip'.; it must be the name of a site or body"),
        ({"model": 3}, "model is 3; it must be a path, MJCF text, or an mujoco.MjSpec"),
        ({"model": None}, "model is None; it must be a path"),
        ({"motors": 3}, "motors is 3; it must be a list of different joints' names"),
        ({"motors": [1, 2, 3]}, "motors is .1, 2, 3.; it must be a list of different joints' names"),
        ({"motors": [["shoulder"], "elbow", "lift"]}, "motors is .*it must be a list of different joints"),
        ({"home": 3}, "home is 3; it must be a keyframe's name, or positions by joint name"),
        ({"home": ["lift"]}, "home is .'lift'.; it must be a keyframe's name"),
        ({"home": {3: 1}}, "home names 3; the arm's hinges and slides are shoulder"),
        ({"base": 3}, "base is 3; it must be the name of a body"),
    ],
)
def test_arguments_of_wrong_types(arguments, message):
    refused_change("scara", message, **arguments)


@pytest.mark.parametrize(
    "mount", ["wrist", ("stand",), ("stand", "wrist"), ("waist", "stand", "waist"), 3, None]
)
def test_cameras_on_what_is_no_body(mount):
    allowed = "allowed: waist, stand, inner arm, column, outer arm, quill, flange, or a pair of these"
    with pytest.raises(ValueError, match=f"camera_mount is .*{allowed}"):
        gym.make(ID, arm=arm_named("scara"), camera_mount=mount)


@pytest.mark.parametrize("name", ["scara", "mobile", "redundant"])
def test_cameras_that_never_see_the_gripper(name):
    arm = arm_named(name)
    world = nominal(arm.robot)
    away = [looking_at(p, 2 * p - arm.robot.rig.target) for p in world.camera_position]
    for mount in ("waist", "stand"):
        with pytest.raises(ValueError, match=f"the given world is not in view on the '{mount}' mount"):
            gym.make(ID, arm=arm, camera_mount=mount, world=replace(world, camera_orientation=np.stack(away)))


@pytest.mark.parametrize("type_", ["motor_gain", "motor_sign", "backlash", "repeatability"])
def test_perturbations_of_motors_that_the_arm_has_not(type_):
    entry = {"at": {"motion": 1}, "do": {"type": type_, "motor": "waist"}}
    with pytest.raises(ValueError, match=f"{type_}.motor is 'waist'; allowed: shoulder, elbow, lift, roll"):
        gym.make(ID, arm=arm_named("scara"), perturbations=[entry])
