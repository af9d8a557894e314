"""A hold outlasts the process: motors keep their torque until somebody says that she supports the arm."""

import gc
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from calfree_gym.lerobot import LeRobotReachEnv
from tests.calfree_gym.lerobot.fake_so101 import FakeSO101

ROOT = Path(__file__).parents[3]


def over(power):
    """A robot whose torque is noted in a file, and its environment."""
    robot = FakeSO101(power=power)
    return robot, LeRobotReachEnv(robot, ("left", "right"))


@pytest.mark.parametrize("ending", ["SIGINT", "SIGKILL", "exit"])
def test_torque_stays_on_however_the_process_ends(ending, tmp_path):
    power = tmp_path / "power"
    command = [sys.executable, "-m", "tests.calfree_gym.lerobot.moving", str(power), ending]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == {"SIGINT": -2, "SIGKILL": -9, "exit": 3}[ending], done.stderr
    assert float((tmp_path / "power.moving").read_text()) > 0.005, "it was on its way"
    assert power.read_text() == "on"


def test_lerobot_would_have_switched_it_off(tmp_path):
    power = tmp_path / "power"
    robot = FakeSO101(power=power)
    robot.connect(calibrate=False)
    assert power.read_text() == "on"
    del robot
    gc.collect()
    assert power.read_text() == "off"


def test_torque_stays_on_where_an_environment_is_closed_or_forgotten(tmp_path):
    power = tmp_path / "power"
    robot, env = over(power)
    with env:
        pass
    assert not robot.is_connected, "it has connected the robot"
    del env, robot
    gc.collect()
    assert power.read_text() == "on"


def test_a_robot_that_was_connected_stays_so():
    robot = FakeSO101()
    robot.connect(calibrate=False)
    LeRobotReachEnv(robot, ("left", "right")).close()
    assert robot.is_connected


def test_torque_goes_once_it_is_confirmed_that_the_arm_is_supported(tmp_path):
    power = tmp_path / "power"
    robot, env = over(power)

    def nobody(question):
        raise EOFError

    with pytest.raises(EOFError):
        env.release(nobody)
    assert robot.is_connected
    assert power.read_text() == "on"
    asked = []
    env.release(asked.append)
    assert "Support the arm" in asked[0]
    assert not robot.is_connected
    assert power.read_text() == "off"


def test_a_robot_whose_torque_nobody_can_keep_is_told():
    robot = FakeSO101()
    robot.config = SimpleNamespace(id="other")
    with pytest.warns(UserWarning, match="its motors may lose their torque"):
        LeRobotReachEnv(robot, ("left", "right"))


def test_a_hold_needs_no_reading_and_pulls_no_sagging_motor_up(bench):
    bench = bench()
    bench.env.reset()
    robot, motors = bench.robot, bench.env._motors
    before, motors.here = motors.goal.copy(), motors.here + np.array([0, 0, 5.0, 0, 0])
    robot.get_observation = None
    motors.hold()
    expected = before.copy()
    expected[2] = motors.here[2]
    np.testing.assert_allclose(motors.goal, expected)
