"""What was seen of gripper and object, and where."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..base.checks import checked_array
from ..base.observation import Array, Observation


@dataclass(frozen=True)
class Pairs:
    """Registers and what is seen there; each gripper point in both images.

    Attributes:
        registers: Registers (n, m).
        sensors: Sensor vectors (n, 4) of the gripper there, in image units.
        objects: Sensor vectors (n, 4) of the object there; NaN where it was not seen in both images, then or
            at home: nobody knows which object it is.
        homes: Sensor vectors (n, 4) of the object at home, in the same trial.
        noise_px: Standard deviation (n,) of an image coordinate, as far as known in that trial.
        trials: The trial (n,) of each, counted from 0.
    """

    registers: Array
    sensors: Array
    objects: Array
    homes: Array
    noise_px: Array
    trials: NDArray[np.int64]

    @classmethod
    def none(cls, motors: int) -> Self:
        """No pairs, for that number of registers."""
        nothing = np.empty((0, 4))
        return cls(np.empty((0, motors)), nothing, nothing, nothing, np.empty(0), np.empty(0, np.int64))

    @classmethod
    def of_trial(cls, looks: Sequence[Observation], noise_px: float, trial: int) -> Self:
        """The looks of a trial that show the gripper in both images.

        Args:
            looks: What was observed, at home first.
            noise_px: Standard deviation of an image coordinate.
            trial: The trial's number.
        """
        first = looks[0]
        looks = [look for look in looks if look.shows_gripper]
        shown = [first.shows_object and look.shows_object for look in looks]
        count = len(looks)
        if not count:
            return cls.none(0)
        return cls(
            np.array([look.registers for look in looks]),
            np.array([look.gripper for look in looks]).reshape(count, 4),
            np.array(
                [look.object if seen else np.full(4, np.nan) for look, seen in zip(looks, shown, strict=True)]
            ).reshape(count, 4),
            np.tile(first.object, (count, 1)),
            np.full(count, noise_px),
            np.full(count, trial),
        )

    @classmethod
    def of(cls, arrays: Mapping[str, NDArray[Any]]) -> Self:
        """From what `arrays` returned.

        Raises:
            ValueError: An array is missing, or of another shape than the others.
        """
        registers = checked_array(arrays, "registers", (None, None))
        count = len(registers)
        sensors, homes = (checked_array(arrays, name, (count, 4)) for name in ("sensors", "homes"))
        objects = checked_array(arrays, "objects", (count, 4), allow_nan=True)
        noise_px, trials = (checked_array(arrays, name, (count,)) for name in ("noise_px", "trials"))
        return cls(registers, sensors, objects, homes, noise_px, trials.astype(np.int64))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """As named arrays."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def __len__(self) -> int:
        return len(self.trials)

    def __add__(self, other: Pairs) -> Pairs:
        both = zip(self.arrays().values(), other.arrays().values(), strict=True)
        return Pairs(*(np.concatenate(arrays) for arrays in both))

    @property
    def with_object(self) -> NDArray[np.bool_]:
        """Which of them (n,) show the object in both images."""
        return np.asarray(np.isfinite(self.objects).all(1))

    def only(self, chosen: NDArray[np.bool_]) -> Pairs:
        """Those that are chosen (n,)."""
        return Pairs(*(array[chosen] for array in self.arrays().values()))

    def without_objects(self) -> Pairs:
        """The same, as if the object had not been seen."""
        return replace(self, objects=np.full_like(self.objects, np.nan))

    def away(self) -> Pairs:
        """All but the first, in a trial that begins at home."""
        return self.only(np.arange(len(self)) > 0)

    def latest(self, trials: int) -> Pairs:
        """Those of that number of latest trials."""
        return self.only(self.trials > self.trials.max(initial=0) - trials)
