"""Reading what is to be tuned: every end of every range is built once, and no world is that of a suite."""

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from experiments.config.loading import (
    load_as,
    read_mapping,
    read_yaml,
    unbuildable_environments,
)
from experiments.config.requirements import requirements
from experiments.config.suite import AgentConfig
from experiments.config.whole_moves import unfit_life
from experiments.running.plan import world_seeds
from experiments.tuning.config import TunedAgentConfig, TuningConfig, TuningScenarioConfig


def load_tuning(path: Path, overrides: Sequence[str] = ()) -> TuningConfig:
    """Reads and validates a configuration.

    Args:
        path: A YAML file. The suites that stand beside it keep their worlds to themselves.
        overrides: Values to put in place of those in the file, such as "tries=2".

    Raises:
        ConfigError: Names the file, the path of each wrong key, what was found, what is allowed.
    """
    return load_as(TuningConfig, path, overrides, partial(_wrong_in, folder=path.parent))


def seeds_of_suites(folder: Path) -> dict[int, str]:
    """What seeds the worlds of all suites in a folder, each with the name of a suite's file."""
    found: dict[int, str] = {}
    for path in sorted(folder.glob("*.yaml")):
        if not isinstance(read_yaml(path), dict):
            continue
        data = read_mapping(path)
        if isinstance(data.get("worlds"), int):
            own = (each.get("worlds", 0) for each in data.get("agents", ()) if isinstance(each, dict))
            most = max(data["worlds"], *own, 0)
            found |= dict.fromkeys(world_seeds(data.get("seed", 0), most, data.get("first_world")), path.name)
    return found


def _wrong_in(config: TuningConfig, folder: Path) -> dict[str, str]:
    wrong = unbuildable_environments(config.scenarios)
    taken = seeds_of_suites(folder)
    for scenario in config.scenarios:
        seeds = world_seeds(config.seed, scenario.worlds + scenario.check_worlds)
        if suites := {taken[seed] for seed in seeds if seed in taken}:
            wrong["seed"] = f"found {config.seed}: it gives worlds of {', '.join(sorted(suites))}"
    for i, agent in enumerate(config.agents):
        for where, what in _wrong_settings(agent, config.scenario_of(agent)).items():
            wrong[f"agents.{i}.{where}"] = what
    return wrong


def _wrong_settings(agent: TunedAgentConfig, scenario: TuningScenarioConfig) -> dict[str, str]:
    """What is wrong with an agent's settings, by the key below it."""
    if why := _unbuildable(agent, scenario, {}):
        return {"settings": why}
    wrong, defaults = {}, agent.defaults()
    for where, name, value in _ends(agent):
        if why := _unbuildable(agent, scenario, {name: value}):
            if name in defaults:
                wrong[where] = f"found {value!r}: {why}"
            else:
                wrong[where.rpartition(".")[0]] = why
    for name, default in defaults.items():
        if name in agent.ranges and default not in agent.ranges[name]:
            kind = "whole number" if agent.ranges[name].whole else "number"
            wrong[f"ranges.{name}"] = f"the default {default!r} is no {kind} from {agent.ranges[name]}"
        if name in agent.choices and default not in agent.choices[name]:
            wrong[f"choices.{name}"] = f"the default {default!r} is missing"
    return wrong


def _ends(agent: TunedAgentConfig) -> Iterator[tuple[str, str, Any]]:
    """The path below the agent, the setting and the value of each end of a range and each choice."""
    for name, found in agent.ranges.items():
        yield f"ranges.{name}.low", name, found.low
        yield f"ranges.{name}.high", name, found.high
    for name, values in agent.choices.items():
        for i, value in enumerate(values):
            yield f"choices.{name}.{i}", name, value


def _unbuildable(
    agent: TunedAgentConfig, scenario: TuningScenarioConfig, settings: dict[str, Any]
) -> str | None:
    """Why the agent cannot be made with these settings, if so."""
    whole = AgentConfig(name=agent.name, label=agent.name, settings=agent.settings | settings)
    try:
        rows = requirements(whole, scenario.env).rows
    except Exception as error:  # whatever a library raises at a setting that it cannot use
        return f"{error}"
    unfit = unfit_life(scenario, whole, scenario.evaluation, rows) if rows > 1 else {}
    return next((f"{where} of {scenario.name!r}: {why}" for where, why in unfit.items()), None)
