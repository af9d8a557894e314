"""Marks for one's own cameras."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from calfree_gym.vision.marks import MARK_NAMES
from calfree_gym.vision.pick import pick
from calfree_gym.vision.tracking.balls import LARGEST_RADIUS, LEAST_RADIUS


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a command; 0 where it did what was asked, 1 where the tracker does not find the mark, else 2."""
    options = _parser().parse_args(arguments)
    try:
        return run_pick(options)
    except (ValueError, OSError, ImportError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m calfree_gym.vision", description=__doc__)
    add_pick(parser.add_subparsers(dest="command", required=True))
    return parser


def add_pick(commands: Any) -> None:
    """Adds the command `pick` to an argument parser's commands; `run_pick` runs it."""
    command = commands.add_parser("pick", help="learn a mark's colour from a box in a picture")
    command.add_argument("image", type=Path, help="picture that shows the mark")
    command.add_argument(
        "--box",
        type=int,
        nargs=4,
        required=True,
        metavar=("X", "Y", "WIDTH", "HEIGHT"),
        help="around the mark, in pixels from the upper left corner; it may hold some background",
    )
    command.add_argument("--mark", choices=MARK_NAMES, required=True, help="which mark it is")
    command.add_argument(
        "--out", type=Path, default=Path("marks.yaml"), help="file of marks (default: marks.yaml)"
    )


def run_pick(options: argparse.Namespace) -> int:
    """Learns a mark, and tells it; 1 where the tracker does not find it, else 0.

    Raises:
        ImportError, OSError, ValueError: See `pick`.
    """
    learned = pick(options.image, options.box, options.mark, options.out)
    mark = learned.mark
    print(
        f"learned {options.mark}: rgb {mark.rgb}, hue {mark.hue:.0f} ± {mark.hue_tolerance:.0f} degrees, "
        f"saturation {mark.saturation:.2f}; written to {options.out}"
    )
    if learned.found is None:
        print(
            f"the tracker does not find {options.mark} in {options.image}: is it a round ball, well lit, "
            f"with a radius of {LEAST_RADIUS[1]:.1%} to {LARGEST_RADIUS:.0%} of the image's shorter side?"
        )
        return 1
    x, y, radius = learned.found
    place = f"at ({x:.1f}, {y:.1f}) px, radius {radius:.1f} px"
    if not learned.in_box:
        print(f"the tracker takes something else for {options.mark}, outside the box, {place}")
        return 1
    print(f"the tracker finds {options.mark} in the box, {place}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
