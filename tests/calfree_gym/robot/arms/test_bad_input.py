"""What cannot be an arm is refused before any simulation: what was found, where, and what is allowed."""

import mujoco
import pytest

from calfree_gym import Arm
from calfree_gym.robot import simulation
from tests.arms.every import arm_named
from tests.arms.own import ARMS, MODELS
from tests.calfree_gym.environments import make
from tests.calfree_gym.robot.arms.test_chain import ALL_KINDS


@pytest.fixture(autouse=True)
def no_simulation(monkeypatch):
    for name in ("place", "move", "refresh"):
        monkeypatch.setattr(simulation.ReachSimulation, name, None)


def refused(message, **arguments):
    with pytest.raises(ValueError, match=message) as caught:
        Arm(**arguments)
    with pytest.raises(ValueError, match=message):
        make(arm=arguments)
    return str(caught.value)


def changed(name, *change):
    text = ARMS[name]["model"].read_text().replace(*change)
    assert change[1] in text
    return text


def chain(joints, equality="", mocap=""):
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


SCARA, GANTRY, GRIPPER, HOBBY, MOBILE = (
    ARMS[name] for name in ("scara", "gantry", "gripper", "hobby", "mobile")
)
TENDON = "<tendon><fixed name='both'><joint joint='a' coef='1'/><joint joint='d' coef='-1'/></fixed></tendon>"
LOOP = '<connect name="rod" body1="link 0" body2="link 3" anchor="0 0 0"/>'
NO_LIST = "it must be a list of different joints' names"
TURNED = "the motors a, b, c turn the site 'tip' and do not move it; gripper= names"
TOO_MANY = "has 8 motors, a, b, c, d, e, f, g, h; it must have 3 to 7. motors= chooses"
NO_JOINT = "no joint 'lft' .did you mean lift.*shoulder, elbow, lift, roll"
TOO_FEW = "has 2 motors, a, b; .* starts at base='link 0' and ends where gripper='link 1' is, at .* 'link 1'"
KIND = "the motor '{}' is a {} joint; a motor is a hinge or a slide; allowed: lift, tilt, stuck"
OF_ALL_KINDS = {"model": ALL_KINDS, "gripper": "tip"}


def at_tip(model):
    return {"model": model, "gripper": "tip"}


def tied(equality):
    return at_tip(chain("abcd", f"{TENDON}<equality>{equality}</equality>"))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (at_tip("no/such/arm.xml"), r"no/such/arm.xml: there is no such MJCF file"),
        (at_tip("<robot name='urdf?'><link/></robot>"), "the MJCF text (is no MJCF|cannot be compiled)"),
        (at_tip("<mujoco><worldbody><body></mujoco>"), "the MJCF text is no MJCF that MuJoCo can read"),
        (at_tip("<mujoco><worldbody><bodi/></worldbody></mujoco>"), "MJCF that MuJoCo can read[^']*'bodi'"),
        (at_tip(MODELS), "there is no such MJCF file"),
        (at_tip(3), "model is 3; it must be a path, MJCF text, or an mujoco.MjSpec"),
        (at_tip(in_memory()), "the MjSpec holds assets in memory"),
        (at_tip(ONLY_TURNED), TURNED),
        (at_tip(chain("abcdefgh")), TOO_MANY),
        (SCARA | {"assets": ["a.stl"]}, r"assets is \['a.stl'\]; it must be digests by file"),
        (GRIPPER | {"gripper": "base"}, "it must have 3 to 7"),
        (SCARA | {"model": WALL, "gripper": "wall"}, "the gripper 'wall' is fixed in the room"),
        (SCARA | {"gripper": None}, "gripper is None; it must be the name of a site or body"),
        (HOBBY | {"home": {"elbow": 3}}, "home has 'elbow' at 3; its range is"),
        (SCARA | {"home": {"lift": -0.1}}, r"home has 'lift' at -0.1; its range is 0 to 0.2"),
        (GRIPPER | {"home": {"left_finger": 0.5}}, "'left_finger' at 0.5; its range is 0.005 to 0.04"),
        (GRIPPER | {"model": OUT}, "home has 'elbow_flex' at 1.9; its range is -1.69 to 1.69"),
        (SCARA | {"home": {"lft": 0.1}}, "home names 'lft' .did you mean lift"),
        (SCARA | {"home": {"lift": "up"}}, "home has 'lift' at 'up'; it must be a number"),
        (SCARA | {"home": {"lift": float("nan")}}, "home has 'lift' at nan; it must be a number"),
        (GRIPPER | {"home": "redy"}, "no keyframe 'redy' .did you mean ready.*; it has ready"),
        (SCARA | {"home": "home"}, "no keyframe 'home'; it has none"),
        (SCARA | {"home": 3}, "home is 3; it must be a keyframe's name, or positions by joint name"),
        (SCARA | {"home": {3: 1}}, "home names 3; the arm's hinges and slides are shoulder"),
        (MOBILE | {"base": "mont"}, "base is 'mont' .did you mean mount"),
        (MOBILE | {"base": "world"}, "base is 'world'"),
        (MOBILE | {"base": "wrist"}, r"has 2 motors.*the chain starts at base='wrist'"),
        (SCARA | {"base": 3}, "base is 3; it must be the name of a body"),
        (GANTRY | {"model": ENDLESS}, "the motor 'x' slides without limits; give its joint a range"),
        (GANTRY | {"model": STILL}, "'x' ranges from 0.6 to 0.6; it cannot move|cannot be compiled"),
        (
            GRIPPER | {"motors": ["shoulder_pan", "elbow_flex", "left_finger"]},
            "'left_finger' is not between the base",
        ),
        (MOBILE | {"motors": ["drive_x", "pan", "lift"]}, "is not between the base 'mount' and the gripper"),
        (SCARA | {"motors": ["shoulder", "elbow", "lft"]}, NO_JOINT),
        (SCARA | {"motors": ["shoulder", "elbow"]}, "has 2 motors, shoulder, elbow; it must have 3 to 7"),
        (SCARA | {"motors": []}, "has 0 motors, none; it must have 3 to 7"),
        (SCARA | {"motors": ["shoulder", "elbow", "elbow"]}, NO_LIST),
        (SCARA | {"motors": "shoulder"}, NO_LIST),
        (SCARA | {"motors": 3}, f"motors is 3; {NO_LIST}"),
        (SCARA | {"motors": [["shoulder"], "elbow"]}, NO_LIST),
        (OF_ALL_KINDS | {"motors": ["neck", "lift", "tilt", "turn"]}, KIND.format("neck", "ball")),
        (OF_ALL_KINDS | {"motors": ["cart", "lift", "tilt", "turn"]}, KIND.format("cart", "free")),
        (at_tip(chain("abcd")) | {"gripper": "link 1"}, TOO_FEW),
        (tied('<joint name="tie" joint1="b" joint2="c"/>'), "'tie' ties the motors b, c.*only open chains"),
        (tied('<joint joint1="c"/>'), "equality 0 ties the motors c.*only open chains of motors"),
        (tied(LOOP), "'rod' ties the motors b, c, d.*only open chains of motors"),
        (tied('<weld body1="link 3"/>'), "ties the motors a, b, c, d.*only open chains of motors"),
        (tied('<tendon name="belt" tendon1="both"/>'), "'belt' ties the motors a, d.*only open chains"),
    ],
)
def test_arguments(arguments, message):
    refused(message, **arguments)


def test_files(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_bytes(b"\x00\x01 not an arm")
    refused(r"arm.xml is no MJCF that MuJoCo can read", model=path, gripper="tip")
    path.write_bytes(ARMS["scara"]["model"].read_text().replace("column", "säule").encode("latin-1"))
    refused(r"arm.xml, or a file that it includes, is not UTF-8: .* byte 0xe4", model=path, gripper="tip")
    path.write_text(ARMS["names"]["model"].read_text())
    message = refused(r"names wedge.stl, which cannot be read at", model=path, gripper="left.arm/tip")
    assert str(tmp_path / "meshes" / "wedge.stl") in message


@pytest.mark.parametrize("gripper", ["tipp", "", "world", "shoulder"])
def test_no_such_gripper(gripper):
    message = refused("the arm has no site or body", **ARMS["scara"] | {"gripper": gripper})
    assert "its sites: tip;" in message
    assert "inner arm, outer arm, quill, flange" in message
    assert ("did you mean tip" in message) == (gripper == "tipp")


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


def test_where_no_object_is_far_enough_from_the_gripper_it_says_how_far_that_is():
    env = make(world="nominal", dynamics="kinematic", tolerance_px=255)
    with pytest.raises(ValueError, match=r"seen more than 25\d px from the gripper at home"):
        env.reset(seed=0)


@pytest.mark.parametrize(
    "mount", ["wrist", ("stand",), ("stand", "wrist"), ("waist", "stand", "waist"), 3, None]
)
def test_cameras_on_what_is_no_body(mount):
    allowed = "allowed: waist, stand, inner arm, column, outer arm, quill, flange, or a pair of these"
    with pytest.raises(ValueError, match=f"camera_mount is .*{allowed}"):
        make(arm=arm_named("scara"), camera_mount=mount)
