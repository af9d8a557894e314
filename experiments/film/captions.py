"""What a film says in words: where it is, and what has just happened to the world."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from calfree_gym.robot.inserting import RADIUS

MM = 1000.0
_WORDS = {
    "camera_roll": "{camera} camera rolled by {degrees:.0f} degrees",
    "camera_aim": "{camera} camera turned by {degrees:.0f} degrees",
    "camera_zoom": "{camera} camera's focal length times {factor:.2f}",
    "camera_shift": "{camera} camera moved by {centimetres:.0f} cm",
    "camera_replace": "{camera} camera replaced by another one",
    "lens": "{camera} camera has another lens, k1 = {k1:.2f}",
    "joint_zero": "zero of joint {joint} shifted by {degrees:.0f} degrees",
    "link_length": "link {link} has {factor:.2f} times its length",
    "motor_gain": "motor {motor} moves {factor:.2f} times as far",
    "motor_sign": "motor {motor} reversed",
    "backlash": "motor {motor} has {degrees:.1f} degrees of backlash",
    "repeatability": "motor {motor} repeats itself to {degrees:.1f} degrees",
    "register_noise": "registers with noise of {registers:.4f}",
    "register_step": "registers in steps of {registers:.4f}",
    "shortfall": "motors fall {percent:.0f} % short of each word",
    "longest_motion": "no motor moves by more than {words:.2f} at once",
    "dead_zone": "motor {motor} ignores words up to {words:.3f}",
    "gear_ripple": "motor {motor}'s gain ripples by {depth:.1f}",
    "point_noise": "image points with {px:.1f} px of noise",
    "point_outliers": "{percent:.0f} % of the image points are wrong",
    "point_dropout": "{percent:.0f} % of the image points are lost",
    "latency": "image points come {motions} motions late",
    "light": "the light comes from elsewhere, strength {strength:.2f}",
    "exposure": "{camera} camera's exposure times {factor:.2f}",
    "blur": "{camera} camera's images blurred by {px:.1f} px",
    "image_noise": "{camera} camera's images have {levels:.0f} levels of noise",
    "occluder": "a post hides {percent:.0f} % from the {camera} camera",
    "undo": "all as before change {event}",
}


class Status(NamedTuple):
    """Where a trial is.

    Attributes:
        trial: From 1.
        motions: Made in it.
        info: What `calfree_gym` tells of the last motion.
        success: Whether the task is done.
        over: Whether it has ended.
    """

    trial: int
    motions: int
    info: Mapping[str, Any]
    success: bool = False
    over: bool = False

    @property
    def task(self) -> Task:
        """What the agent is to do."""
        return next(task for task in TASKS if not task.told_by or task.told_by in self.info["truth"])


class Task(NamedTuple):
    """What an agent is to do, in words.

    Attributes:
        told_by: What only its truth tells; nothing, of reaching.
        trial: What a trial is.
        done: What has happened where the trial was a success.
    """

    told_by: str
    trial: str
    done: str


TASKS = (
    Task("lifted_mm", "grasp", "lifted"),
    Task("depth_mm", "insertion", "inserted"),
    Task("", "reach", "reached"),
)


def caption(agent: str, status: Status) -> str:
    """The line below the pictures."""
    count, task = motions_in_words(status.motions), status.task
    where = f"motion {status.motions}"
    if status.success:
        where = f"{task.done} in {count}"
    elif status.over:
        where = f"not {task.done} in {count}"
    return " · ".join([agent, f"trial {status.trial}", where, *_measured(status.info)])


def told(status: Status) -> str:
    """Where a trial is, in a few words."""
    count = motions_in_words(status.motions) if status.motions else "begins"
    return f"{status.task.trial} {status.trial}: {count}" + ", in vain" * (status.over and not status.success)


def motions_in_words(motions: int) -> str:
    """So many motions."""
    return f"{motions} motion{'s' * (motions != 1)}"


def _measured(info: Mapping[str, Any]) -> list[str]:
    """What is true of the task."""
    truth = info["truth"]
    if "lifted_mm" in truth:
        if truth["lifted_mm"] == 0:  # nothing is between the jaws
            return ["not held"]
        up = round(float(truth["lifted_mm"]))
        return [f"held, {up} mm up" if up > 0 else "held"]
    if "depth_mm" in truth:
        inside = truth["depth_mm"] > 0 and truth["lateral_mm"] < MM * RADIUS
        return [f"peg {truth['depth_mm']:.0f} mm in the hole" if inside else "peg outside the hole"]
    off = f"{truth['error_px']:.0f} px off"
    if "contacts" not in info:
        return [off]
    return [off, f"touches with {info['peak_force']:.0f} N" if info["contacts"] else "touches nothing"]


def announcement(perturbation: Mapping[str, Any]) -> str:
    """A perturbation in words; of a type without words of its own, the name and all settings.

    Args:
        perturbation: As its `to_dict` gives it, with all that it drew.
    """
    words = _WORDS.get(perturbation["type"])
    if words is not None:
        given = dict(perturbation)
        given["centimetres"] = 100 * abs(given.get("metres", 0))
        given["percent"] = 100 * given.get("share", 0)
        if "degrees" in given:
            given["degrees"] = abs(given["degrees"])
        if "event" in given:
            given["event"] += 1
        return words.format_map(given)
    settings = ", ".join(f"{key} {_short(value)}" for key, value in perturbation.items() if key != "type")
    name = str(perturbation["type"]).replace("_", " ")
    return f"{name}: {settings}" if settings else name


def _short(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else f"{value}"
