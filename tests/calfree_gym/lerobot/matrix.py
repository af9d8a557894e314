"""What agents do on the bench in their lives, by the numbers that issue "A real arm" asks.

    .venv/bin/python -m tests.calfree_gym.lerobot.matrix unified_servo memory --worlds 20

One life is 10 reaches; both cameras are knocked (3 cm, 5 degrees), 5 reaches; a motor's zero shifts by 10
degrees, 5 reaches. A line a world, and then what all worlds say, beside what is asked.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np

import agents
from calfree_gym.lerobot import ArmError, LeRobotReachEnv
from calfree_gym.vision import TagTracker
from tests.calfree_gym.lerobot.fake_so101 import FakeSO101, NoPlaceError

FIRST, AFTER = 10, 5
"""Reaches before anything changes, and after each change."""
ASKED = {"unified_servo": (12, 3), "safe_start": (35, 5)}
"""The first reach's motions and the true distance in mm, in the median at most; of others `(12, 5)`."""


def life(agent, seed, tags=False):
    """One life of an agent in the world of a seed: motions, mm and whether it was reached, of each reach."""
    robot, marks = FakeSO101(seed, tags=tags), TagTracker() if tags else None
    env = LeRobotReachEnv(robot, ("left", "right"), marks=marks, place_object=robot.place_object)
    learner = agents.make(agent, env)
    changes = [lambda: None, robot.knock, robot.shift_zero]
    found = []
    for change, count in zip(changes, (FIRST, AFTER, AFTER), strict=True):
        change()
        for _ in range(count):
            try:
                (reach,) = env.reaches(learner, 1)
                found.append([reach.motions, robot.distance_mm(), reach.reached])
            except ArmError as error:
                print(f"world {seed}, reach {len(found) + 1}: {error}", flush=True)
                found.append([env.motions, robot.distance_mm(), False])
    return found


def summary(name, lives):
    """Lines of what is asked of an agent and what was found, of lives (worlds, reaches, 3)."""
    motions, mm, reached = np.moveaxis(np.array(lives, float), -1, 0)
    reached = reached.astype(bool)
    first, near = ASKED.get(name.split()[0], (12, 5))
    after = motions[:, [FIRST, FIRST + AFTER]]
    return [
        f"{name}: {len(lives)} worlds, {reached.size} reaches",
        f"  reached {reached.mean():.1%} (asked: 99 %)",
        f"  first reach, motions: median {np.median(motions[:, 0]):g} (asked: {first})",
        f"  reaches 6 to 10, motions: mean {motions[:, 5:FIRST].mean():.2f} (asked of memory: 2.5)",
        f"  first after knock, after shift, motions: median {np.median(after, 0)} (asked: 6), "
        f"most {after.max(0)} (asked: 20)",
        f"  true distance where reached, mm: median {np.median(mm[reached]):.1f} (asked: {near}), "
        f"95 % {np.quantile(mm[reached], 0.95):.1f} (asked: 8)",
    ]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("agents", nargs="+")
    parser.add_argument("--tags", action="store_true", help="printed tags in place of balls")
    parser.add_argument("--worlds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="seed of the first world")
    parser.add_argument("--out", type=Path, help="a folder for a JSON file a life, and for going on")
    given = parser.parse_args()
    for agent in given.agents:
        name, lives = f"{agent} by {'tags' if given.tags else 'balls'}", []
        for seed in range(given.first, given.first + given.worlds):
            kept = given.out and given.out / f"{name}, {seed}.json"
            if kept and kept.exists():
                lives.append(json.loads(kept.read_text()))
                continue
            began = time.process_time()
            try:
                lives.append(life(agent, seed, given.tags))
            except NoPlaceError as error:
                print(f"world {seed} is passed over: {error}", flush=True)
                continue
            if kept:
                kept.parent.mkdir(parents=True, exist_ok=True)
                kept.write_text(json.dumps([[m, round(mm, 2), bool(r)] for m, mm, r in lives[-1]]))
            print(f"{name}, world {seed}, motions: {' '.join(str(reach[0]) for reach in lives[-1])}", end="")
            print(f"; {time.process_time() - began:.0f} s of CPU", flush=True)
        print("\n".join(summary(name, lives)), flush=True)


if __name__ == "__main__":
    main()
