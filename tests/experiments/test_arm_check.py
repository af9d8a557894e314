"""check-arm says what an arm's file comes to, and in one line why it cannot be used."""

import cv2
import gymnasium as gym
import mujoco
import numpy as np
import pytest

from calfree_gym import Arm
from experiments.__main__ import main
from experiments.arm_check import ArmCheck
from tests.arms.own import ARMS, MOTORS, three_hinges

HOBBY = str(ARMS["hobby"]["model"])
TIP = [HOBBY, "--gripper", "tip"]


def tables_of(name, mount="waist"):
    check = ArmCheck(Arm(**ARMS[name]), mount)
    return check, {table.name: table.frame for table in check.tables()}


def test_a_home_is_of_slides_in_metres_and_of_hinges_in_degrees(capsys):
    model = str(ARMS["scara"]["model"])
    homes = ["--home", "lift=0.1", "--home-degrees", "elbow=30"]
    assert main(["check-arm", model, "--gripper", ARMS["scara"]["gripper"], *homes]) == 0
    shown = capsys.readouterr().out
    assert "| lift | slide | mm | 0.0 | 200.0 | 100.0 |" in shown
    assert "| elbow | hinge | degrees | -150.0 | 150.0 | 30.0 |" in shown


def test_the_table_of_motors_is_the_models_own():
    _, tables = tables_of("scara")
    model = mujoco.MjModel.from_xml_path(str(ARMS["scara"]["model"]))
    motors = tables["motors"].set_index("motor")
    assert tuple(motors.index) == MOTORS["scara"]
    assert motors.loc["lift", ["kind", "unit"]].tolist() == ["slide", "mm"]
    assert motors.loc["elbow", ["kind", "unit"]].tolist() == ["hinge", "degrees"]
    for name, unit in (("lift", 1000), ("elbow", 180 / np.pi)):
        found = motors.loc[name, ["lowest", "highest"]].to_numpy(float)
        np.testing.assert_allclose(found, unit * model.joint(name).range, rtol=1e-5)  # MJCF has six digits
        home, span = motors.loc[name, ["home", "span"]]
        assert span == pytest.approx(max(found[1] - home, home - found[0]))


def test_the_work_space_lies_where_mujoco_puts_the_gripper():
    """A gantry's gripper can be anywhere in the box that its slides make, and no motor but they."""
    check, tables = tables_of("gantry")
    places = tables["work space"].set_index("")
    model = mujoco.MjModel.from_xml_path(str(ARMS["gantry"]["model"]))
    data = mujoco.MjData(model)
    for joint, at in zip(("x", "y", "z"), check._robot.home, strict=True):
        data.joint(joint).qpos[0] = at
    mujoco.mj_kinematics(model, data)
    found = places.loc["gripper at home"].to_numpy(float)
    np.testing.assert_allclose(found, 1000 * data.body("hook").xpos, atol=1e-6)
    assert (places.loc["its lowest 5 %"] < places.loc["its highest 5 %"]).all()
    assert not check.problems


@pytest.mark.parametrize(("before_the_last_link", "found"), [(0.0, "hidden"), (0.05, "seen")])
def test_an_object_that_the_last_link_hides_is_told(before_the_last_link, found):
    check = ArmCheck(Arm(three_hinges(120, 0.15 + before_the_last_link), "tip"), "waist")
    cameras = check._views().frame.set_index("both cameras")
    assert cameras.loc["nominal: object where the gripper is", "found"] == found


def test_what_both_cameras_see_is_what_the_environment_shows():
    """A world in view has the gripper at home in view."""
    check, tables = tables_of("hobby", ("hand", "stand"))
    found = tables["cameras"].set_index("both cameras")["found"]
    env = check._env(dynamics="kinematic")
    observation, _ = env.reset(seed=0)
    assert found["nominal: gripper at home"] == "seen"
    assert observation["observation"][:2].tolist() == [1, 1]
    names = dict(arm=check._arm, camera_mount=("hand", "stand"), world="wild", keep_in_view=False)
    wild = gym.make("CalFree/Reach-v0", **names)
    with_gripper = [wild.reset(seed=seed)[0]["observation"][:2].all() for seed in range(100)]
    drawn = int(found["wild: draws in view, of 100"])
    assert 0 < drawn <= sum(with_gripper)


def test_too_little_in_view_is_a_problem_and_ends_with_1(capsys, monkeypatch):
    monkeypatch.setattr("experiments.arm_check.least_in_view", lambda robot, mounts: 1.01)
    assert main(["check-arm", *TIP]) == 1
    captured = capsys.readouterr()
    assert "problem: the nominal robot's cameras do not see enough on the 'waist' mount" in captured.err


def test_a_picture_shows_the_arm_with_both_images(tmp_path, capsys):
    picture = tmp_path / "pictures" / "hobby.png"
    assert main(["check-arm", *TIP, "--out", str(picture)]) == 0
    image = cv2.imread(str(picture))
    assert image.shape == (720, 1080, 3)
    assert f"picture: {picture}" in capsys.readouterr().out
    gripper = (np.abs(image.astype(int) - (140, 13, 242)) < 30).all(-1)
    assert gripper[:360, 720:].any(), "its ring in the left image"
    assert gripper[360:, 720:].any(), "its ring in the right image"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere.xml", "--gripper", "tip"], "nowhere.xml: there is no such MJCF file"),
        ([*TIP, "--out", "arm.xyz"], "arm.xyz: no image is written as '.xyz'; allowed: such"),
        ([*TIP, "--out", "arm"], "arm: no image is written as ''; allowed: such as arm.png"),
        ([HOBBY, "--gripper", "tipp"], "did you mean tip?"),
        ([*TIP, "--motors", "turn"], "it must have 3 to 7"),
        ([*TIP, "--base", "stant"], "did you mean stand?"),
        ([*TIP, "--home", "up"], "no keyframe 'up'"),
        ([*TIP, "--home", "up", "elbow=1"], "found 'up'; allowed: such as elbow=-30"),
        ([*TIP, "--home", "up", "--home-degrees", "elbow=1"], "the keyframe 'up', and home_degrees"),
        ([*TIP, "--home-degrees", "elbow=200"], "its range is 0 to 2.4 rad (0 to 137.51 degrees)"),
        ([*TIP, "--camera-mount", "nose"], "camera_mount is 'nose'"),
        ([*TIP, "--camera-mount", "hand", "nose"], "allowed: waist, stand, turret"),
    ],
)
def test_bad_input_is_one_line_and_ends_with_2(arguments, said, capsys):
    assert main(["check-arm", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    (line,) = captured.err.splitlines()
    assert line.startswith("error: ")
    assert said in line


@pytest.mark.parametrize("written", ["elbow", "elbow=wide", "=5"])
def test_degrees_that_are_none_are_a_usage_error(written, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["check-arm", *TIP, "--home-degrees", written])
    assert f"found {written!r}" in capsys.readouterr().err
