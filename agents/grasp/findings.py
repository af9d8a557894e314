"""What is found out in a trial of grasping."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from ..base.observation import Array, Observation
from ..servo.image_model.smooth_points import SmoothPoints
from .turning import Turning


@dataclass
class GraspFindings:
    """What is found out in a trial.

    Attributes:
        reach: What the servo of the approach finds out.
        turning: By what angle the jaws must turn, and what turns them.
        descent: Tip and object over registers, with all that is remembered of other trials; None where that
            is nothing.
        looks: All that was seen on the way to the intermediate position, as its target.
        untouched: All that was seen before the object may have moved, as who goes to it sees it.
        approached: Whether the gripper came to the intermediate position.
        key: The object's sensor vector and the `direction_key`, as seen from home (6,).
        above: Registers (k + 1,) of arm and turn from which the gripper descended, its jaws as they closed.
    """

    reach: Any
    turning: Turning
    descent: SmoothPoints | None = None
    looks: list[Observation] = field(default_factory=list)
    untouched: list[Observation] = field(default_factory=list)
    approached: bool = False
    key: Array | None = None
    above: Array | None = None

    @property
    def noise_px(self) -> float:
        """Standard deviation of an image coordinate."""
        return float(self.reach.filter.noise.px)
