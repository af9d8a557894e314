"""Marks: the colours of the balls that make the gripper point and the object point visible."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from types import ModuleType
from typing import Any, Self

from calfree_gym.errors import near_misses, to_install
from calfree_gym.errors.yaml_values import read
from calfree_gym.files import whole

LEAST_SATURATION = 0.5
"""Of a mark. Choice: a background has at most 0.3, and one needs some distance from it."""
LEAST_HUE_GAP = 40.0
"""Between two marks, in degrees. Choice: white balance of ±15 % turns the default marks' hues by up to 13."""


@dataclass(frozen=True)
class Mark:
    """The colour of one ball.

    Attributes:
        rgb: Its colour in white light, 0 to 255. Brightness means nothing: any lamp will do.
        hue_tolerance: How far a pixel's hue may be from it, in degrees. Choice: noise and JPEG turn
            small balls' hues by 10, a lamp that is not white by as much.
    """

    rgb: tuple[int, int, int]
    hue_tolerance: float = 25.0

    def __post_init__(self) -> None:
        values = tuple(self.rgb) if isinstance(self.rgb, (tuple, list)) else ()
        if len(values) != 3 or not all(type(v) is int and 0 <= v <= 255 for v in values):
            raise ValueError(f"Mark.rgb is {self.rgb!r}; it must be three whole numbers from 0 to 255")
        object.__setattr__(self, "rgb", values)
        width = self.hue_tolerance
        if isinstance(width, bool) or not isinstance(width, (int, float)) or not 0 < width <= 60:
            raise ValueError(f"Mark.hue_tolerance is {width!r}; it must be in (0, 60] degrees")
        object.__setattr__(self, "hue_tolerance", float(width))
        if self.saturation < LEAST_SATURATION:
            raise ValueError(
                f"Mark.rgb {values} has saturation {self.saturation:.2f}, too grey to be told from a "
                f"background; it must be {LEAST_SATURATION} or more"
            )

    @property
    def hue(self) -> float:
        """In degrees: red 0, green 120, blue 240."""
        red, green, blue = self.rgb
        spread = max(self.rgb) - min(self.rgb)
        if max(self.rgb) == red:
            return 60 * ((green - blue) / spread) % 360
        return (
            60 * (2 + (blue - red) / spread) if max(self.rgb) == green else 60 * (4 + (red - green) / spread)
        )

    @property
    def saturation(self) -> float:
        """Of grey 0, of a pure colour 1."""
        return (max(self.rgb) - min(self.rgb)) / max(max(self.rgb), 1)

    def to_dict(self) -> dict[str, Any]:
        """Plain lists and numbers; `from_dict` gets them back exactly."""
        return {"rgb": list(self.rgb), "hue_tolerance": self.hue_tolerance}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Mark:
        """The mark that `to_dict` wrote.

        Raises:
            ValueError: `rgb` is missing, a field is unknown, or a value is not allowed.
        """
        _check_fields("a mark", values, ("rgb",), ("rgb", "hue_tolerance"))
        return cls(**values)


@dataclass(frozen=True)
class MarkSet:
    """Marks that one tracker looks for, by name; their hues must be far apart."""

    def __post_init__(self) -> None:
        kind, names = type(self).__name__, self.names()
        for name in names:
            if not isinstance(getattr(self, name), Mark):
                raise ValueError(f"{kind}.{name} is {getattr(self, name)!r}; it must be a Mark")
        for i, first in enumerate(names):
            for second in names[i + 1 :]:
                gap = hue_gap(getattr(self, first).hue, getattr(self, second).hue)
                if gap < LEAST_HUE_GAP:
                    raise ValueError(
                        f"marks {first} and {second} are too like each other: their hues are {gap:.0f} "
                        f"degrees apart; they must be {LEAST_HUE_GAP:.0f} or more"
                    )

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """The marks, in the order in which every array holds them."""
        return tuple(each.name for each in fields(cls))

    def to_dict(self) -> dict[str, Any]:
        """Plain dicts, lists and numbers; `from_dict` gets them back exactly."""
        return {name: getattr(self, name).to_dict() for name in self.names()}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """The marks that `to_dict` wrote.

        One that is missing is its default, or another mark's where that is too like one that is given.

        Raises:
            ValueError: A name is unknown, or a mark is not allowed; names it.
        """
        names = cls.names()
        _check_fields("marks", values, (), names)
        marks = {}
        for name, value in values.items():
            try:
                marks[name] = Mark.from_dict(value)
            except ValueError as error:
                raise ValueError(f"{name}: {error}") from None
        defaults = [getattr(cls, name) for name in names]
        for name in names:
            if name not in marks:
                taken = [mark.hue for mark in marks.values()]
                free = [m for m in defaults if all(hue_gap(m.hue, hue) >= LEAST_HUE_GAP for hue in taken)]
                if not free:
                    raise ValueError(f"{name} is missing, and no default differs enough from those given")
                marks[name] = getattr(cls, name) if getattr(cls, name) in free else free[0]
        return cls(**marks)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """The marks of a YAML file, such as `python -m calfree_gym.vision pick` writes.

        Raises:
            ImportError: PyYAML is not installed.
            OSError: The file cannot be read.
            ValueError: It holds no marks; names the file.
        """
        yaml = yaml_module()
        try:
            return cls.from_dict(read(Path(path).read_text(encoding="utf-8")))
        except (ValueError, yaml.YAMLError) as error:
            raise ValueError(f"{path}: {error}") from None

    def save(self, path: str | Path) -> None:
        """Writes a YAML file that `load` reads.

        Raises:
            ImportError: PyYAML is not installed.
            OSError: The file cannot be written.
        """
        write_yaml(path, self.to_dict())


@dataclass(frozen=True)
class Marks(MarkSet):
    """Three balls: two of equal size on the gripper, and the object's.

    The gripper point is midway in space between `gripper_1` and `gripper_2`. The default suits the
    simulator, whose magenta (242, 13, 140) has hues from 300, overexposed, to 340, in warm light: no red.
    """

    gripper_1: Mark = Mark((242, 13, 165), 27.0)
    gripper_2: Mark = Mark((13, 13, 242))
    object: Mark = Mark((13, 242, 13))


@dataclass(frozen=True)
class GraspMarks(MarkSet):
    """What a gripper that grasps is seen by, and an object of one colour.

    Each mark's middle is what it marks, from wherever it is seen: the lower ends of both jaws; the upper ends
    of both, in one colour; a ball or the like on each side of the gripper's base, across the line of the
    jaws; and the object.
    """

    jaw_1: Mark = Mark((230, 13, 230))
    jaw_2: Mark = Mark((26, 51, 242))
    edge_1: Mark = Mark((242, 217, 13))
    edge_2: Mark = Mark((13, 204, 217))
    fingers: Mark = Mark((242, 26, 13))
    object: Mark = Mark((13, 204, 64))


MARK_NAMES = Marks.names()
"""The balls of a gripper that reaches, and of an object."""


def hue_gap(first: Any, second: Any) -> Any:
    """Between two hues, numbers or arrays of them, in degrees, 0 to 180."""
    return abs((first - second + 180) % 360 - 180)


def _check_fields(what: str, values: object, needed: tuple[str, ...], known: tuple[str, ...]) -> None:
    if not isinstance(values, Mapping):
        raise ValueError(f"{what} must be a mapping with {', '.join(known)}; found {values!r}")
    for name in values:
        if name not in known:
            raise ValueError(f"unknown {name!r}{near_misses(name, known)}; allowed: {', '.join(known)}")
    if missing := [name for name in needed if name not in values]:
        raise ValueError(f"{what} lacks {', '.join(missing)}")


def write_yaml(path: str | Path, values: Mapping[str, Any]) -> None:
    """Writes a file of marks whole, where a link leads too.

    Raises:
        ImportError: PyYAML is not installed.
        OSError: The file cannot be written.
    """
    text = yaml_module().safe_dump(values, sort_keys=False, default_flow_style=None)
    with whole(os.path.realpath(path)) as file:
        file.write(text.encode())


def yaml_module() -> ModuleType:
    """PyYAML, which only files of marks need.

    Raises:
        ImportError: It is not installed.
    """
    try:
        import yaml
    except ImportError:
        raise ImportError(
            f"files of marks need PyYAML: pip install pyyaml, or {to_install('vision')}"
        ) from None
    return yaml
