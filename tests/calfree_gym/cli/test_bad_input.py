"""What cannot be is refused with 2, and a reason, before anything moves."""

import importlib.util
import socket

import numpy as np
import pytest

from calfree_gym.cli import main
from calfree_gym.lerobot import LeRobotReachEnv
from tests.calfree_gym.cli.bench import calfree
from tests.calfree_gym.lerobot.fake_so101 import FakeSO101

ROBOT = ["--robot.type=so101_follower", "--robot.port=/dev/ttyACM0", "--robot.id=arm"]


class NoRobot:
    """One that must not be asked for anything."""

    is_connected = False


def code(command, robot=None):
    try:
        return calfree(command.split(), robot or NoRobot())
    except SystemExit as error:
        return error.code


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("", "required: command"),
        ("reech", "invalid choice: 'reech'"),
        ("reach --robot.port=/dev/ttyACM0 --reach=3", "reach does not take --reach=3"),
        ("marks --robot.port=/dev/ttyACM0", "marks does not take --robot.port"),
        ("marks --paper=A3", "invalid choice: 'A3'"),
        ("marks --out=none/tags.pdf", "none/tags.pdf"),
        ("watch --display_data=maybe", "'maybe' is neither true nor false"),
        ("check --marks=none.yaml", "none.yaml"),
        ("reach --agent=memorie", "agent is 'memorie' (did you mean memory?)"),
        ("reach --reaches=0", "reaches is 0"),
        ("reach --speed=fast", "invalid float value: 'fast'"),
        ("reach --load=none.zip", "--load none.zip: there is no such file"),
        ("reach --save=none/arm.zip", "--save none/arm.zip: there is no such folder"),
    ],
)
def test_what_no_robot_is_needed_for(command, said, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert code(command) == 2
    assert said in capsys.readouterr().err


class Saved:
    """An agent that no other one can load."""

    def save(self, path):
        path.write(b"another agent's")


class Absent(FakeSO101):
    def connect(self, calibrate=True):
        raise RuntimeError("FeetechMotorsBus motor check failed on port '/dev/ttyACM0': Missing motor IDs: 3")


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("check --cameras=left,rigth", "no camera 'rigth' (did you mean right?)"),
        ("check --cameras=left", "it must be the names of two of left, right"),
        ("check --motors=elbow", "no motor 'elbow' (did you mean elbow_flex?)"),
        ("check --unit=0", "unit is 0.0; it must be a number above 0"),
        ("watch --cameras=front,right", "no camera 'front'"),
        ("watch --port=70000", "choose another one with --port"),
        ("reach --cameras=left,rigth", "no camera 'rigth' (did you mean right?)"),
        ("reach --unit=170", "smaller unit"),
        ("reach --tolerance-px=-1", "tolerance_px is -1"),
        ("reach --max-motions=0", "max_motions is 0"),
    ],
)
def test_what_the_robot_does_not_allow(command, said, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    robot = FakeSO101()
    stood = robot.plant.targets.copy()
    assert code(command, robot) == 2
    assert said in capsys.readouterr().err
    np.testing.assert_array_equal(robot.plant.targets, stood)


def test_knowledge_of_another_agent_is_refused_before_anything_moves(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    LeRobotReachEnv(FakeSO101(), ("left", "right")).save(Saved(), "arm.calfree")
    robot = FakeSO101()
    stood = robot.plant.targets.copy()
    assert code("reach --agent=unified_servo --load=arm.calfree", robot) == 2
    assert "--load arm.calfree: " in capsys.readouterr().err
    np.testing.assert_array_equal(robot.plant.targets, stood)


@pytest.mark.parametrize("command", ["check", "watch", "reach"])
def test_a_robot_that_does_not_answer_is_told_in_its_own_words(command, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert code(command, Absent()) == 2
    assert "the robot cannot be connected: FeetechMotorsBus motor check failed" in capsys.readouterr().err


def test_a_port_that_is_taken_is_told(capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert code(f"watch --port={port}", FakeSO101()) == 2
    assert f"port {port}: " in capsys.readouterr().err


@pytest.mark.skipif(importlib.util.find_spec("lerobot") is not None, reason="LeRobot is installed")
@pytest.mark.parametrize("command", ["check", "watch", "reach --agent=unified_servo"])
def test_without_lerobot_it_is_said_how_to_install_it(command, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main([*command.split(), *ROBOT]) == 2
    assert "pip install 'lerobot[feetech]>=0.6,<0.7', with Python 3.12" in capsys.readouterr().err


@pytest.mark.skipif(importlib.util.find_spec("lerobot") is not None, reason="LeRobot is installed")
def test_lerobots_viewer_needs_lerobot(capsys):
    assert code("watch --display_data=true", FakeSO101()) == 2
    assert "--display_data needs LeRobot" in capsys.readouterr().err
