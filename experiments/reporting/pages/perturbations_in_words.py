"""What perturbations, schedules and sweeps are called in figures."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from experiments.config.suite import ScenarioConfig, SweepConfig

_EVENTS = {
    "camera_roll": ("{camera} rolled by {degrees}°", "{camera} rolled by any angle"),
    "camera_aim": ("{camera} turned by {degrees}°", "{camera} turned"),
    "camera_zoom": ("{camera}: focal length × {factor}", "{camera} zoomed"),
    "camera_shift": ("{camera} moved by {metres} m", "{camera} moved"),
    "camera_replace": ("{camera} replaced", "{camera} replaced"),
    "lens": ("{camera}: another lens", "{camera}: another lens"),
    "joint_zero": ("a joint's zero shifted by {degrees}°", "a joint's zero shifted"),
    "link_length": ("a link's length × {factor}", "another length of a link"),
    "motor_gain": ("a motor's gain × {factor}", "another gain of a motor"),
    "motor_sign": ("a motor reversed", "a motor reversed"),
    "point_noise": ("image noise of {px} px", "image noise"),
    "point_outliers": ("outliers: a share of {share}", "outliers"),
    "point_dropout": ("hidden points: a share of {share}", "hidden points"),
    "latency": ("images {motions} motions late", "late images"),
}
"""In words where its settings are given, and where they are drawn."""
_AXES = {
    ("camera_roll", "degrees"): "roll of {camera} (degrees)",
    ("camera_aim", "degrees"): "turn of {camera} (degrees)",
    ("camera_zoom", "factor"): "focal length of {camera} (1: as built)",
    ("joint_zero", "degrees"): "shift of a joint's zero (degrees)",
    ("link_length", "factor"): "length of a link (1: as built)",
    ("motor_gain", "factor"): "gain of a motor (1: as built)",
    ("point_noise", "px"): "noise of image points (px of 512)",
    ("point_outliers", "share"): "outliers (share of image points)",
    ("register_noise", "registers"): "noise of registers (1: home to the stop)",
    ("register_step", "registers"): "steps of registers (1: home to the stop)",
    ("shortfall", "share"): "shortfall (share of each motion)",
    ("longest_motion", "words"): "longest motion (1: home to the stop)",
    ("dead_zone", "words"): "dead zone (1: home to the stop)",
    ("gear_ripple", "depth"): "ripple of a motor's gain (share)",
}


def in_words(do: Mapping[str, Any]) -> str:
    """What a perturbation (its `type` and settings) does, such as "left camera turned by 20°"."""
    given, drawn = _EVENTS.get(do["type"], (_plain(do), _plain(do)))
    settings = {**do, "camera": _camera(do)}
    try:
        return given.format(**settings)
    except KeyError:
        return drawn.format(**settings)


def axis_in_words(sweep: SweepConfig) -> str:
    """What a sweep varies, with its unit."""
    known = _AXES.get((sweep.do["type"], sweep.vary))
    return known.format(camera=_camera(sweep.do, "the ")) if known else f"{_plain(sweep.do)}: {sweep.vary}"


@dataclass(frozen=True, slots=True)
class Knock:
    """A change of the world at one place of a lifetime.

    Attributes:
        trial: Before which trial, where the schedule says so.
        words: What changed.
    """

    trial: int | None
    words: str


def knocks(scenario: ScenarioConfig) -> list[Knock] | None:
    """The changes of a lifetime in their order; None where the world changes again and again."""
    schedule = scenario.perturbations
    if not all("at" in event for event in schedule):
        return None
    found: dict[tuple[str, float], list[str]] = {}
    for event in schedule:
        ((clock, place),) = event["at"].items()
        found.setdefault((clock, place), []).append(_event(event, schedule))
    length, _ = scenario.length
    ordered = sorted(found, key=lambda at: at[1] * (length if at[0] == "share" else 1))
    return [
        Knock(int(place) if clock == "trial" else None, ", ".join(found[clock, place]))
        for clock, place in ordered
    ]


def again_and_again(scenario: ScenarioConfig) -> str:
    """What changes all the time, such as "every 12 motions: left camera rolled by any angle"."""
    found: dict[str, list[str]] = {}
    for event in scenario.perturbations:
        if "at" not in event:
            found.setdefault(_when(event), []).append(_event(event, scenario.perturbations))
    return "; ".join(f"{when}: {', '.join(what)}" for when, what in found.items())


def _event(event: Mapping[str, Any], schedule: tuple[dict[str, Any], ...]) -> str:
    if "undo" in event:
        return f"undone: {in_words(schedule[event['undo']]['do'])}"
    return in_words(event["do"])


def _when(event: Mapping[str, Any]) -> str:
    if "drift" in event:
        return f"in every {event['drift']['per']}"
    ((clock, count),) = event["every"].items()
    return f"in every {clock}" if count == 1 else f"every {count} {clock}s"


def _camera(do: Mapping[str, Any], article: str = "") -> str:
    return f"{article}{do['camera']} camera" if "camera" in do else "a camera"


def _plain(do: Mapping[str, Any]) -> str:
    settings = [f"{key} {value}" for key, value in do.items() if key != "type"]
    name = do["type"].replace("_", " ")
    return f"{name} ({', '.join(settings)})" if settings else name
