"""What a film says in words: where it is, and what has just happened to the world."""

from collections.abc import Mapping
from typing import Any, NamedTuple

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
        agent: Who makes it.
        trial: From 1.
        motions: Made in it.
        truth: What is true now, see `calfree_gym`'s infos.
        success: Whether the task is done.
        over: Whether it has ended.
    """

    agent: str
    trial: int
    motions: int
    truth: Mapping[str, Any]
    success: bool = False
    over: bool = False


def caption(status: Status) -> str:
    """The line below the pictures."""
    motions = f"{status.motions} motion{'s' * (status.motions != 1)}"
    lifts = "lifted_mm" in status.truth
    task = "lift" if lifts else "rendezvous"
    where = f"motion {status.motions}"
    if status.success:
        where = f"{task} after {motions}"
    elif status.over:
        where = f"no {task} in {motions}"
    measured = f"image error {status.truth['error_px']:.0f} px"
    if lifts:
        measured = f"object {max(status.truth['lifted_mm'], 0):.0f} mm up"
    return f"{status.agent} · trial {status.trial} · {where} · {measured}"


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
