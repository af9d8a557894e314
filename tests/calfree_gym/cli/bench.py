"""`calfree` with the bench in place of an arm: whoever has none can try it.

    .venv/bin/python -m tests.calfree_gym.cli.bench reach --agent=memory --reaches=6

What the user is asked to do is done: objects are placed, the arm is supported.
"""

import sys

from calfree_gym.cli import main
from tests.calfree_gym.lerobot.fake_so101 import FakeSO101


def calfree(arguments, robot, happens=None, supports=True):
    """The exit code of a command, with this robot.

    Args:
        arguments: Of the command.
        robot: The bench's.
        happens: What happens before the first, second, ... object is placed, by that number.
        supports: Whether anybody supports the arm in the end.
    """
    placed = 0

    def ask(text):
        nonlocal placed
        if "object" in text:
            placed += 1
            (happens or {}).get(placed, lambda: None)()
            robot.place_object()
        elif not supports:
            raise KeyboardInterrupt

    return main(arguments, make_robot=lambda flags: robot, ask=ask)


if __name__ == "__main__":
    sys.exit(calfree(None, FakeSO101()))
