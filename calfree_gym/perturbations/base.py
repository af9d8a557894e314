"""What a perturbation is, and what its settings may be."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, fields, replace
from numbers import Integral, Real
from typing import Any, ClassVar, Self

import numpy as np

from calfree_gym.errors import near_misses
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.arms.robot import Robot
from calfree_gym.world import World, log_uniform

DRIFT_STEPS = 100
"""A drift whose step is not given takes this many steps to go as far as the perturbation goes at once. One to
another camera or lamp goes this part of what is left in each step: after so many, it has gone 63 %."""

Draw = Callable[[np.random.Generator], Any]


@dataclass(frozen=True)
class Setting:
    """What a setting of a perturbation may be.

    Attributes:
        draw: Draws its value where it is omitted; of the robot's parts any is drawn.
        part: "cameras", "motors", "joints", "links" or "wheels", where it is the name of one of the robot's.
        least, most: Bounds, where it is a number.
        whole: Whether the number must be a whole one.
        slow: Turns a drawn value into the value for one step of a drift.
    """

    draw: Draw | None
    part: str = ""
    least: float = -math.inf
    most: float = math.inf
    whole: bool = False
    slow: Callable[[Any], Any] = lambda value: value

    def drawn(self, rng: np.random.Generator, robot: Robot) -> Any:
        """Draws a value for a robot."""
        if self.draw is not None:
            return self.draw(rng)
        parts: tuple[str, ...] = getattr(robot, self.part)
        return parts[int(rng.integers(len(parts)))]

    def wrong(self, value: Any) -> str | None:
        """What is wrong with a value, if anything; only a robot can tell the names of its parts."""
        if self.part:
            return None if isinstance(value, str) else f"it must name one of the robot's {self.part}"
        kind = "a whole number" if self.whole else "a number"
        if isinstance(value, bool) or not isinstance(value, Integral if self.whole else Real):
            return f"it must be {kind}"
        if not math.isfinite(value):
            return "it must be finite"
        if not self.least <= float(value) <= self.most:
            return f"it must be {kind} from {self.least:g} to {self.most:g}"
        return None


def setting(draw: Draw | None, **allowed: Any) -> Any:
    """A dataclass field for a `Setting`."""
    return field(default=None, metadata={"setting": Setting(draw, **allowed)})


def one_of(part: str) -> Any:
    """The name of one of the robot's "cameras", "motors", "joints", "links", "wheels"; or any is drawn."""
    return setting(None, part=part)


def amount(draw: Draw, **bounds: float) -> Any:
    """A number that says how far; a step of a drift goes a hundredth of what `draw` draws."""
    return setting(draw, slow=lambda far: far / DRIFT_STEPS, **bounds)


def factor(low: float, high: float) -> Any:
    """A positive factor; where it is omitted, it is drawn log-uniformly within these bounds."""
    return setting(
        any_size(low, high),
        least=1e-3,
        most=1e3,
        slow=lambda factor: factor ** (1 / DRIFT_STEPS),
    )


def any_size(low: float, high: float) -> Draw:
    """Draws log-uniformly between two numbers."""
    return lambda rng: float(log_uniform(rng, low, high))


def uniform(low: float, high: float) -> Draw:
    """Draws uniformly between two numbers."""
    return lambda rng: float(rng.uniform(low, high))


class Perturbation:
    """A frozen value that turns a world into another. Omitted settings are drawn at random.

    Attributes:
        type: Its name in YAML.
        at_home: Whether it must know where cameras on the arm are at home. Environments then tell it; without
            them that is as built.
        drifts: Whether it can be a drift: there are small steps of it.
        built: The robot, where none is given.
    """

    type: ClassVar[str]
    at_home: ClassVar[bool] = False
    drifts: ClassVar[bool] = True
    built: ClassVar[Robot] = MOVEMASTER

    @classmethod
    def settings(cls) -> dict[str, Setting]:
        """Its settings, by name."""
        return {f.name: f.metadata["setting"] for f in fields(cls)}  # type: ignore[arg-type]

    def __post_init__(self) -> None:
        for name in self.settings():
            if (value := getattr(self, name)) is not None:
                self.check(name, value)
                if isinstance(value, np.generic):
                    object.__setattr__(self, name, value.item())

    def check(self, name: str, value: Any) -> None:
        """Raises ValueError where a setting may not have this value; says what it may be."""
        if wrong := self.settings()[name].wrong(value):
            raise ValueError(f"{self.type}.{name} is {value!r}; {wrong}")

    def check_fits(self, robot: Robot) -> None:
        """Raises where a part that it names is none of the robot's.

        Raises:
            ValueError: It is unknown; names those that the robot has.
        """
        for name, allowed in self.settings().items():
            value, parts = getattr(self, name), getattr(robot, allowed.part) if allowed.part else ()
            if allowed.part and not parts:
                raise ValueError(f"{self.type} changes one of the robot's {allowed.part}; it has none")
            if allowed.part and value is not None and value not in parts:
                raise ValueError(
                    f"{self.type}.{name} is {value!r}{near_misses(value, parts)}; allowed: {', '.join(parts)}"
                )

    def apply(self, world: World, rng: np.random.Generator, robot: Robot | None = None) -> World:
        """Returns the perturbed world of an arm; omitted settings are drawn from `rng`."""
        return self.drawn(rng, robot=robot).change(world, robot or self.built)

    def drawn(self, rng: np.random.Generator, slowly: bool = False, robot: Robot | None = None) -> Self:
        """The same perturbation with every setting given; omitted ones are drawn from `rng`.

        Args:
            rng: Where the draws come from.
            slowly: Whether the drawn settings are for one step of a drift.
            robot: The arm.
        """
        draws = {name: allowed.drawn(rng, robot or self.built) for name, allowed in self.settings().items()}
        if slowly:
            draws = {name: allowed.slow(draws[name]) for name, allowed in self.settings().items()}
        return replace(self, **(draws | self._given()))  # type: ignore[type-var]

    def change(self, world: World, robot: Robot = MOVEMASTER) -> World:
        """Returns the perturbed world of an arm, where every setting is given."""
        raise NotImplementedError

    def inverse(self) -> Perturbation:
        """What undoes it, where every setting is given.

        Raises:
            NotImplementedError: Nothing does: the world keeps no trace of what it was.
        """
        raise NotImplementedError(f"{self.type} has no inverse")

    def drift(self, world: World, back: bool = False, robot: Robot = MOVEMASTER) -> World:
        """Returns the world after one more step of a drift, or one `back`, where every setting is given.

        Raises:
            ValueError: There is none: a quantity has come to the end of its range.
        """
        return (self.inverse() if back else self).change(world, robot)

    def to_dict(self) -> dict[str, Any]:
        """As in YAML: the type and what was given."""
        return {"type": self.type, **self._given()}

    def _entry(self, robot: Robot) -> int | tuple[()]:
        """The place, along a field's first axis, of the part of the robot that it names; () is all of it."""
        for name, allowed in self.settings().items():
            if allowed.part:
                return getattr(robot, allowed.part).index(getattr(self, name))
        return ()

    def _given(self) -> dict[str, Any]:
        return {k: v for k, v in asdict(self).items() if v is not None}  # type: ignore[call-overload]


class Factor(Perturbation):
    """Multiplies a field of the world, or the entry of the part that is named, by a factor.

    Attributes:
        quantity: The field.
    """

    quantity: ClassVar[str]
    factor: float

    def change(self, world: World, robot: Robot | None = None) -> World:
        entry = self._entry(robot or self.built)
        return with_entry(world, self.quantity, entry, getattr(world, self.quantity)[entry] * self.factor)

    def inverse(self) -> Perturbation:
        return replace(self, factor=1 / self.factor)  # type: ignore[type-var]


class Level(Perturbation):
    """Sets the field that its type names, or the entry of the part that is named; as a drift, adds to it.

    Attributes:
        quantity: The setting that holds the level; another one may name the camera or the motor.
    """

    quantity: ClassVar[str]

    def change(self, world: World, robot: Robot = MOVEMASTER) -> World:
        return with_entry(world, self.type, self._entry(robot), self._level(robot))

    def drift(self, world: World, back: bool = False, robot: Robot = MOVEMASTER) -> World:
        place, step, unit = self._entry(robot), self._level(robot), self._in_world(robot, 1)
        there = getattr(world, self.type)[place] + (-step if back else step)
        allowed = self.settings()[self.quantity]
        for level in np.ravel(there / unit).tolist():
            self.check(self.quantity, int(level) if allowed.whole else round(level, 9))
        if not allowed.whole:
            there = np.clip(there, allowed.least * unit, allowed.most * unit)  # what rounding leaves
        return with_entry(world, self.type, place, there)

    def _level(self, robot: Robot) -> float:
        return self._in_world(robot, getattr(self, self.quantity))

    def _in_world(self, robot: Robot, level: float) -> float:
        """A level in the world's units."""
        return level


def with_entry(world: World, name: str, index: int | tuple[()], value: Any) -> World:
    """The world with one entry, along the first axis, of the field `name` replaced; () is all of it."""
    array = getattr(world, name).copy()
    array[index] = value
    return world.replace(**{name: array})
