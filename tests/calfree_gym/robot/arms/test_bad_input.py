"""What cannot be an arm is refused before any simulation: what was found, where, and what is allowed."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from calfree_gym import Arm, nominal
from calfree_gym.geometry import looking_at
from calfree_gym.robot import simulation
from tests.arms.every import arm_named
from tests.arms.own import ARMS, MODELS
from tests.calfree_gym.environments import make
from tests.calfree_gym.robot.arms.test_chain import ALL_KINDS


@pytest.fixture(autouse=True)
def no_simulation(monkeypatch):
    """Nothing is stepped or placed."""
    for name in ("place", "move", "refresh"):
        monkeypatch.setattr(simulation.ReachSimulation, name, None)


def refused(message, **arguments):
    with pytest.raises(ValueError, match=message) as caught:
        Arm(**arguments)
    with pytest.raises(ValueError, match=message):
        make(arm=arguments)
    return str(caught.value)


def changed(name, *change):
    """The text of an arm's file with something in place of something else."""
    text = ARMS[name]["model"].read_text().replace(*change)
    assert change[1] in text
    return text


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


def in_memory():
    spec = mujoco.MjSpec.from_string("<mujoco/>")
    spec.assets = {"a.stl": b"x"}
    return spec


WALL = changed("scara", "<worldbody>", '<worldbody><site name="wall"/>')
OUT = changed("gripper", "0 -0.4 0.9 0.6", "0 -0.4 1.9 0.6")
RANGE = 'axis="1 0 0" range="-0.6 0.6"'
ENDLESS = changed("gantry", RANGE, 'axis="1 0 0"')
STILL = changed("gantry", RANGE, 'axis="1 0 0" range="0.6 0.6" limited="true"')
AXES = {"a": "0 0 1", "b": "0 1 0", "c": "1 0 0"}
TURNS = "".join(f'<joint name="{name}" axis="{axis}"/>' for name, axis in AXES.items())
ONLY_TURNED = (
    f'<mujoco><worldbody><body>{TURNS}<geom size="0.03"/><site name="tip"/></body></worldbody></mujoco>'
)


@pytest.mark.parametrize(
    ("model", "message"),
    [
        ("no/such/arm.xml", r"no/such/arm.xml: there is no such MJCF file"),
        ("<robot name='urdf?'><link/></robot>", "the MJCF text (is no MJCF that MuJoCo|cannot be compiled)"),
        ("<mujoco><worldbody><body></mujoco>", "the MJCF text is no MJCF that MuJoCo can read"),
        ("<mujoco><worldbody><bodi/></worldbody></mujoco>", "is no MJCF that MuJoCo can read[^']*'bodi'"),
        (MODELS, "there is no such MJCF file"),
        (3, "model is 3; it must be a path, MJCF text, or an mujoco.MjSpec"),
        (in_memory(), "the MjSpec holds assets in memory"),
        (ONLY_TURNED, "the motors a, b, c turn the site 'tip' and do not move it; gripper= names"),
        (chain("abcdefgh"), "has 8 motors, a, b, c, d, e, f, g, h; it must have 3 to 7. motors= chooses"),
    ],
)
def test_models(model, message):
    refused(message, model=model, gripper="tip")


def test_files(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_bytes(b"\x00\x01 not an arm")
    refused(r"arm.xml is no MJCF that MuJoCo can read", model=path, gripper="tip")
    path.write_text(ARMS["names"]["model"].read_text())
    message = refused(r"names wedge.stl, which cannot be read at", model=path, gripper="left.arm/tip")
    assert str(tmp_path / "meshes" / "wedge.stl") in message


@pytest.mark.parametrize("gripper", ["tipp", "", "world", "shoulder"])
def test_no_such_gripper(gripper):
    message = refused("the arm has no site or body", **ARMS["scara"] | {"gripper": gripper})
    assert "its sites: tip;" in message
    assert "inner arm, outer arm, quill, flange" in message
    assert ("did you mean tip" in message) == (gripper == "tipp")


@pytest.mark.parametrize(
    ("name", "arguments", "message"),
    [
        ("scara", {"assets": ["a.stl"]}, r"assets is \['a.stl'\]; it must be digests by file"),
        ("gripper", {"gripper": "base"}, "it must have 3 to 7"),
        ("scara", {"model": WALL, "gripper": "wall"}, "the gripper 'wall' is fixed in the room"),
        ("scara", {"gripper": None}, "gripper is None; it must be the name of a site or body"),
        ("hobby", {"home": {"elbow": 3}}, "home has 'elbow' at 3; its range is"),
        ("scara", {"home": {"lift": -0.1}}, r"home has 'lift' at -0.1; its range is 0 to 0.2"),
        ("gripper", {"home": {"left_finger": 0.5}}, "'left_finger' at 0.5; its range is 0.005 to 0.04"),
        ("gripper", {"model": OUT}, "home has 'elbow_flex' at 1.9; its range is -1.69 to 1.69"),
        ("scara", {"home": {"lft": 0.1}}, "home names 'lft' .did you mean lift"),
        ("scara", {"home": {"lift": "up"}}, "home has 'lift' at 'up'; it must be a number"),
        ("scara", {"home": {"lift": float("nan")}}, "home has 'lift' at nan; it must be a number"),
        ("gripper", {"home": "redy"}, "no keyframe 'redy' .did you mean ready.*; it has ready"),
        ("scara", {"home": "home"}, "no keyframe 'home'; it has none"),
        ("scara", {"home": 3}, "home is 3; it must be a keyframe's name, or positions by joint name"),
        ("scara", {"home": {3: 1}}, "home names 3; the arm's hinges and slides are shoulder"),
        ("mobile", {"base": "mont"}, "base is 'mont' .did you mean mount"),
        ("mobile", {"base": "world"}, "base is 'world'"),
        ("mobile", {"base": "wrist"}, r"has 2 motors.*the chain starts at base='wrist'"),
        ("scara", {"base": 3}, "base is 3; it must be the name of a body"),
        ("gantry", {"model": ENDLESS}, "the motor 'x' slides without limits; give its joint a range"),
        (
            "gantry",
            {"model": STILL},
            "the motor 'x' ranges from 0.6 to 0.6; it cannot move|cannot be compiled",
        ),
    ],
)
def test_grippers_homes_bases_and_ranges(name, arguments, message):
    refused(message, **ARMS[name] | arguments)


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
        ("scara", 3, "motors is 3; it must be a list of different joints' names"),
        ("scara", [["shoulder"], "elbow"], "motors is .*; it must be a list of different joints' names"),
    ],
)
def test_motors(name, motors, message):
    refused(message, **ARMS[name] | {"motors": motors})


@pytest.mark.parametrize(("motor", "kind"), [("neck", "ball"), ("cart", "free")])
def test_balls_and_free_joints_are_no_motors(motor, kind):
    message = (
        f"the motor '{motor}' is a {kind} joint; a motor is a hinge or a slide; allowed: lift, tilt, stuck"
    )
    refused(message, model=ALL_KINDS, gripper="tip", motors=[motor, "lift", "tilt", "turn"])


def test_too_few_motors_say_where_the_chain_was_taken_to_begin_and_to_end():
    message = (
        "has 2 motors, a, b; .* starts at base='link 0' and ends where gripper='link 1' is, at .* 'link 1'"
    )
    refused(message, model=chain("abcd"), gripper="link 1")


TENDON = "<tendon><fixed name='both'><joint joint='a' coef='1'/><joint joint='d' coef='-1'/></fixed></tendon>"
LOOP = '<connect name="rod" body1="link 0" body2="link 3" anchor="0 0 0"/>'


@pytest.mark.parametrize(
    ("equality", "message"),
    [
        ('<joint name="tie" joint1="b" joint2="c"/>', "'tie' ties the motors b, c"),
        ('<joint joint1="c"/>', "equality 0 ties the motors c"),
        (LOOP, "'rod' ties the motors b, c, d"),
        ('<weld body1="link 3"/>', "ties the motors a, b, c, d"),
        ('<tendon name="belt" tendon1="both"/>', "'belt' ties the motors a, d"),
    ],
    ids=["a mimic joint", "a locked joint", "a closed loop", "a fixed end", "a tendon"],
)
def test_motors_that_are_tied_to_other_parts(equality, message):
    model = chain("abcd", f"{TENDON}<equality>{equality}</equality>")
    refused(message + ".*only open chains of motors can be simulated", model=model, gripper="tip")


def test_of_many_motors_some_are_chosen_and_equalities_that_hold_none_are_no_hindrance():
    model = chain("abcdefgh")
    assert Arm(model=model, gripper="tip", motors=list("acdfgh")).motors == tuple("acdfgh")
    assert Arm(model=model, gripper="tip", base="link 5").motors == tuple("fgh")
    loose = '<weld body1="hand" body2="link 3"/>'
    hand = '<body name="hand" mocap="true" pos="0.4 0 0.05"/>'
    off = '<joint joint1="b" joint2="c" active="false"/>'
    arm = Arm(model=chain("abcd", f"<equality>{loose}{off}</equality>", hand), gripper="tip")
    assert arm.motors == tuple("abcd")


@pytest.mark.parametrize("arm", ["movmaster", 7, None, MODELS, ["movemaster"]])
def test_an_arm_of_a_wrong_type(arm):
    message = r"arm is .* it must be 'movemaster', a calfree_gym.Arm, or a mapping"
    with pytest.raises(ValueError, match=message):
        make(arm=arm)


@pytest.mark.parametrize(
    "mount", ["wrist", ("stand",), ("stand", "wrist"), ("waist", "stand", "waist"), 3, None]
)
def test_cameras_on_what_is_no_body(mount):
    allowed = "allowed: waist, stand, inner arm, column, outer arm, quill, flange, or a pair of these"
    with pytest.raises(ValueError, match=f"camera_mount is .*{allowed}"):
        make(arm=arm_named("scara"), camera_mount=mount)


@pytest.mark.parametrize("name", ["scara", "mobile", "redundant"])
def test_cameras_that_never_see_the_gripper(name):
    arm = arm_named(name)
    world = nominal(arm.robot)
    away = [looking_at(p, 2 * p - arm.robot.rig.target) for p in world.camera_position]
    for mount in ("waist", "stand"):
        with pytest.raises(ValueError, match=f"the given world is not in view on the '{mount}' mount"):
            make(arm=arm, camera_mount=mount, world=replace(world, camera_orientation=np.stack(away)))


@pytest.mark.parametrize("type_", ["motor_gain", "motor_sign", "backlash", "repeatability"])
def test_perturbations_of_motors_that_the_arm_has_not(type_):
    entry = {"at": {"motion": 1}, "do": {"type": type_, "motor": "waist"}}
    with pytest.raises(ValueError, match=f"{type_}.motor is 'waist'; allowed: shoulder, elbow, lift, roll"):
        make(arm=arm_named("scara"), perturbations=[entry])
