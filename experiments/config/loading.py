"""Reading a YAML file into frozen models, with errors that say where, what and what else."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, get_args, get_origin

import gymnasium
import yaml
from pydantic import BaseModel, ValidationError

from calfree_gym.errors import near_misses
from calfree_gym.errors.yaml_values import UnclearNumberError, read
from experiments.config.life import with_shares_as_motions
from experiments.config.requirements import requirements_in, unfit_life
from experiments.config.suite import AgentConfig, ScenarioConfig, Suite, SweepConfig
from experiments.errors import ConfigError


def with_overrides(data: dict[str, Any], overrides: Iterable[str]) -> dict[str, Any]:
    """A configuration's plain values with some of them replaced.

    Overrides are such as "worlds=2" or "scenarios.0.motions=200": the path as errors spell it, and a value as
    it would stand in YAML.
    """
    for override in overrides:
        path, equals, text = override.partition("=")
        if not equals or not path:
            raise ConfigError(f"--set {override}: found no key=value; allowed: such as worlds=2")
        try:
            value = read(text)
        except UnclearNumberError as error:
            raise ConfigError(f"--set {override}: {error}") from None
        except (yaml.YAMLError, ValueError) as error:
            raise ConfigError(f"--set {override}: the value is not valid YAML: {error}") from None
        data = _replaced(data, path.split("."), value, override)
    return data


def _replaced(data: Any, path: list[str], value: Any, override: str) -> Any:
    if not path:
        return value
    key, *rest = path
    if isinstance(data, list):
        if not key.isdecimal() or int(key) >= len(data):
            raise ConfigError(f"--set {override}: found {key!r}; allowed: 0 to {len(data) - 1}")
        items = list(data)
        items[int(key)] = _replaced(items[int(key)], rest, value, override)
        return items
    if data is None or isinstance(data, dict):
        values = data or {}
        return {**values, key: _replaced(values.get(key), rest, value, override)}
    raise ConfigError(f"--set {override}: {key!r} leads into {data!r}, which has no keys")


Config = TypeVar("Config", bound=BaseModel)


_OF_YAML = {
    "tuple_type": "it must be a list",
    "dict_type": "it must be a mapping",
    "model_type": "it must be a mapping",
}
"""What types are called in YAML, by pydantic's names of errors."""


class Kind(NamedTuple):
    """A kind of file: the keys that only it has, the model that is read from it, and who takes it."""

    keys: tuple[str, ...]
    model: str
    what: str
    taken_by: str


KINDS = (
    Kind(("question",), "Suite", "a suite", "the commands run and validate take"),
    Kind(("agent",), "FilmConfig", "what is filmed", "the command film takes"),
    Kind(("tries",), "TuningConfig", "what is tuned", "the command tune takes"),
    Kind(("words", "criteria"), "Claim", "claims", "a suite names under its key claims"),
)
"""Told apart before a file is checked key by key."""


_EXTENDS = "extends"
_MOST_BYTES = 2**24
"""Of a YAML file. Choice: one has thousands."""


def load(path: Path, overrides: Sequence[str] = (), modules: Sequence[str] = ()) -> Suite:
    """Reads and validates a suite; every environment, and every agent in it, is built once.

    An agent's `settings`, and `claims`, may name a YAML file, relative to this one; `extends` names one
    beside it, whose keys it takes where it has none of its own. Overrides are such as "worlds=2". Of agents'
    modules none are imported but these, and what is in them.
    """
    return load_as(Suite, path, overrides, _unbuildable, modules)


def load_as(
    model: type[Config],
    path: Path,
    overrides: Sequence[str],
    wrong_in: Callable[[Config], dict[str, str]],
    modules: Sequence[str] = (),
) -> Config:
    """Reads a configuration of some kind, and then asks `wrong_in` what is wrong where, by paths of keys.

    The `settings` of `agent`, and in a list of `agents`, may name YAML files, relative to this one.

    Raises:
        ConfigError: Names the file, the path of each wrong key, what was found, what is allowed.
    """
    _check_kind(model, path)
    data = read_mapping(path)
    data = with_overrides(_with_other_files(data, path.parent), overrides)
    try:
        config = model.model_validate(_with_other_files(data, path.parent), context=modules)
    except ValidationError as error:
        wrong = [_describe(details, model) for details in _own_errors(error)]
    else:
        wrong = [f"{where}: {what}" for where, what in wrong_in(config).items()]
    if wrong:
        raise ConfigError("\n".join([f"{path}:", *(f"  {line}" for line in wrong)]))
    return config


def _check_kind(model: type[BaseModel], path: Path) -> None:
    """Raises ConfigError where a file has the keys of another kind of file than `model` is read from."""
    data = read_yaml(path)
    entry = data[0] if isinstance(data, list) and data else data
    kind = next((kind for kind in KINDS if isinstance(entry, dict) and {*kind.keys} <= {*entry}), None)
    if kind is not None and kind.model != model.__name__:
        raise ConfigError(f"{path}: holds {kind.what}, which {kind.taken_by}")


def read_mapping(path: Path, above: tuple[Path, ...] = ()) -> dict[str, Any]:
    """The plain values in a YAML file, over those of the file that it extends; `above` extend this one."""
    data = read_yaml(path)
    if not isinstance(data, dict):
        raise ConfigError(f"{path}: found {type(data).__name__}; allowed: a mapping of keys")
    extended = data.pop(_EXTENDS, None)
    if extended is None:
        return data
    if not isinstance(extended, str) or Path(extended).name != extended:
        raise ConfigError(f"{path}: extends: found {extended!r}; allowed: the name of a file beside this one")
    below, chain = path.parent / extended, (*above, path)
    if _resolved(below) in (each.resolve() for each in chain):
        circle = " -> ".join(each.name for each in (*chain, below))
        raise ConfigError(f"{path}: extends: found a circle, {circle}")
    return {**read_mapping(below, chain), **data}


def _resolved(path: Path) -> Path:
    try:
        return path.resolve()
    except (OSError, ValueError) as error:
        raise ConfigError(f"{str(path)!r}: is the path of no file: {error}") from None


def read_yaml(path: Path) -> Any:
    """The plain values in a YAML file; what has no end, as a device, is none."""
    try:
        if path.exists() and not (path.is_file() and path.stat().st_size <= _MOST_BYTES):
            raise ConfigError(f"{path}: cannot be read; allowed: a file of at most {_MOST_BYTES} bytes")
        return read(path.read_text(encoding="utf-8"))
    except UnclearNumberError as error:
        raise ConfigError(f"{path}:\n  {error}") from None
    except (OSError, UnicodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from None
    except yaml.YAMLError as error:
        raise ConfigError(f"{path}{_place(error)}") from None
    except (ValueError, RecursionError) as error:  # such as a date in a thirteenth month
        raise ConfigError(f"{path}: is not valid YAML: {error}") from None


def _place(error: yaml.YAMLError) -> str:
    """Where in its file an error is, and what it is."""
    mark: yaml.Mark | None = getattr(error, "problem_mark", None)
    if mark is None:
        return f": is not valid YAML: {error}"
    begun: yaml.Mark | None = getattr(error, "context_mark", None)
    since = f" that begins in line {begun.line + 1}, column {begun.column + 1}" if begun else ""
    context: str | None = getattr(error, "context", None)
    problem: str = getattr(error, "problem", None) or str(error)
    what = f"{context}{since}, {problem}" if context else problem
    return f", line {mark.line + 1}, column {mark.column + 1}: is not valid YAML: {what}"


def _with_other_files(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The plain values with those of the files that they name."""
    read: dict[str, Any] = dict(_with_models_path(data, folder))
    if "agent" in data:
        read["agent"] = _with_settings_file(data["agent"], folder)
    if isinstance(data.get("agents"), list):
        read["agents"] = [_with_settings_file(agent, folder) for agent in data["agents"]]
    for part in ("scenarios", "sweeps"):
        if isinstance(data.get(part), list):
            read[part] = [_with_models_path(each, folder) for each in data[part]]
    if isinstance(data.get("claims"), str):
        read["claims"] = read_yaml(folder / data["claims"])
    return read


def _with_models_path(part: Any, folder: Path) -> Any:
    """What has an `env`, in which the path of an arm's model is relative to `folder` no longer."""
    try:
        env, arm, model = part["env"], part["env"]["arm"], part["env"]["arm"]["model"]
    except (KeyError, TypeError):
        return part
    if not isinstance(model, str) or model.lstrip().startswith("<"):
        return part
    return {**part, "env": {**env, "arm": {**arm, "model": str(_resolved(folder / model))}}}


def _with_settings_file(agent: Any, folder: Path) -> Any:
    if isinstance(agent, dict) and isinstance(agent.get("settings"), str):
        settings = read_yaml(folder / agent["settings"])
        if isinstance(settings, str):  # it would be taken for the name of another file
            raise ConfigError(f"{folder / agent['settings']}: found text; allowed: a mapping of settings")
        return {**agent, "settings": settings}
    return agent


def _unbuildable(suite: Suite) -> dict[str, str]:
    """What is wrong with environments and settings, found by building each environment once."""
    wrong = {}
    for where, part, schedule in _tried(suite):
        try:
            everything = part.env.make(schedule, tell=part.env.privileged)
        except ValueError as error:
            wrong[where] = f"{error}"
            continue
        with closing(everything):
            for agent in suite.agents_in(part):
                wrong |= _unfit(agent, part, suite, everything)
    return wrong


def _tried(suite: Suite) -> Iterator[tuple[str, ScenarioConfig | SweepConfig, tuple[dict[str, Any], ...]]]:
    """Scenarios and sweeps, each with the path of its key, and with a schedule."""
    for i, scenario in enumerate(suite.scenarios):
        yield f"scenarios.{i}.env", scenario, with_shares_as_motions(scenario.perturbations, scenario.motions)
    for i, sweep in enumerate(suite.sweeps):
        yield f"sweeps.{i}", sweep, sweep.perturbations(sweep.over[0])


def _unfit(
    agent: AgentConfig, part: ScenarioConfig | SweepConfig, suite: Suite, everything: gymnasium.Env[Any, Any]
) -> dict[str, str]:
    """What is wrong with an agent's settings and life in a part of a suite, by the path of the key."""
    try:
        rows = requirements_in(everything, agent, part.env).rows
    except Exception as error:  # whatever a library raises at a setting that it cannot use
        where = f"agents.{suite.agents.index(agent)}.settings"
        return {where: f"found {_short(agent.settings)}: {error}"}
    if rows == 1 or not isinstance(part, ScenarioConfig):
        return {}
    wrong = unfit_life(part, agent, suite.evaluation_of(part), rows)
    return {_place_of(where, part, agent, suite): f"{agent.label!r}: {why}" for where, why in wrong.items()}


def _place_of(where: str, scenario: ScenarioConfig, agent: AgentConfig, suite: Suite) -> str:
    """The path of a key that a scenario, the agent itself or the suite has for the agent's life."""
    if where == "motions" and agent.motions:
        return f"agents.{suite.agents.index(agent)}.motions"
    if where.startswith("evaluation") and scenario.evaluation is None:
        return where
    return f"scenarios.{suite.scenarios.index(scenario)}.{where}"


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 200 else text[:200] + "…"


def _own_errors(error: ValidationError) -> list[dict[str, Any]]:
    """Without those that only count wrong items as missing."""
    found: list[dict[str, Any]] = [dict(details) for details in error.errors()]
    within = {details["loc"][:depth] for details in found for depth in range(len(details["loc"]))}
    return [details for details in found if details["loc"] not in within]


def _describe(error: dict[str, Any], config: type[BaseModel]) -> str:
    where = ".".join(str(part) for part in error["loc"])
    message = error["msg"].removeprefix("Value error, ")
    if error["type"] == "missing":
        return f"{where}: missing"
    if error["type"] == "extra_forbidden":
        allowed = _siblings(error["loc"], config)
        hint = near_misses(error["loc"][-1], allowed)
        return f"{where}: unknown key{hint}; allowed: {', '.join(allowed)}"
    if message.startswith(f"{error['loc'][-1]}."):  # it has a path of its own, further in
        return ".".join([*map(str, error["loc"][:-1]), message])
    message = _OF_YAML.get(error["type"], message)
    return f"{where}: found {_short(error['input'])}: {message}"


def _siblings(location: tuple[str | int, ...], config: type[BaseModel]) -> list[str]:
    """The keys that are allowed beside the one at `location`."""
    annotation: Any = config
    for part in location[:-1]:
        model = _model_in(annotation)
        inside_model = isinstance(part, str) and get_origin(annotation) is not dict
        annotation = model.model_fields[str(part)].annotation if inside_model else model
    keys = list(_model_in(annotation).model_fields)
    return keys if len(location) > 1 else [*keys, _EXTENDS]


def _model_in(annotation: Any) -> type[BaseModel]:
    """The model that a type is, or contains."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next(_model_in(part) for part in get_args(annotation) if part not in (..., str, type(None)))
