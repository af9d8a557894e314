"""The same on LeRobot's own classes, and demonstrations, where LeRobot is installed (Python 3.12 on)."""

import gc
import re
import sys
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

import agents
from calfree_gym.lerobot import ArmError, LeRobotReachEnv
from tests.calfree_gym.environments import example
from tests.calfree_gym.lerobot.fake_so101 import NO_PACKET, FakeSO101
from tests.calfree_gym.lerobot.so101 import MOTORS

pytest.importorskip("lerobot", reason="LeRobot is not installed")
pytestmark = pytest.mark.usefixtures("opengl")


@pytest.fixture
def bench(tmp_path):
    return FakeSO101(power=tmp_path / "power")


@pytest.fixture
def made(bench, monkeypatch):
    from tests.calfree_gym.lerobot.follower import follower

    def made(port="/dev/ttyACM0", config=None, **arguments):
        robot = follower(bench, monkeypatch, port, **(config or {}))
        settings = {"place_object": bench.place_object} | arguments
        return robot, LeRobotReachEnv(robot, ("left", "right"), **settings)

    return made


def test_a_servo_reaches_and_nothing_is_kept_but_what_lerobot_keeps(made, bench):
    robot, env = made()
    kept = list(robot.bus.kept)
    servo = agents.make("unified_servo", env)
    for reach in env.reaches(servo, 2):
        assert reach.reached
        assert bench.distance_mm() < 8
    assert robot.bus.kept == kept, "all is from LeRobot's own connect"


def test_wrong_arguments_are_told(made):
    with pytest.raises(ConnectionError, match="lerobot-find-port"):
        made(port="/dev/ttyUSB7")
    with pytest.raises(ValueError, match="max_relative_target=10; it must be"):
        made(config={"max_relative_target": 10})
    with pytest.raises(ValueError, match="use_degrees=False"):
        made(config={"use_degrees": False})


def test_a_motor_that_wraps_is_named_and_the_remedy_helps(made, bench):
    bench.world.zeros[2] += 100 - bench.bus.ticks()[2]
    with pytest.raises(ValueError, match=r"motor elbow_flex is at 10\d ticks") as raised:
        made()
    robot, _ = made(unit=5)
    eval(re.search(r"robot\.bus\.set_half_turn_homings\(\[.*?\]\)", str(raised.value))[0], {"robot": robot})
    LeRobotReachEnv(robot, ("left", "right"))


@pytest.mark.parametrize("fault", ["bus", "camera", "frozen"])
def test_the_arm_holds(made, bench, fault):
    _, env = made()
    env.reset()
    if fault == "bus":
        bench.bus.error = NO_PACKET
    elif fault == "camera":
        bench.cameras["left"].unplugged = True
    else:
        bench.cameras["left"].frozen = True
    with pytest.raises(ArmError):
        env.step(np.full(5, 0.2, np.float32))
    bench.bus.error = None
    assert bench.plant.powered
    assert np.abs(bench.goals_ahead()[:5]).max() < 8


def test_lerobot_forgets_a_robot_and_the_arm_still_holds(made, bench, tmp_path):
    robot, env = made()
    assert (tmp_path / "power").read_text() == "on"
    del robot, env
    gc.collect()
    assert (tmp_path / "power").read_text() == "on"


def test_torque_goes_once_the_arm_is_supported(made, tmp_path):
    _, env = made()
    env.release(lambda question: None)
    assert (tmp_path / "power").read_text() == "off"


class Dataset:
    def __init__(self, **settings):
        self.settings, self.frames, self.episodes = settings, [], []
        self.add_frame = self.frames.append

    @property
    def num_episodes(self):
        return len(self.episodes)

    def save_episode(self, parallel_encoding):
        self.episodes.append(self.frames.copy())
        self.clear_episode_buffer()

    def clear_episode_buffer(self):
        self.frames.clear()


def test_each_reach_but_the_first_is_an_episode_from_home_to_the_object(monkeypatch, opengl, tmp_path):
    made = []
    create = SimpleNamespace(create=lambda **settings: made.append(Dataset(**settings)) or made[0])
    datasets = SimpleNamespace(LeRobotDataset=create, VideoEncodingManager=MagicMock())
    types = SimpleNamespace(FeatureType=None, PolicyFeature=type("PolicyFeature", (), {}))
    for name, module in (("datasets", datasets), ("configs", types)):  # both load torch
        monkeypatch.setitem(sys.modules, f"lerobot.{name}", module)
    recording = example("record_lerobot")
    robot = FakeSO101()
    placed = []

    def place():
        robot.place_object()
        placed.append((robot.clock(), robot.get_observation()))

    recording.record(robot, place, tmp_path / "reaches", episodes=2, agent="unified_servo")
    (dataset,) = made
    assert dataset.settings["fps"] == 20
    names = [f"{name}.pos" for name in MOTORS]
    for key in ("observation.state", "action"):
        assert dataset.settings["features"][key]["names"] == names
    assert dataset.num_episodes == 2
    for (_, home), frames in zip(placed[1:], dataset.episodes, strict=True):
        first, last = frames[0], frames[-1]
        np.testing.assert_allclose(first["observation.state"], [home[name] for name in names], atol=0.3)
        assert np.abs(last["observation.state"] - first["observation.state"]).max() > 3
        assert np.abs(last["action"] - last["observation.state"]).max() < 8
        assert last["observation.images.left"].shape == (480, 640, 3)
        assert last["task"] == recording.TASK
    lasted = np.diff([*(at for at, _ in placed[1:]), robot.clock()])
    recorded = [len(frames) / 20 for frames in dataset.episodes]
    assert recorded[1] == pytest.approx(lasted[1], abs=0.2)
    assert recorded[0] < lasted[0] - 0.2, "the way home is none of it"
