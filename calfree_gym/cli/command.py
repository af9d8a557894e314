"""`calfree check | watch | reach | marks | pick`: a real arm and two cameras, without calibration."""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import calfree_gym
from calfree_gym.cli.check import check
from calfree_gym.cli.reach import ReachRun, reach
from calfree_gym.cli.robots import FLAG, Ask, lerobot_robot, supported
from calfree_gym.cli.standing import StandingRobot
from calfree_gym.cli.watch import Page, to_file, to_lerobot, watch
from calfree_gym.errors import printable
from calfree_gym.lerobot import ArmError
from calfree_gym.lerobot.robot import LeRobot
from calfree_gym.picture_reach import PairTracker, tracker_of
from calfree_gym.vision import TagTracker
from calfree_gym.vision.__main__ import add_pick, run_pick
from calfree_gym.vision.tags import PAPERS, print_tags

TAGS = "tags"
ARM = """The arm is told by LeRobot's own flags: --robot.type=so101_follower --robot.port=/dev/ttyACM0
--robot.id=arm --robot.cameras='{left: {type: opencv, index_or_path: 0, width: 640, height: 480, fps: 30},
right: {...}}'"""
INTERRUPTED = 130
"""How shells know that Ctrl-C has ended a command."""


def main(
    arguments: Sequence[str] | None = None,
    make_robot: Callable[[Sequence[str]], LeRobot] = lerobot_robot,
    ask: Ask = input,
) -> int:
    """Runs a command.

    Args:
        arguments: By default those of the process.
        make_robot: Makes a robot of the flags that begin with `--robot.`; a bench gives another one.
        ask: Says what is to be done, and waits until it is.

    Returns:
        0 where all is well; 1 where `check` or `pick` finds something wrong, the arm cannot go on, or nobody
        answers; 2 where what was given cannot be; 130 after Ctrl-C.
    """
    options, flags = _parsed(arguments)
    with warnings.catch_warnings():
        warnings.simplefilter("always", UserWarning)
        warnings.showwarning = _warn
        try:
            return _run(options, flags, make_robot, ask)
        except (ArmError, ValueError, OSError, ImportError) as error:
            print(f"error: {printable(str(error).strip())}", file=sys.stderr)
            return 1 if isinstance(error, ArmError) else 2
        except EOFError:
            print("error: it asks, and nobody answers: its input has ended", file=sys.stderr)
            return 1
        except KeyboardInterrupt:
            return INTERRUPTED


def _warn(message: Warning | str, *_: Any, **__: Any) -> None:
    print(f"warning: {message}", file=sys.stderr)


def _run(
    options: argparse.Namespace,
    flags: Sequence[str],
    make_robot: Callable[[Sequence[str]], LeRobot],
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
    make_robot: Callable[[Sequence[str]], LeRobot],
    ask: Ask,
) -> int:
    if options.marks not in (None, TAGS) and not Path(options.marks).is_file():
        raise ValueError(
            f"--marks {options.marks}: there is no such file; allowed: a file of colours, or {TAGS}"
        )
    tracker: PairTracker = TagTracker() if options.marks == TAGS else tracker_of(options.marks)
    if options.command == "reach":
        told = {field.name: getattr(options, field.name) for field in fields(ReachRun)}
        run = ReachRun(**told | {"marks": tracker})
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
    parser = argparse.ArgumentParser(prog="calfree", description=__doc__)
    parser.add_argument("--version", action="version", version=f"calfree {calfree_gym.__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="command")

    def command(name: str, told: str, epilog: str = "") -> argparse.ArgumentParser:
        return commands.add_parser(name, help=told, description=told, epilog=epilog, allow_abbrev=False)

    def option(command: argparse.ArgumentParser, flag: str, told: str, **settings: Any) -> None:
        default = " (default: %(default)s)" * bool(settings.get("default"))
        command.add_argument(flag, help=told + default, **settings)

    checks = command("check", "looks at cameras, marks and motors; moves nothing", ARM)
    watches = command("watch", "shows what is seen, until Ctrl-C; moves nothing", ARM)
    reaches = command("reach", "lets an agent reach, and writes a report", ARM)
    for each in (checks, watches, reaches):
        option(each, "--cameras", "names of left and right", type=_names, default="left,right")
        option(each, "--marks", f"a file of colours, or {TAGS!r}; by default three balls")
    for each in (checks, reaches):
        option(each, "--motors", "names of those that move; by default all but the gripper's", type=_names)
        option(each, "--unit", "so many degrees from home motors go, either way", type=float, default=45.0)
    option(checks, "--out", "folder for pictures", type=Path, default=Path("calfree-check"))
    option(watches, "--port", "of the page on localhost", type=int, default=8008)
    option(watches, "--out", "a picture, written again and again, in place of the page", type=Path)
    option(watches, "--display_data", "in LeRobot's viewer", type=_flag, nargs="?", const=True, default=False)
    option(
        reaches,
        "--agent",
        "its name; the error where there is no such agent lists all",
        default="memory",
    )
    option(reaches, "--reaches", "how many", type=int, default=10)
    option(reaches, "--speed", "degrees a second, at most", type=float, default=60.0)
    option(reaches, "--tolerance-px", "of the rendezvous, of 512 px of an image", type=float, default=3.0)
    option(reaches, "--max-motions", "a reach is cut off after so many", type=int, default=40)
    option(reaches, "--save", "file for what is learned, and for home", type=Path)
    option(reaches, "--load", "such a file: the arm goes to its home, slowly", type=Path)
    now = Path(time.strftime("calfree-%Y%m%d-%H%M%S"))
    option(reaches, "--out", "folder for report and film", type=Path, default=now)
    marks = command("marks", "writes the tags to print, as a PDF")
    option(marks, "--paper", "its size", choices=PAPERS, default="A4")
    option(marks, "--out", "the file", type=Path, default=Path("tags.pdf"))
    add_pick(commands)
    return parser


def _flag(text: str) -> bool:
    if text.lower() not in ("true", "false"):
        raise argparse.ArgumentTypeError(f"{text!r} is neither true nor false")
    return text.lower() == "true"
