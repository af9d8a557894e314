"""LeRobot's own flags, where LeRobot is installed (Python 3.12 on)."""

import pytest

from calfree_gym.cli.robots import lerobot_robot
from tests.calfree_gym.cli.bench import calfree
from tests.calfree_gym.lerobot.fake_so101 import FakeSO101

pytest.importorskip("lerobot", reason="LeRobot is not installed")

TYPE = "--robot.type=so101_follower"
CAMERAS = (
    "--robot.cameras={left: {type: opencv, index_or_path: 0, width: 640, height: 480, fps: 30},"
    " right: {type: opencv, index_or_path: 2, width: 640, height: 480, fps: 30}}"
)


def test_they_describe_lerobots_follower_with_two_cameras():
    robot = lerobot_robot([TYPE, "--robot.port", "/dev/ttyACM0", "--robot.id=arm", CAMERAS])
    assert type(robot).__name__ in ("SO101Follower", "SOFollower")
    assert robot.config.port == "/dev/ttyACM0"
    assert robot.observation_features["left"] == robot.observation_features["right"] == (480, 640, 3)
    assert not robot.is_connected


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        ([], "robot"),
        ([TYPE, "--robot.port=p", "--robot.cameras={left: {type: opencv, index_or_path: 0}}"], "'width'"),
        (["--robot.type=so102_follower"], "so102_follower"),
        ([TYPE], "port"),
        ([TYPE, "--robot.port=p", "--robot.prot=3"], "prot"),
        ([TYPE, "--robot.port=p", "--robot.cameras={left: {type: opencw}}"], "opencw"),
    ],
)
def test_flags_that_lerobot_does_not_take_are_refused(flags, said):
    with pytest.raises(ValueError, match=said):
        lerobot_robot(flags)


def test_check_keeps_nothing_in_lerobots_own_follower_but_what_lerobot_keeps(
    opengl, monkeypatch, tmp_path, capsys
):
    from tests.calfree_gym.lerobot.follower import follower

    bench = FakeSO101(power=tmp_path / "power")
    robot = follower(bench, monkeypatch)
    robot.place_object = bench.place_object
    robot.connect(calibrate=False)
    kept, stood = list(robot.bus.kept), bench.plant.targets.copy()
    assert calfree(["check", f"--out={tmp_path}"], robot, supports=False) == 0, capsys.readouterr().out
    assert robot.bus.kept == kept
    assert (bench.plant.targets == stood).all()
    assert (tmp_path / "power").read_text() == "on"
