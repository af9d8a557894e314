"""What comes of an arm's file: its motors, its work space, what cameras see, and whether physics settles."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import gymnasium
import numpy as np
import pandas as pd

from calfree_gym import Arm, WorldDistribution, nominal
from calfree_gym.geometry import Array
from calfree_gym.image import PIXELS_PER_UNIT, inside
from calfree_gym.robot.arms.robot import Mounts, Robot
from calfree_gym.robot.workspace import Workspaces, in_view, least_in_view
from experiments.config.environment import as_arm
from experiments.errors import ConfigError
from experiments.options import Parser
from experiments.reporting.tables import Table, show, written

WILD_WORLDS = 100
MOTIONS = 100
"""Random motions by which physics is compared with kinematics, in the built robot."""
FARTHEST = 0.4
"""Of the registers of these motions: where objects lie, and some way beyond."""
SETTLED_PX = 0.2
"""Physics has settled where no image point is farther than this from where it will be."""


class ArmCheck:
    """What comes of an arm, as tables and a picture.

    Attributes:
        problems: What keeps it from being used, one line each; complete when all tables have been made.
    """

    def __init__(self, arm: Arm, camera_mount: str | tuple[str, str]) -> None:
        self._arm, self._camera_mount = arm, camera_mount
        self._robot: Robot = arm.robot
        self._mounts: Mounts = self._robot.mounts(camera_mount)
        self.problems: list[str] = []

    @staticmethod
    def check_picture(path: Path) -> None:
        """Raises ValueError where no picture can be written to a file with such a suffix."""
        if not (path.suffix and cv2.haveImageWriter(str(path))):
            raise ValueError(f"{path}: no image is written as {path.suffix!r}; allowed: such as arm.png")

    def tables(self) -> Iterator[Table]:
        """Each as soon as it is there."""
        yield self._motors()
        yield self._work_space()
        yield self._views()
        yield self._settling()

    def picture(self, path: Path) -> None:
        """Writes the nominal robot at home, and beside it what its cameras see."""
        env = self._env(render_mode="rgb_array")
        env.reset(seed=0)
        image: Any = env.render()
        env.close()
        path.parent.mkdir(parents=True, exist_ok=True)
        if not cv2.imwrite(str(path), image[..., ::-1]):
            raise OSError(0, "no image can be written there", str(path))

    def _env(self, **arguments: Any) -> gymnasium.Env[Any, Any]:
        arguments |= {"arm": self._arm, "camera_mount": self._camera_mount, "keep_in_view": False}
        return gymnasium.make("CalFree/Reach-v0", world="nominal", **arguments)

    def _motors(self) -> Table:
        robot = self._robot
        unit = np.where(robot.slides, 1000.0, 180 / np.pi)
        low, high = (robot.stops * unit[:, None]).T
        frame = pd.DataFrame(
            {
                "motor": robot.motors,
                "kind": np.where(robot.slides, "slide", "hinge"),
                "unit": np.where(robot.slides, "mm", "degrees"),
                "lowest": low,
                "highest": high,
                "home": robot.home * unit,
                "span": robot.span * unit,
            }
        )
        note = (
            "Span: from home to the farther stop, as far as a control word of 1 moves the motor as built. "
            f"A motor stops {_listed(robot.stop_margin * unit, frame['unit'])} before its joint does. For "
            f"perturbations: joints {', '.join(robot.joints)}; links {', '.join(robot.links)}."
        )
        return Table(
            "motors", "Motors", frame, dict.fromkeys(["lowest", "highest", "home", "span"], ".1f"), note
        )

    def _work_space(self) -> Table:
        robot = self._robot
        draws = np.random.default_rng(0).random((1000, len(robot.motors)))
        points = robot.gripper_position(robot.postures(draws), robot.lengths)
        home = robot.gripper_position(robot.built_home, robot.lengths)
        left, right = robot.rig.position
        rows = {
            "gripper at home": home,
            "middle of the work space": robot.rig.target,
            "its lowest 5 %": np.quantile(points, 0.05, axis=0),
            "its highest 5 %": np.quantile(points, 0.95, axis=0),
            "left camera": left,
            "right camera": right,
        }
        frame = pd.DataFrame(
            [{"": name, **dict(zip("xyz", 1000 * at, strict=True))} for name, at in rows.items()]
        )
        size = 1000 * np.sqrt(np.square(points - robot.rig.target).sum(-1).mean())
        note = (
            f"In mm, in the room. Objects are {size:.0f} mm from the middle (root mean square): "
            f"{robot.rig.scale:.2f} times as far as the built-in arm's, and so are cameras, rods and marks."
        )
        return Table("work space", "Work space", frame, dict.fromkeys("xyz", ",.0f"), note)

    def _views(self) -> Table:
        robot, mounts = self._robot, self._mounts
        at_home, share = self._seen()
        least = least_in_view(robot, mounts)
        wild = WorldDistribution("wild")
        seen = [
            in_view(wild.sample(seed, robot=robot), robot, mounts, whole=True) for seed in range(WILD_WORLDS)
        ]
        rows = [
            ("nominal: gripper at home", "seen" if at_home else "not seen", "seen"),
            ("nominal: work space in view", written(share, ".0%"), written(least, ".0%")),
            (f"wild: draws in view, of {WILD_WORLDS}", f"{sum(seen)}", "1"),
            ("nominal: object where the gripper is", self._object_in_gripper(), "seen, for images"),
        ]
        if not at_home or share < least:
            self.problems.append(
                f"the nominal robot's cameras do not see enough on {robot.mount_name(mounts)}; try another "
                "camera_mount, home or motors"
            )
        if not any(seen):
            self.problems.append(f"no wild world of {WILD_WORLDS} is in view on {robot.mount_name(mounts)}")
        frame = pd.DataFrame(rows, columns=["both cameras", "found", "required"])
        note = (
            "Wild worlds that are out of view are drawn again. Images, and occlusion=True, need an object "
            "that the arm does not hide: a gripper that lies before the last link, not in it."
        )
        return Table("cameras", f"What both cameras see on {robot.mount_name(mounts)}", frame, note=note)

    def _seen(self) -> tuple[bool, float]:
        """Whether both cameras of the built robot see the gripper at home; how much of the work space."""
        workspace = Workspaces(1, self._robot, self._mounts)
        workspace.set_world(0, nominal(self._robot))
        _, seen = workspace.judged(0)
        return workspace.gripper_seen_at_home(0), float(seen.mean())

    def _object_in_gripper(self) -> str:
        """Whether the arm hides, at home, an object where the gripper is from a camera of the built robot."""
        env = self._env(dynamics="kinematic", occlusion=True)
        gripper = self._robot.gripper_position(self._robot.built_home, self._robot.lengths)
        observation, _ = env.reset(seed=0, options={"object": tuple(gripper)})
        env.close()
        return "seen" if observation["observation"][2:4].all() else "hidden"

    def _settling(self) -> Table:
        worst, compared = self.worst_px()
        if worst > SETTLED_PX:
            self.problems.append(
                f"physics is {worst:.2f} px from where it would settle; use dynamics: kinematic"
            )
        frame = pd.DataFrame(
            [(f"physics, {MOTIONS} motions", worst, SETTLED_PX)],
            columns=["", "worst difference to kinematic, px", "required"],
        )
        formats = {"worst difference to kinematic, px": ".0e", "required": ".1f"}
        note = (
            f"Image points of gripper and object in the nominal robot's cameras, where seen (n = {compared})."
        )
        return Table("settling", "Whether physics settles in a motion", frame, formats, note)

    def worst_px(self) -> tuple[float, int]:
        """Largest difference of image points (px) of gripper and object, and of how many."""
        rng, robot = np.random.default_rng(0), self._robot
        goals = rng.uniform(-FARTHEST, FARTHEST, (MOTIONS, len(robot.motors)))
        words = np.diff(goals, axis=0, prepend=np.zeros((1, len(robot.motors))))
        physics, kinematic = (self._points(words, dynamics) for dynamics in ("physics", "kinematic"))
        seen = inside(physics).all(-1)
        far = np.linalg.norm(physics - kinematic, axis=-1)[seen]
        return float(PIXELS_PER_UNIT * far.max(initial=0.0)), int(seen.sum())

    def _points(self, words: Array, dynamics: str) -> Array:
        """Noise-free image points (motions, 4, 2) of gripper and object after each of some words."""
        env = self._env(dynamics=dynamics, max_episode_steps=MOTIONS + 1)
        env.reset(seed=0)
        found = [env.step(each)[-1]["truth"]["points"] for each in words.astype(np.float32)]
        env.close()
        return np.array(found).reshape(-1, 4, 2)


def _listed(amounts: Array, units: Any) -> str:
    """Different amounts with their units, such as "0.6 degrees, 3.0 mm"."""
    return ", ".join(
        dict.fromkeys(f"{amount:.1f} {unit}" for amount, unit in zip(amounts, units, strict=True))
    )


def add_check_arm(parser: Parser) -> None:
    """`python -m experiments check-arm`."""
    parser.add_argument("model", metavar="FILE", help="MJCF or URDF file")
    parser.add_argument("--gripper", required=True, metavar="NAME", help="site or body")
    parser.add_argument("--motors", nargs="+", metavar="JOINT", help="default: all from base to gripper")
    parser.add_argument(
        "--home", nargs="+", metavar="KEY|SLIDE=M", help="keyframe, or slides at home (default: derived)"
    )
    parser.add_argument(
        "--home-degrees", nargs="+", type=_joint_at, metavar="JOINT=DEGREES", help="hinges at home"
    )
    parser.add_argument("--base", metavar="BODY", help="where the chain starts (default: below the world)")
    parser.add_argument(
        "--camera-mount",
        nargs="+",
        default=["waist"],
        metavar="MOUNT",
        help="waist, stand or a body; two of these for left and right (default: waist)",
    )
    parser.add_argument("--out", type=Path, metavar="PICTURE", help="image file, such as arm.png")
    parser.set_defaults(does=_check_arm)


def _joint_at(text: str) -> tuple[str, float]:
    joint, _, number = text.rpartition("=")
    if not joint:
        raise argparse.ArgumentTypeError(f"found {text!r}; allowed: such as elbow=-30")
    try:
        return joint, float(number)
    except ValueError:
        raise argparse.ArgumentTypeError(f"found {text!r}: {number!r} is no number") from None


def _check_arm(options: argparse.Namespace) -> int:
    given = {name: getattr(options, name) for name in ("model", "gripper", "motors", "base")}
    mount = options.camera_mount
    try:
        if options.out:
            ArmCheck.check_picture(options.out)
        if options.home:
            key, *others = options.home
            given["home"] = key if not others and "=" not in key else dict(map(_joint_at, options.home))
        if options.home_degrees:
            given["home_degrees"] = dict(options.home_degrees)
        check = ArmCheck(as_arm(given), mount[0] if len(mount) == 1 else tuple(mount))
    except (argparse.ArgumentTypeError, ValueError) as error:
        raise ConfigError(f"{error}") from None
    for table in check.tables():
        show([table])
    if options.out:
        check.picture(options.out)
        print(f"picture: {options.out}")
    for problem in check.problems:
        print(f"problem: {problem}", file=sys.stderr)
    return 1 if check.problems else 0
