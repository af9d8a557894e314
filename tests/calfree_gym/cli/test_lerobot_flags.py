"""LeRobot's own flags, where LeRobot is installed (Python 3.12 on)."""

import pytest

from calfree_gym.cli.robots import lerobot_robot

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
        (["--robot.type=so102_follower"], "so102_follower"),
        ([TYPE], "port"),
        ([TYPE, "--robot.port=p", "--robot.prot=3"], "prot"),
        (
            [TYPE, "--robot.port=p", "--robot.cameras={left: {type: opencw}}"],
            "opencw",
        ),
    ],
)
def test_flags_that_lerobot_does_not_take_are_refused(flags, said):
    with pytest.raises(ValueError, match=said):
        lerobot_robot(flags)
