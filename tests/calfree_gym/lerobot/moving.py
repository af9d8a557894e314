"""A process whose arm is on its way when something ends the process: `python -m ... FILE ENDING`."""

import os
import signal
import sys
from pathlib import Path

import numpy as np

from calfree_gym.lerobot import LeRobotReachEnv
from tests.calfree_gym.lerobot.fake_so101 import FakeSO101
from tests.calfree_gym.lerobot.so101 import MOTORS


def main():
    path, ending = Path(sys.argv[1]), sys.argv[2]
    signal.signal(signal.SIGINT, signal.default_int_handler)  # it is ignored in jobs in the background
    robot = FakeSO101(0, power=path)
    robot.connect(calibrate=False)
    robot.bus.calibration = robot.bus.read_calibration()
    at, ticks = robot.bus.sync_read("Present_Position"), []

    def end(observation, action):
        ticks.append(np.abs(robot.plant.targets - robot.plant.angles).max())
        if len(ticks) == 8:
            path.with_suffix(".moving").write_text(f"{ticks[-1]:.4f}")
            if ending == "exit":
                sys.exit(3)
            os.kill(os.getpid(), getattr(signal, ending))

    home = {name: at[name] + 5 for name in MOTORS[:5]}
    LeRobotReachEnv(robot, ("left", "right"), home=home, unit=20, on_tick=end).reset()


if __name__ == "__main__":
    main()
