"""What is compared with what: a suite, read from YAML into frozen models."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Any

from pydantic import AfterValidator, Field, ValidationInfo, field_validator, model_validator

import agents
from calfree_gym.errors import near_misses
from calfree_gym.perturbations import TYPES, parse_perturbation
from calfree_gym.perturbations.schedule import in_motions_and_trials
from experiments.config.claims import Claim, Requirement, TrialsOf
from experiments.config.environment import EnvironmentConfig, as_told
from experiments.config.life import (
    EvaluationConfig,
    check_one_world,
    check_reached,
    most_motions,
    with_shares_as_motions,
)
from experiments.config.model import Model, Name, distinct, distinctly_named, one_of
from experiments.config.own_agents import code_here, known_agent, may_import

FIRST_OWN_TRIALS = 100
"""Of a lifetime counted in motions so many own trials are all kept; claims look at no others."""


class ScenarioConfig(Model):
    """A lifetime: where, for how many motions or trials, and how the world is perturbed.

    Attributes:
        worlds: If given, it is in no more than so many, the first ones of the suite's.
        motions: Of a life; an agent may have its own number.
        places: Objects lie in turn at so many places, those of the first trials; else each at its own.
        perturbations: See `parse_schedule`; an event may come `at: {share: 0.5}` of a life's motions.
        agents: Labels of those that take part; all of the suite where none is given.
        evaluation: Its own, where it is not the suite's.
    """

    later = frozenset({"worlds", "places"})

    name: Name
    env: EnvironmentConfig
    worlds: int | None = Field(default=None, gt=0)
    motions: int | None = Field(None, gt=0)
    trials: int | None = Field(None, gt=0, validate_default=True)
    places: int | None = Field(default=None, gt=0)
    perturbations: tuple[dict[str, Any], ...] = Field((), strict=False)
    evaluation: EvaluationConfig | None = None
    agents: tuple[Name, ...] | None = Field(None, min_length=1, strict=False)

    @field_validator("trials")
    @classmethod
    def _motions_or_trials(cls, value: int | None, info: ValidationInfo) -> int | None:
        if "motions" in info.data and (info.data["motions"] is None) == (value is None):
            given = "neither is" if value is None else "both are"
            raise ValueError(f"a lifetime has a number of motions or a number of trials; {given} given")
        return value

    @field_validator("places")
    @classmethod
    def _of_trials_in_one_world(cls, value: int | None, info: ValidationInfo) -> int | None:
        if value is not None and {"env", "trials"} <= info.data.keys():
            env, trials = info.data["env"], info.data["trials"]
            if env.task != "reach" or env.redraw != "never" or trials is None:
                raise ValueError("allowed: in reaching, in one world, where a lifetime is counted in trials")
        return value

    @field_validator("perturbations")
    @classmethod
    def _within_the_lifetime(
        cls, value: tuple[dict[str, Any], ...], info: ValidationInfo
    ) -> tuple[dict[str, Any], ...]:
        if {"motions", "trials"} <= info.data.keys():
            _check_events(value, info.data["motions"], info.data["trials"])
        return tuple(map(in_motions_and_trials, value))

    @field_validator("evaluation")
    @classmethod
    def _within_the_longest_lifetime(
        cls, value: EvaluationConfig | None, info: ValidationInfo
    ) -> EvaluationConfig | None:
        if value is not None and {"env", "motions", "trials"} <= info.data.keys():
            most = most_motions(info.data["motions"], info.data["trials"], info.data["env"])
            if (value.every or 0) > most:
                raise ValueError(f"evaluation.every is {value.every}; lifetimes have at most {most} motions")
            check_one_world(info.data["env"], "this scenario")
        return value

    def motions_of(self, agent: "AgentConfig") -> int | None:
        """How many motions an agent's life has; None where it is counted in trials."""
        return self.motions and (agent.motions or self.motions)

    def lived_by(self, agent: "AgentConfig") -> "ScenarioConfig":
        """The scenario as an agent lives it: its own motions, and shares of them as motions.

        Who else takes part is no part of it, and the evaluation stands apart.
        """
        motions = self.motions_of(agent)
        schedule = with_shares_as_motions(self.perturbations, motions)
        own = {
            "motions": motions,
            "perturbations": schedule,
            "agents": None,
            "evaluation": None,
            "worlds": None,
        }
        return self.model_copy(update=own)

    @property
    def is_knocked(self) -> bool:
        """Whether there is a time before its first change: the world does not drift or only begin changed."""
        events = self.perturbations
        later = any(event.get("at") != {"trial": 0} for event in events)
        return later and not any("drift" in event for event in events)

    @property
    def length(self) -> tuple[int, str]:
        """How long a lifetime is, and what it is counted in: "motions" or "trials"."""
        return (self.motions, "motions") if self.motions is not None else (self.trials or 0, "trials")

    @property
    def most_motions(self) -> int:
        """The most motions that a lifetime can have."""
        return most_motions(self.motions, self.trials, self.env)


class SweepConfig(Model):
    """One setting of one perturbation, varied: what agents reach at each value, without learning.

    Attributes:
        worlds: As in a scenario.
        agents: Labels of those that take part; all of the suite where none is given.
    """

    later = frozenset({"worlds"})

    name: Name
    env: EnvironmentConfig
    worlds: int | None = Field(default=None, gt=0)
    do: dict[str, Any]
    vary: str
    over: tuple[int | float, ...] = Field(min_length=1, strict=False)
    agents: tuple[Name, ...] | None = Field(None, min_length=1, strict=False)

    @field_validator("do")
    @classmethod
    def _known_perturbation(cls, value: dict[str, Any]) -> dict[str, Any]:
        parse_perturbation(value, "do")
        return value

    @field_validator("vary")
    @classmethod
    def _a_number_of_it(cls, value: str, info: ValidationInfo) -> str:
        do = info.data.get("do")
        if do is None:
            return value
        settings = TYPES[do["type"]].settings()
        numbers = tuple(name for name, setting in settings.items() if not setting.part)
        if value in do:
            raise ValueError(f"do gives {value} already")
        return one_of(value, tuple(name for name in numbers if name not in do))

    @field_validator("over")
    @classmethod
    def _ascending_and_allowed(cls, value: tuple[float, ...], info: ValidationInfo) -> tuple[float, ...]:
        if {"do", "vary"} <= info.data.keys():
            for i, found in enumerate(value):
                parse_perturbation({**info.data["do"], info.data["vary"]: found}, f"over.{i}")
        if any(later <= earlier for earlier, later in pairwise(value)):
            raise ValueError("the values must ascend")
        return value

    def perturbations(self, value: float) -> tuple[dict[str, Any], ...]:
        """The schedule at one of the values: applied before a world's first trial."""
        return ({"at": {"trial": 0}, "do": {**self.do, self.vary: value}},)


class AgentConfig(Model):
    """An agent by name, or a name alone, with its settings.

    Attributes:
        name: See `agents.make`.
        label: Tells apart two of the same name.
        motions: Of its life, where a scenario is counted in motions, in place of the scenario's.
        worlds: How many it meets, in place of the suite's: the first ones of the same seed.
        code: Of an agent in a module of the user's, which code that is; found where it is not given.
    """

    later = frozenset({"motions", "worlds", "code"})

    name: Annotated[str, AfterValidator(known_agent)]
    label: Name
    settings: dict[str, Any] = Field(default_factory=dict)
    motions: int | None = Field(default=None, gt=0)
    worlds: int | None = Field(default=None, gt=0)
    code: Annotated[str, AfterValidator(code_here)] = Field(default="", validate_default=True)

    @model_validator(mode="before")
    @classmethod
    def _label_defaults_to_name(cls, data: Any) -> Any:
        if isinstance(data, str):
            data = {"name": data}
        if isinstance(data, dict) and "name" in data:
            name = data["name"]
            return {"label": name.rpartition(":")[-1] if isinstance(name, str) else name, **data}
        if not isinstance(data, dict | cls):
            raise ValueError("it must be a name or a mapping")
        return data

    @field_validator("settings")
    @classmethod
    def _seeds_are_of_runs(cls, settings: dict[str, Any]) -> dict[str, Any]:
        if "seed" in settings:
            raise ValueError("seeds are drawn from the suite's; allowed: any other setting")
        return settings


FIGURES = ("held-out", "trials")
"""How names of a scenario's figures end."""


class Suite(Model):
    """A question, and the runs that answer it: agents in scenarios and sweeps, each in every world.

    In a file `claims` is the name of another one, relative to it.

    Attributes:
        seed: Worlds, held-out trials and agents draw their seeds from it.
        first_world: If given, worlds have the seeds from this one on instead.
        required: Numbers that the project asks of itself.
    """

    later = frozenset({"first_world", "required"})

    name: Name
    question: str
    seed: int = Field(0, ge=0)
    first_world: int | None = Field(default=None, ge=0)
    worlds: int = Field(gt=0, le=1_000_000)
    scenarios: Annotated[
        tuple[ScenarioConfig, ...], Field(strict=False), AfterValidator(distinctly_named)
    ] = ()
    sweeps: tuple[SweepConfig, ...] = Field((), strict=False, validate_default=True)
    evaluation: EvaluationConfig | None = Field(
        default=EvaluationConfig(every=1_000, trials=20), validate_default=True
    )
    agents: tuple[AgentConfig, ...] = Field(min_length=1, strict=False)
    claims: tuple[Claim, ...] = Field((), strict=False, validate_default=True)
    required: tuple[Requirement, ...] = Field(default=(), strict=False, validate_default=True)

    @field_validator("sweeps")
    @classmethod
    def _something_to_run(
        cls, value: tuple[SweepConfig, ...], info: ValidationInfo
    ) -> tuple[SweepConfig, ...]:
        scenarios = info.data.get("scenarios")
        if scenarios == () == value:
            raise ValueError("there is nothing to run: neither scenarios nor sweeps are given")
        names = [part.name for part in scenarios or ()] + [sweep.name for sweep in value]
        distinct(names, "name")
        for name in names:
            if taken := [f"{name}-{figure}" for figure in FIGURES if f"{name}-{figure}" in names]:
                raise ValueError(f"{taken[0]!r} is what a figure of {name!r} is called; give it another name")
        return value

    @field_validator("agents")
    @classmethod
    def _distinct_and_known(
        cls, value: tuple[AgentConfig, ...], info: ValidationInfo
    ) -> tuple[AgentConfig, ...]:
        labels = [agent.label for agent in value]
        distinct(labels, "label")
        for part in (*info.data.get("scenarios", ()), *info.data.get("sweeps", ())):
            task = part.env.task
            for agent in value:
                if not may_import(agent.name, info) or agent.label not in (part.agents or labels):
                    continue
                if task not in agents.named(agent.name).tasks:
                    raise ValueError(
                        f"{agent.label!r} cannot {task}, as {part.name!r} asks; "
                        f"allowed: {', '.join(agents.names(task))}"
                    )
            for label in part.agents or ():
                if label not in labels:
                    hint = near_misses(label, labels)
                    raise ValueError(
                        f"{part.name!r} names the agent {label!r}, which is not here{hint}; "
                        f"allowed: {', '.join(labels)}"
                    )
        return value

    @field_validator("agents")
    @classmethod
    def _each_with_a_life(
        cls, value: tuple[AgentConfig, ...], info: ValidationInfo
    ) -> tuple[AgentConfig, ...]:
        if {"scenarios", "evaluation"} <= info.data.keys():
            _check_lives(value, info.data["scenarios"], info.data["evaluation"])
        return value

    @field_validator("evaluation")
    @classmethod
    def _within_every_lifetime(
        cls, value: EvaluationConfig | None, info: ValidationInfo
    ) -> EvaluationConfig | None:
        for scenario in info.data.get("scenarios", ()):
            if scenario.evaluation is not None:
                continue
            at_most = "" if scenario.motions is not None else "at most "
            lifetime = f"scenario {scenario.name!r} has {at_most}{scenario.most_motions} motions"
            if value is None and scenario.motions is not None:
                raise ValueError(f"{lifetime}: only lifetimes counted in trials need no held-out trials")
            if value is not None and (value.every or 0) > scenario.most_motions:
                raise ValueError(f"evaluation.every is {value.every}; {lifetime}")
            if value is not None:
                check_one_world(scenario.env, f"scenario {scenario.name!r}")
        return value

    @field_validator("claims")
    @classmethod
    def _claims_about_this_suite(cls, value: tuple[Claim, ...], info: ValidationInfo) -> tuple[Claim, ...]:
        for i, claim in enumerate(distinctly_named(value)):
            for j, criterion in enumerate(claim.criteria):
                where = f"claims.{i}.criteria.{j} ({claim.name})"
                if criterion.null_agent is None:
                    compared = {each.agent for each in criterion.trials()}
                    others = [a.label for a in info.data.get("agents", ()) if a.label not in compared]
                    raise ValueError(
                        f"{where}: no null agent, which should fail; allowed: {', '.join(others)}"
                    )
                for trials in (*criterion.trials(), *criterion.by_null().trials()):
                    _check_about(trials, info.data, where)
        return value

    @field_validator("required")
    @classmethod
    def _required_of_this_suite(
        cls, value: tuple[Requirement, ...], info: ValidationInfo
    ) -> tuple[Requirement, ...]:
        for i, requirement in enumerate(value):
            for trials in requirement.trials():
                _check_about(trials, info.data, f"required.{i}")
        return value

    def worlds_of(self, agent: AgentConfig, part: ScenarioConfig | SweepConfig) -> int:
        """How many worlds an agent meets in a scenario or sweep."""
        return agent.worlds or min(self.worlds, part.worlds or self.worlds)

    @property
    def parts(self) -> tuple[ScenarioConfig | SweepConfig, ...]:
        """Scenarios and sweeps."""
        return (*self.scenarios, *self.sweeps)

    def agents_in(self, part: ScenarioConfig | SweepConfig) -> tuple[AgentConfig, ...]:
        """Those that take part in a scenario or sweep, in the order of the suite."""
        return tuple(a for a in self.agents if part.agents is None or a.label in part.agents)

    def told(self) -> dict[str, Any]:
        """What results say of it: plain values, arms as `as_told` has them, wherever their files lie."""
        written = self.model_dump(mode="json")
        for part in (*written["scenarios"], *written["sweeps"]):
            if isinstance(arm := part["env"]["arm"], dict):
                part["env"]["arm"] = as_told(arm)
        return written

    def evaluation_of(self, scenario: ScenarioConfig) -> EvaluationConfig | None:
        """When agents are evaluated in a scenario, if ever."""
        return scenario.evaluation or self.evaluation


def _check_about(trials: TrialsOf, suite: dict[str, Any], where: str) -> None:
    """Raises ValueError where a suite, of which this is valid so far, has no such trials."""
    if not {"scenarios", "sweeps", "agents", "evaluation"} <= suite.keys():
        return
    parts = {part.name: part for part in (*suite["scenarios"], *suite["sweeps"])}
    agents = {agent.label: agent for agent in suite["agents"]}
    try:
        part = parts[one_of(trials.scenario, tuple(parts))]
        agent = agents[one_of(trials.agent, part.agents or tuple(agents))]
        lived = part if isinstance(part, SweepConfig) else part.lived_by(agent)
        _check_trials(trials, lived, getattr(part, "evaluation", None) or suite["evaluation"])
    except ValueError as error:
        raise ValueError(f"{where}: {trials.scenario}, {trials.agent}: {error}") from None


def _check_trials(
    trials: TrialsOf, part: ScenarioConfig | SweepConfig, evaluation: EvaluationConfig | None
) -> None:
    """Raises ValueError where a scenario or sweep has no such trials."""
    if isinstance(part, SweepConfig):
        if trials.value not in part.over:
            raise ValueError(f"found value {trials.value}; allowed: {', '.join(f'{v:g}' for v in part.over)}")
        return
    length, of = part.length
    if trials.value is not None:
        raise ValueError("value is of sweeps; allowed: trials, motions")
    if trials.trials and of == "trials" and trials.trials[1] > length:
        raise ValueError(f"found trials up to {trials.trials[1]}; allowed: up to {length}")
    if trials.trials and of == "motions" and trials.trials[1] > FIRST_OWN_TRIALS:
        raise ValueError(
            f"found trials up to {trials.trials[1]}; allowed: up to {FIRST_OWN_TRIALS} where the lifetime is "
            "counted in motions, for of the later ones not all are kept"
        )
    if trials.motions is not None and not evaluation:
        raise ValueError("motions is of held-out trials, and it has none; allowed: trials")
    if trials.motions is not None and trials.motions > part.most_motions:
        raise ValueError(f"found {trials.motions} motions; allowed: up to {part.most_motions}")


def _check_events(
    schedule: Sequence[dict[str, Any]], motions: int | None, trials: int | None, of: str = "a lifetime of "
) -> None:
    """Raises ValueError where a schedule is wrong, or an event is never reached in a life of this length."""
    check_reached(with_shares_as_motions(schedule, motions), {"motion": motions, "trial": trials}, of)


def _check_lives(
    agents: Sequence[AgentConfig], scenarios: Sequence[ScenarioConfig], evaluation: EvaluationConfig | None
) -> None:
    """Raises where a life of its own leads an agent nowhere, or a checkpoint is after all lives."""
    longest = {each.name: each.most_motions for each in scenarios if each.agents is None}
    for i, agent in enumerate(agents):
        mine = [each for each in scenarios if each.agents is None or agent.label in each.agents]
        if agent.motions and not any(each.motions for each in mine):
            raise ValueError(
                f"agents.{i}.motions is {agent.motions}, and {agent.label!r} is in no scenario that is "
                "counted in motions"
            )
        for each in mine:
            motions = each.motions_of(agent)
            longest[each.name] = max(longest.get(each.name, 0), motions or each.most_motions)
            if agent.motions and motions:
                of = f"the life that {agent.label!r} has in {each.name!r}, of "
                _check_events(each.perturbations, motions, None, of)
    for each in scenarios:
        when = each.evaluation or evaluation
        last = when.at[-1] if when and when.at else 0
        if last > (most := longest.get(each.name, 0)):
            raise ValueError(f"evaluation.at has {last}; lives in {each.name!r} have at most {most} motions")
