"""What perturbations, schedules and sweeps are called where people read: in reports, figures and films."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from experiments.config.suite import ScenarioConfig, SweepConfig

_WORDS = {
    "camera_roll": "{camera} rolled by {degrees}°",
    "camera_aim": "{camera} turned by {degrees}°",
    "camera_zoom": "{camera}: focal length times {factor}",
    "camera_shift": "{camera} moved by {metres} m",
    "camera_nearer": "{camera} brought nearer: a share of {share}",
    "camera_replace": "{camera} replaced",
    "lens": "{camera}: another lens, k1 = {k1}",
    "joint_zero": "{joint}'s zero shifted by {degrees}°",
    "link_length": "{link}'s length times {factor}",
    "motor_gain": "{motor}'s gain times {factor}",
    "motor_sign": "{motor} reversed",
    "backlash": "{motor} has a backlash of {degrees}°",
    "repeatability": "{motor} repeats itself to {degrees}°",
    "register_noise": "registers with noise of {registers}",
    "register_step": "registers in steps of {registers}",
    "shortfall": "motors fall short: a share of {share}",
    "longest_motion": "no motor moves by more than {words} at once",
    "dead_zone": "{motor} ignores words up to {words}",
    "gear_ripple": "{motor}'s gain ripples by {depth}",
    "wheel_radius": "{wheel}'s radius times {factor}",
    "track": "track times {factor}",
    "slip": "wheels slip by a share of {share}",
    "dock_moved": "dock moved by {metres} m, turned by {degrees}°",
    "point_noise": "image noise of {px} px",
    "point_outliers": "outliers: a share of {share}",
    "point_dropout": "hidden points: a share of {share}",
    "latency": "images {motions} motions late",
    "light": "light from elsewhere, strength {strength}",
    "exposure": "{camera}: exposure times {factor}",
    "blur": "{camera}: images blurred by {px} px",
    "image_noise": "{camera}: images with {levels} levels of noise",
    "occluder": "a post before the {camera}: a share of {share}",
    "undo": "all as before change {change}",
}
_DRAWN = {
    "camera_roll": "{camera} rolled by any angle",
    "camera_aim": "{camera} turned",
    "camera_zoom": "{camera} zoomed",
    "camera_shift": "{camera} moved",
    "lens": "{camera}: another lens",
    "joint_zero": "{joint}'s zero shifted",
    "link_length": "another length of {link}",
    "motor_gain": "another gain of {motor}",
    "wheel_radius": "another radius of {wheel}",
    "point_noise": "image noise",
    "point_outliers": "outliers",
    "point_dropout": "hidden points",
    "latency": "late images",
}
"""Where a setting is left to chance."""
_AXES = {
    ("camera_roll", "degrees"): "roll of {camera} (degrees)",
    ("camera_aim", "degrees"): "turn of {camera} (degrees)",
    ("camera_zoom", "factor"): "focal length of {camera} (1: as built)",
    ("camera_nearer", "share"): "how much nearer {camera} stands to the other (share)",
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
    """What a perturbation (its `type` and settings) does, such as "left camera turned by 20°".

    Of a type without words of its own, the name and all settings.
    """
    settings = {key: _amount(key, value) for key, value in do.items()}
    settings |= {"camera": _camera(do), "change": do.get("event", 0) + 1}
    settings |= {part: f"{part} {do[part]}" if part in do else f"a {part}" for part in _PARTS}
    for words in (_WORDS, _DRAWN):
        try:
            return words[do["type"]].format_map(settings)
        except KeyError:  # there are no such words, or a setting is not given
            continue
    return _plain(do)


_PARTS = ("joint", "link", "motor", "wheel")


def _amount(key: str, value: Any) -> str:
    if not isinstance(value, float):
        return str(value)
    return f"{abs(value) if key in ('degrees', 'metres') else value:.3g}"


def _camera(do: Mapping[str, Any]) -> str:
    return f"{do['camera']} camera" if "camera" in do else "a camera"


def _plain(do: Mapping[str, Any]) -> str:
    settings = [f"{key} {_amount(key, value)}" for key, value in do.items() if key != "type"]
    name = do["type"].replace("_", " ")
    return f"{name} ({', '.join(settings)})" if settings else name


def axis_in_words(sweep: SweepConfig) -> str:
    """What a sweep varies, with its unit."""
    if known := _AXES.get((sweep.do["type"], sweep.vary)):
        return known.format(camera=("the " if "camera" in sweep.do else "") + _camera(sweep.do))
    return f"{_plain(sweep.do)}: {sweep.vary}"


@dataclass(frozen=True, slots=True)
class Knock:
    """A change of the world at one place of a lifetime.

    Attributes:
        trial: Before which, counted from 0; None where that is not known.
        when: In words.
        words: What changes.
    """

    trial: int | None
    when: str
    words: str


def knocks(scenario: ScenarioConfig) -> list[Knock] | None:
    """The changes of a lifetime in their order; None where it is not known, or they come again and again."""
    if not all("at" in event for event in scenario.perturbations):
        return None
    places = (place for event in scenario.perturbations for place in event["at"].items())
    by_trials = {clock == "trial" for clock, count in places if count}
    return _knocks(scenario) if len(by_trials) < 2 else None


def later_knocks(scenario: ScenarioConfig) -> list[Knock] | None:
    """Those of `knocks` that a life does not begin with."""
    known = knocks(scenario)
    return None if known is None else [each for each in known if each.trial != 0]


def _knocks(scenario: ScenarioConfig) -> list[Knock]:
    found: dict[tuple[str, float], list[str]] = {}
    for event in scenario.perturbations:
        if "at" in event:
            (at,) = event["at"].items()
            found.setdefault(at, []).append(_event(event, scenario.perturbations))
    length, _ = scenario.length
    ordered = sorted(found, key=lambda at: at[1] * (length if at[0] == "share" else 1))
    return [
        Knock(int(place) if clock == "trial" else None, _at(clock, place), ", ".join(found[clock, place]))
        for clock, place in ordered
    ]


def _at(clock: str, place: float) -> str:
    if not place:
        return "from the beginning"
    if clock == "share":
        return f"after {place:.0%} of a life".replace("%", " %")
    return f"before trial {place + 1}" if clock == "trial" else f"after {place:,} motions"


def schedule_in_words(scenario: ScenarioConfig) -> str:
    """All changes of a lifetime, such as "before trial 9: left camera turned by 20°"; of none, nothing."""
    said = [f"{knock.when}: {knock.words}" for knock in _knocks(scenario)]
    return "; ".join(filter(None, [*said, again_and_again(scenario)]))


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
