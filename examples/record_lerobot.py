"""Demonstrations for learners, without a leader arm: an agent reaches, and a `LeRobotDataset` has it.

Needs `lerobot[dataset]`. By `make record` the bench of our tests stands in for the arm;
LeRobot's own flags (`--robot.type=so101_follower ...`) name a real one, with cameras left and right.
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from lerobot.datasets import LeRobotDataset, VideoEncodingManager
from lerobot.utils.feature_utils import build_dataset_frame, hw_to_dataset_features

from calfree_gym.cli.loading import agents_package
from calfree_gym.cli.robots import lerobot_robot, supported
from calfree_gym.image import CAMERAS
from calfree_gym.lerobot import LeRobotReachEnv
from calfree_gym.lerobot.motors import RATE

TASK = "Bring the gripper to the ball."


def record(
    robot: Any,
    place_object: Callable[[], Any],
    out: Path,
    episodes: int,
    agent: str = "memory",
    **bounds: float,
) -> None:
    """Records reaches, one an episode: positions and goals in degrees, and pictures, 20 times a second.

    The first reach, in which the agent learns how the arm moves, is none; nor is one that is cut off.

    Args:
        robot: One of LeRobot's, with cameras left and right.
        place_object: Has the next object placed.
        out: Folder of the dataset; must not exist.
        episodes: So many reaches.
        agent: Who reaches.
        **bounds: Of the arm, `unit` and `speed`, as `LeRobotReachEnv` takes them.
    """
    observed = hw_to_dataset_features(robot.observation_features, "observation")
    sent = hw_to_dataset_features(robot.action_features, "action")
    dataset = LeRobotDataset.create(
        repo_id=f"calfree/{out.name}",
        root=out,
        fps=int(RATE),
        features=observed | sent,
        robot_type=robot.name,
        image_writer_threads=8,
    )

    def tick(observation: dict[str, Any], action: dict[str, float]) -> None:
        pictures = {camera: np.asarray(observation[camera]) for camera in CAMERAS}  # the bench draws late
        frame = build_dataset_frame(observed, observation | pictures, "observation")
        dataset.add_frame(frame | build_dataset_frame(sent, action, "action") | {"task": TASK})

    def place() -> None:
        place_object()
        dataset.clear_episode_buffer()  # what was recorded on the way home

    env = LeRobotReachEnv(robot, CAMERAS, place_object=place, on_tick=tick, **bounds)
    reacher = agents_package().make(agent, env)
    with VideoEncodingManager(dataset):
        for number, reach in enumerate(env.reaches(reacher, 1 + episodes)):
            if number and reach.reached:
                dataset.save_episode(parallel_encoding=False)  # what draws is not to be forked
            print(f"{dataset.num_episodes} episodes; motions: {reach.motions}", flush=True)
        dataset.clear_episode_buffer()


def main() -> None:
    """Records, and tells where."""
    parser = argparse.ArgumentParser(description=__doc__)
    now = Path(time.strftime("runs/demonstrations-%Y%m%d-%H%M%S"))
    parser.add_argument("--out", type=Path, default=now, help="folder of the dataset")
    parser.add_argument("--episodes", type=int, default=10)
    parser.add_argument("--unit", type=float, default=45.0, help="so many degrees from home motors go")
    parser.add_argument("--speed", type=float, default=60.0, help="degrees a second, at most")
    given, flags = parser.parse_known_args()
    to, bounds = (given.out, given.episodes), {"unit": given.unit, "speed": given.speed}
    if flags:
        robot = lerobot_robot(flags)
        with supported(robot, input):
            record(robot, lambda: input("Place the object, then press Enter: "), *to, **bounds)
    else:
        from tests.calfree_gym.lerobot.fake_so101 import FakeSO101

        bench = FakeSO101()
        record(bench, bench.place_object, *to, **bounds)
    print(given.out)


if __name__ == "__main__":
    main()
