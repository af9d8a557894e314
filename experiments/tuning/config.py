"""What is tuned, where, and within which ranges: read from YAML into frozen models, and tried once."""

import math
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
)

import agents
from experiments.config.life import EvaluationConfig, most_motions, with_shares_as_motions
from experiments.config.loading import load_as, read_mapping, read_yaml
from experiments.config.model import Model, distinctly_named, known, one_of
from experiments.config.requirements import requirements, unfit_life
from experiments.config.suite import AgentConfig, ScenarioConfig, Suite
from experiments.running.run import world_seeds


def _finite(value: Any) -> Any:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError("it must be a finite number")
    return value


Number = Annotated[int | float, BeforeValidator(_finite)]


class RangeConfig(Model):
    """The numbers that a setting may have; whole ones, where both ends are whole.

    Attributes:
        log: Whether factors count, and not differences.
    """

    low: Number
    high: Number
    log: bool = False

    @field_validator("high")
    @classmethod
    def _above_low(cls, value: float, info: ValidationInfo) -> float:
        if "low" in info.data and not value > info.data["low"]:
            raise ValueError(f"it must be above low, {info.data['low']}")
        return value

    @field_validator("log")
    @classmethod
    def _of_positive_numbers(cls, value: bool, info: ValidationInfo) -> bool:
        if value and info.data.get("low", 1) <= 0:
            raise ValueError(f"low is {info.data['low']}, and only positive numbers have logarithms")
        return value

    @property
    def whole(self) -> bool:
        """Whether the numbers are whole."""
        return isinstance(self.low, int) and isinstance(self.high, int)

    def __contains__(self, value: Any) -> bool:
        number = isinstance(value, int if self.whole else int | float) and not isinstance(value, bool)
        return number and self.low <= value <= self.high

    def __str__(self) -> str:
        return f"{self.low:g} to {self.high:g}" + (", by factors" if self.log else "")


class TunedAgentConfig(Model):
    """An agent, and what is varied of it.

    Attributes:
        scenario: In which of the scenarios it lives.
        settings: What is not varied, and is not as by default either.
    """

    name: Annotated[str, known(agents.names)]
    scenario: str
    settings: dict[str, Any] = Field({})
    ranges: dict[str, RangeConfig] = Field({})
    choices: dict[str, list[Any]] = Field({}, validate_default=True)

    @field_validator("choices")
    @classmethod
    def _something_varied_once(
        cls, value: dict[str, list[Any]], info: ValidationInfo
    ) -> dict[str, list[Any]]:
        ranges, settings = info.data.get("ranges", {}), info.data.get("settings", {})
        if not value and not ranges and "ranges" in info.data:
            raise ValueError("nothing is varied: neither ranges nor choices are given")
        for name, found in value.items():
            if name in ranges:
                raise ValueError(f"choices.{name}: ranges has it too")
            if len(found) < 2:
                raise ValueError(f"choices.{name} has {len(found)}: there must be two or more")
        if twice := (ranges.keys() | value.keys()) & settings.keys():
            raise ValueError(f"settings gives {', '.join(sorted(twice))} already")
        return value

    def defaults(self) -> dict[str, Any]:
        """What the varied settings are by default, as in YAML; those that the agent lacks are missing."""
        known = agents.default_settings(self.name, **self.settings)
        found = {name: known[name] for name in (*self.ranges, *self.choices) if name in known}
        return {name: list(value) if isinstance(value, tuple) else value for name, value in found.items()}


class TuningScenarioConfig(ScenarioConfig):
    """Lifetimes in which settings are judged, in so many worlds.

    Attributes:
        worlds: In which each try is made.
        check_worlds: Other ones, in which the best settings are compared with the default ones.
    """

    evaluation: EvaluationConfig
    worlds: int = Field(gt=0)
    check_worlds: int = Field(gt=1)

    @field_validator("evaluation")
    @classmethod
    def _within_its_lifetimes(cls, value: EvaluationConfig, info: ValidationInfo) -> EvaluationConfig:
        if value.at and {"env", "motions", "trials"} <= info.data.keys():
            most = most_motions(info.data["motions"], info.data["trials"], info.data["env"])
            if value.at[-1] > most:
                raise ValueError(f"evaluation.at has {value.at[-1]}; lifetimes have at most {most} motions")
        return value

    @field_validator("agents")
    @classmethod
    def _named_by_agents(cls, value: tuple[str, ...] | None) -> None:
        if value is not None:
            raise ValueError("here each agent names its scenario")


class TuningConfig(Model):
    """Which agents are tuned, and what for each of them is allowed at most.

    Attributes:
        seed: Of all worlds; no suite has the same.
        tries: Settings tried, the default ones included.
        cpu_minutes: That all tries of an agent may take.
    """

    seed: int = Field(ge=0)
    tries: int = Field(20, gt=0)
    cpu_minutes: float = Field(20, gt=0)
    scenarios: Annotated[
        tuple[TuningScenarioConfig, ...], Field(min_length=1, strict=False), AfterValidator(distinctly_named)
    ]
    agents: Annotated[
        tuple[TunedAgentConfig, ...], Field(min_length=1, strict=False), AfterValidator(distinctly_named)
    ]

    @field_validator("agents")
    @classmethod
    def _each_in_a_scenario(
        cls, value: tuple[TunedAgentConfig, ...], info: ValidationInfo
    ) -> tuple[TunedAgentConfig, ...]:
        if "scenarios" in info.data:
            names = tuple(scenario.name for scenario in info.data["scenarios"])
            for i, agent in enumerate(value):
                try:
                    one_of(agent.scenario, names)
                except ValueError as error:
                    raise ValueError(f"agents.{i}.scenario: found {agent.scenario!r}: {error}") from None
        return value

    def only(self, names: list[str]) -> "TuningConfig":
        """The same for some of its agents."""
        for name in names:
            try:
                one_of(name, tuple(agent.name for agent in self.agents))
            except ValueError as error:
                raise ValueError(f"found {name!r}: {error}") from None
        chosen = tuple(agent for agent in self.agents if agent.name in names)
        return self.model_copy(update={"agents": chosen})

    def scenario_of(self, agent: TunedAgentConfig) -> TuningScenarioConfig:
        """Where it is tuned."""
        return next(scenario for scenario in self.scenarios if scenario.name == agent.scenario)

    def suite(self, agent: TunedAgentConfig, settings: dict[str, Any]) -> Suite:
        """The agent with some settings in all worlds of its scenario: first those of tries, then others."""
        scenario = self.scenario_of(agent)
        own = scenario.model_dump(exclude={"worlds", "check_worlds"})
        return Suite(
            name="tuning",
            question="",
            seed=self.seed,
            worlds=scenario.worlds + scenario.check_worlds,
            scenarios=(ScenarioConfig.model_validate(own),),
            sweeps=(),
            claims=(),
            agents=(AgentConfig(name=agent.name, label=agent.name, settings=agent.settings | settings),),
        )


def load_tuning(path: Path, overrides: Sequence[str] = ()) -> TuningConfig:
    """Reads and validates a configuration."""
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
    wrong, taken = {}, seeds_of_suites(folder)
    for i, scenario in enumerate(config.scenarios):
        try:
            scenario.env.make(with_shares_as_motions(scenario.perturbations, scenario.motions)).close()
        except ValueError as error:
            wrong[f"scenarios.{i}.env"] = f"{error}"
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
    try:
        whole = AgentConfig(name=agent.name, label=agent.name, settings=agent.settings | settings)
        rows = requirements(whole, scenario.env).rows
    except ValidationError as error:
        return error.errors()[0]["msg"].removeprefix("Value error, ")
    except Exception as error:  # whatever a library raises at a setting that it cannot use
        return f"{error}"
    unfit = unfit_life(scenario, whole, scenario.evaluation, rows) if rows > 1 else {}
    return next((f"{where} of {scenario.name!r}: {why}" for where, why in unfit.items()), None)
