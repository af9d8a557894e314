"""Arms as people write them: a mapping of arguments, with angles in degrees where they wish."""

import math
from collections.abc import Mapping
from numbers import Real
from typing import Any

from calfree_gym import Arm
from calfree_gym.robot.arms.arm import digest_of
from calfree_gym.robot.arms.chain import SLIDE

DIGEST = "digest"
"""Only what results say of an arm has this key."""


def as_arm(given: Mapping[str, Any]) -> Arm:
    """The arm that a mapping means: the arguments of `Arm`, and `home_degrees`.

    Args:
        given: As `Arm` takes it. `home_degrees` maps hinges to degrees; it is put over a mapping `home`.

    Raises:
        ValueError: As `Arm` raises, or `home_degrees` is no mapping of hinges to numbers, or stands beside a
            keyframe.
    """
    arguments = dict(given)
    degrees = arguments.pop("home_degrees", None)
    if degrees is not None:
        home = arguments.get("home") or {}
        if not isinstance(degrees, Mapping):
            raise ValueError(f"home_degrees is {degrees!r}; it must be a mapping of joints to degrees")
        if not isinstance(home, Mapping):
            raise ValueError(
                f"home is the keyframe {home!r}, and home_degrees is given too; give one of them"
            )
        arguments["home"] = {**home, **{joint: _radians(joint, value) for joint, value in degrees.items()}}
    arm = Arm.from_dict(arguments)
    for joint in degrees or ():
        if arm.robot.model.joint(joint).type[0] == SLIDE:
            raise ValueError(f"home_degrees names {joint!r}, which slides; give it under home, in m")
    return arm


def is_told(arm: str | Mapping[str, Any]) -> bool:
    """Whether this is what results say of an arm, and no arm that can be built."""
    return isinstance(arm, Mapping) and DIGEST in arm


def as_told(arm: Mapping[str, Any]) -> dict[str, Any]:
    """What results say of an arm: its model's name and digest, and its arguments; no file and no folder.

    Args:
        arm: What `Arm.to_dict` or this returned.
    """
    if is_told(arm):
        return dict(arm)
    made = Arm.from_dict(arm)
    told = {name: value for name, value in arm.items() if name != "assets"}
    return told | {
        "model": made.robot.spec.modelname,
        "motors": list(made.robot.motors),
        DIGEST: made.digest,
    }


def digest(arm: Mapping[str, Any]) -> str:
    """The digest of what `Arm.to_dict` or `as_told` returned."""
    return str(arm[DIGEST]) if is_told(arm) else digest_of(arm)


def _radians(joint: str, degrees: Any) -> float:
    if isinstance(degrees, bool) or not isinstance(degrees, Real):
        raise ValueError(f"home_degrees has {joint!r} at {degrees!r}; it must be a number, in degrees")
    return math.radians(degrees)
