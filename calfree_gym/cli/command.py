"""`calfree check | watch | reach | marks | pick`: a real arm and two cameras, without calibration.

The arm is told by LeRobot's own flags: --robot.type=so101_follower --robot.port=/dev/ttyACM0 --robot.id=arm
--robot.cameras='{left: {type: opencv, index_or_path: 0, width: 640, height: 480, fps: 30}, right: {...}}'
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from calfree_gym.cli.check import check
from calfree_gym.cli.reach import Run, reach
from calfree_gym.cli.robots import FLAG, Ask, lerobot_robot, supported
from calfree_gym.cli.standing import StandingRobot
from calfree_gym.cli.watch import Page, to_file, to_lerobot, watch
from calfree_gym.lerobot import ArmError
from calfree_gym.lerobot.robot import Robot
from calfree_gym.picture_reach import Tracker, tracker_of
from calfree_gym.vision import TagTracker
from calfree_gym.vision.__main__ import add_pick, run_pick
from calfree_gym.vision.tags import PAPERS, print_tags

TAGS = "tags"
INTERRUPTED = 130
"""How shells know that Ctrl-C has ended a command."""


def main(
    arguments: Sequence[str] | None = None,
    make_robot: Callable[[Sequence[str]], Robot] = lerobot_robot,
    ask: Ask = input,
) -> int:
    """Runs a command.

    Args:
        arguments: By default those of the process.
        make_robot: Makes a robot of the flags that begin with `--robot.`; a bench gives another one.
        ask: Says what is to be done, and waits until it is.

    Returns:
        0 where all is well; 1 where `check` or `pick` finds something wrong, or the arm cannot go on; 2 where
        what was given cannot be: nothing has moved then; 130 after Ctrl-C.
    """
    options, flags = _parsed(arguments)
    with warnings.catch_warnings():
        warnings.simplefilter("always", UserWarning)
        warnings.showwarning = _warn
        try:
            return _run(options, flags, make_robot, ask)
        except ArmError as error:
            print(f"error: {error}", file=sys.stderr)
            return 1
        except (ValueError, OSError, ImportError) as error:
            print(f"error: {error}", file=sys.stderr)
            return 2
        except KeyboardInterrupt:
            return INTERRUPTED


def _warn(message: Warning | str, *_: Any, **__: Any) -> None:
    print(f"warning: {message}", file=sys.stderr)


def _run(
    options: argparse.Namespace,
    flags: Sequence[str],
    make_robot: Callable[[Sequence[str]], Robot],
    ask: Ask,
) -> int:
    if options.command == "marks":
        print_tags(options.out, options.paper)
        print(f"{options.out}: print it at 100 %, and check its ruler")
        return 0
    if options.command == "pick":
        return run_pick(options)
    return _with_robot(options, flags, make_robot, ask)


def _with_robot(
    options: argparse.Namespace,
    flags: Sequence[str],
    make_robot: Callable[[Sequence[str]], Robot],
    ask: Ask,
) -> int:
    tracker: Tracker = TagTracker() if options.marks == TAGS else tracker_of(options.marks)
    if options.command == "reach":
        told = {field.name: getattr(options, field.name) for field in fields(Run)}
        run = Run(**told | {"marks": tracker})
        run.check()
        robot = make_robot(flags)
        with supported(robot, ask):
            return reach(robot, run, ask)
    robot = make_robot(flags)
    with supported(robot, ask):
        if options.command == "check":
            standing = StandingRobot(robot, options.cameras, options.motors, tracker)
            ask("The arm at home, place the object where both cameras see it; then press Enter: ")
            return check(standing, options.unit, options.out)
        standing = StandingRobot(robot, options.cameras, marks=tracker)
        if options.display_data:
            watch(standing, to_lerobot(standing.cameras))
        elif options.out is not None:
            watch(standing, to_file(options.out))
        else:
            page = Page(options.port)
            print(f"{page.address} shows what is seen; Ctrl-C ends it", flush=True)
            watch(standing, page)
            page.close()
    return 0


def _parsed(arguments: Sequence[str] | None) -> tuple[argparse.Namespace, list[str]]:
    """The options, and the flags that are LeRobot's."""
    parser = _parser()
    options, flags = parser.parse_known_args(arguments)
    needs_robot = options.command in ("check", "watch", "reach")
    others = [flag for flag in flags if flag.startswith("-") and not (needs_robot and flag.startswith(FLAG))]
    if others or (flags and not needs_robot):
        parser.error(f"{options.command} does not take {' '.join(others or flags)}; see --help")
    return options, flags


def _names(text: str) -> tuple[str, ...]:
    return tuple(text.split(","))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="calfree", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)

    def command(name: str, told: str) -> argparse.ArgumentParser:
        return commands.add_parser(
            name, help=told, formatter_class=argparse.ArgumentDefaultsHelpFormatter, allow_abbrev=False
        )

    checks = command("check", "looks at cameras, marks and motors; moves nothing")
    watches = command("watch", "shows what is seen, until Ctrl-C; moves nothing")
    reaches = command("reach", "lets an agent reach, and writes a report")
    for each in (checks, watches, reaches):
        each.add_argument("--cameras", type=_names, default="left,right", help="names of left and right")
        each.add_argument("--marks", help=f"a file of colours, or {TAGS!r}; by default three balls")
    for each in (checks, reaches):
        each.add_argument(
            "--motors", type=_names, help="names of those that move; by default all but the gripper's"
        )
        each.add_argument(
            "--unit", type=float, default=45.0, help="so many degrees from home motors go, either way"
        )
    checks.add_argument("--out", type=Path, default=Path("calfree-check"), help="folder for pictures")
    watches.add_argument("--port", type=int, default=8008, help="of the page on localhost")
    watches.add_argument("--out", type=Path, help="a picture, written again and again, in place of the page")
    watches.add_argument(
        "--display_data", type=_flag, nargs="?", const=True, default=False, help="in LeRobot's viewer"
    )
    reaches.add_argument("--agent", default="memory", help="its name")
    reaches.add_argument("--reaches", type=int, default=10, help="how many")
    reaches.add_argument("--speed", type=float, default=60.0, help="degrees a second, at most")
    reaches.add_argument(
        "--tolerance-px", type=float, default=4.0, help="of the rendezvous, where an image has 512"
    )
    reaches.add_argument("--max-motions", type=int, default=40, help="a reach is cut off after so many")
    reaches.add_argument("--save", type=Path, help="file for what is learned, and for home")
    reaches.add_argument("--load", type=Path, help="such a file: the arm goes to its home, slowly")
    now = Path(time.strftime("calfree-%Y%m%d-%H%M%S"))
    reaches.add_argument("--out", type=Path, default=now, help="folder for report and film")
    marks = command("marks", "writes the tags to print, as a PDF")
    marks.add_argument("--paper", choices=PAPERS, default="A4", help="its size")
    marks.add_argument("--out", type=Path, default=Path("tags.pdf"), help="the file")
    add_pick(commands)
    return parser


def _flag(text: str) -> bool:
    if text.lower() not in ("true", "false"):
        raise argparse.ArgumentTypeError(f"{text!r} is neither true nor false")
    return text.lower() == "true"
