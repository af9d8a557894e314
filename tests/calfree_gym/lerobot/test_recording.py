"""The example of demonstrations, by LeRobot's own functions where it is installed; the dataset is a list."""

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

from tests.calfree_gym.lerobot.fake_so101 import FakeSO101
from tests.calfree_gym.lerobot.so101 import MOTORS

pytest.importorskip("lerobot", reason="LeRobot is not installed")
EXAMPLE = Path(__file__).parents[3] / "examples" / "record_lerobot.py"


class Dataset:
    """What is used of a `LeRobotDataset`."""

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
    spec = spec_from_file_location("record_lerobot", EXAMPLE)
    example = module_from_spec(spec)
    spec.loader.exec_module(example)
    robot = FakeSO101()
    placed = []

    def place():
        robot.place_object()
        placed.append((robot.clock(), robot.get_observation()))

    example.record(robot, place, tmp_path / "reaches", episodes=2, agent="unified_servo")
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
        assert last["task"] == example.TASK
    lasted = np.diff([*(at for at, _ in placed[1:]), robot.clock()])
    recorded = [len(frames) / 20 for frames in dataset.episodes]
    assert recorded[1] == pytest.approx(lasted[1], abs=0.2)
    assert recorded[0] < lasted[0] - 0.2, "the way home is none of it"
