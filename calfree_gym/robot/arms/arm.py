"""The arm as a value: a model, its gripper, its motors and its home."""

from __future__ import annotations

import hashlib
import json
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property, lru_cache
from html import unescape
from numbers import Real
from operator import itemgetter
from pathlib import Path
from typing import Any, Self

from calfree_gym.errors import near_misses
from calfree_gym.robot.arms.mjcf import Source, read
from calfree_gym.robot.arms.model import ArmModel
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.arms.robot import Robot

MOVEMASTER_NAME = "movemaster"
"""The arm that is used where none is given."""
_FOLDERS = re.compile(r"""\s(assetdir|meshdir|texturedir)\s*=\s*("[^"]*"|'[^']*')""")
"""Where MJCF says in which folders its assets are."""
_QUOTED = re.compile(r"""(?<=["'])([^"'<>]*)(?=["'])""")
"""What may be the place of an asset in MJCF."""


@dataclass(frozen=True, eq=False)
class Arm:
    """Any arm that MuJoCo can load. Compares by value; goes to and from a plain dict.

    Its motors get position servos and its weight is carried; its other joints stay at home, whatever
    actuators they have. Contacts are off.

    Attributes:
        model: MJCF text, with the places of assets written out. Given: also a path, or an `MjSpec`.
        gripper: Name of the site or body that is the gripper point.
        motors: Names of the joints that the controller's words move. By default all hinges and slides from
            `base` to the gripper. Three to seven.
        home: Name of a keyframe, which also places free bodies and balls, or joint positions (rad; slides m)
            by joint name. Joints that are left out are where the model has them. By default motors are at
            that of many drawn postures from which the gripper can move best in all directions.
        base: Name of the body where the chain starts. By default the first one below the world.
        assets: SHA-256 of each file that the model needs. Given: they are compared.

    Raises:
        ValueError: The model cannot be read, an asset has changed, a name is unknown (those that exist are
            named), there are not three to seven motors, one is outside the chain or neither hinge nor slide,
            or home is beyond a joint's range.
    """

    model: Source = field(repr=False)
    gripper: str
    motors: Sequence[str] | None = None
    home: str | Mapping[str, float] | None = None
    base: str | None = None
    assets: Mapping[str, str] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        self._check_kinds()
        text, assets = read(self.model)
        for file, digest in (self.assets or {}).items():
            if assets.get(file) != digest:
                what = "is no longer among the model's files" if file not in assets else "has changed"
                raise ValueError(f"the arm's asset {file} {what} since the arm was described")
        home = tuple(sorted(self.home.items(), key=str)) if isinstance(self.home, Mapping) else self.home
        motors = None if self.motors is None else tuple(self.motors)
        model = _model(text, tuple(assets.items()), self.gripper, motors, home, self.base)
        settled = {
            "model": text,
            "motors": model.motors,
            "home": self.home if isinstance(self.home, str) else model.home_by_name,
            "base": model.parts.base,
            "assets": assets,
        }
        for name, value in settled.items():
            object.__setattr__(self, name, value)
        object.__setattr__(self, "_robot", model)

    def _check_kinds(self) -> None:
        """Raises where an argument is of a kind that no arm has, such as a number in place of a name."""
        motors, home = self.motors, self.home
        names = isinstance(motors, list | tuple) and all(isinstance(each, str) for each in motors)
        for name, right, what in (
            ("gripper", isinstance(self.gripper, str), "the name of a site or body"),
            ("motors", motors is None or names, "a list of different joints' names"),
            (
                "home",
                home is None or isinstance(home, str | Mapping),
                "a keyframe's name, or positions by joint name",
            ),
            ("base", self.base is None or isinstance(self.base, str), "the name of a body"),
            (
                "assets",
                self.assets is None or isinstance(self.assets, Mapping),
                "digests by file, as `to_dict` gives them",
            ),
        ):
            if not right:
                raise ValueError(f"{name} is {getattr(self, name)!r}; it must be {what}")
        given: dict[str, Any] = dict(home) if isinstance(home, Mapping) else {}
        for joint, value in given.items():
            number = isinstance(value, Real) and not isinstance(value, bool)
            if not (number and abs(value) <= sys.float_info.max):
                raise ValueError(
                    f"home has {joint!r} at {value!r:.80}; it must be a number, in rad or, for a slide, in m"
                )

    @property
    def robot(self) -> ArmModel:
        """What the environment needs to know of it."""
        return self._robot  # type: ignore[attr-defined]

    def to_dict(self) -> dict[str, Any]:
        """Plain text, numbers and lists under the names of the arguments."""
        return json.loads(json.dumps(asdict(self)))

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """The arm of a mapping of arguments, such as `to_dict` gives.

        Raises:
            ValueError: It is no mapping; an argument is unknown or missing, and what the class raises.
        """
        names = [each.name for each in fields(cls)]
        if not isinstance(values, Mapping):
            raise ValueError(f"an arm is {values!r:.200}; it must be a mapping of {', '.join(names)}")
        if unknown := sorted(map(str, values.keys() - set(names))):
            raise ValueError(f"an arm has no {', '.join(unknown)}; allowed: {', '.join(names)}")
        if missing := [name for name in ("model", "gripper") if name not in values]:
            raise ValueError(f"an arm lacks {', '.join(missing)}")
        return cls(**values)

    @cached_property
    def digest(self) -> str:
        """See `digest_of`."""
        return digest_of(self.to_dict())

    def __eq__(self, other: object) -> bool:
        return self.digest == other.digest if isinstance(other, Arm) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.digest)

    def __reduce__(self) -> Any:
        return type(self).from_dict, (self.to_dict(),)

    def __deepcopy__(self, memo: Any) -> Arm:
        return self


def digest_of(values: Mapping[str, Any]) -> str:
    """SHA-256 of all that an arm is, wherever its files are; of what `Arm.to_dict` gives."""
    assets: Mapping[str, str] = values["assets"]
    text = _FOLDERS.sub("", values["model"])
    text = _QUOTED.sub(lambda each: assets.get(unescape(each[1]), each[0]), text)
    named = sorted(((Path(file).name, digest) for file, digest in assets.items()), key=itemgetter(0))
    value = {**values, "model": text, "assets": named}
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


@lru_cache(maxsize=4)
def _model(
    text: str,
    assets: tuple[tuple[str, str], ...],
    gripper: str,
    motors: tuple[str, ...] | None,
    home: str | tuple[tuple[str, float], ...] | None,
    base: str | None,
) -> ArmModel:
    """What follows from an arm, whose assets have these hashes: to compile large meshes takes seconds."""
    return ArmModel(text, gripper, motors, dict(home) if isinstance(home, tuple) else home, base)


ArmChoice = str | Arm | Mapping[str, Any]


def robot_of(arm: ArmChoice) -> Robot:
    """The arm that is meant.

    Raises:
        ValueError: It is none; or as `Arm` raises.
    """
    if isinstance(arm, Arm):
        return arm.robot
    if isinstance(arm, Mapping):
        return Arm.from_dict(arm).robot
    if arm == MOVEMASTER_NAME:
        return MOVEMASTER
    raise ValueError(
        f"arm is {arm!r}{near_misses(arm, [MOVEMASTER_NAME])}; it must be {MOVEMASTER_NAME!r}, a "
        "calfree_gym.Arm, or a mapping of its arguments: {'model': 'arm.xml', 'gripper': 'a site or body'}"
    )
