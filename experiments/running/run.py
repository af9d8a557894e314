"""The runs of a suite, each with its seeds and a name made from everything that defines it."""

import hashlib
import json
from typing import Any

import numpy as np

from calfree_gym.robot.arms.arm import MOVEMASTER_NAME
from experiments.config.environment import digest
from experiments.config.life import EvaluationConfig
from experiments.config.suite import AgentConfig, Model, ScenarioConfig, Suite, SweepConfig

_WORLD, _EVALUATION, _AGENT = range(3)


class Run(Model):
    """What one process makes. Equal contents have equal ids."""

    agent: AgentConfig
    agent_seed: int

    @property
    def where(self) -> dict[str, Any]:
        """What all its rows of the results have in common."""
        raise NotImplementedError

    @property
    def work(self) -> tuple[int, str]:
        """How much there is to do, and of what."""
        raise NotImplementedError

    @property
    def id(self) -> str:
        """A name for the run's folder: readable words, then the hash of the whole content.

        An arm stands in it by its digest, wherever its files are; the built-in one does not stand in it.
        """
        content = json.dumps(_with_digests(self.model_dump(mode="json")), sort_keys=True)
        digest = hashlib.sha256(content.encode()).hexdigest()[:12]
        return "-".join([*map(str, self.where.values()), digest])


class LifetimeRun(Run):
    """One lifetime: an agent in a scenario in one world.

    Attributes:
        scenario: As the agent lives it, see `ScenarioConfig.lived_by`.
        world: Index of the world; the same for all agents that are compared in it.
        world_seed: Seeds the world, its objects and its noise.
    """

    scenario: ScenarioConfig
    evaluation: EvaluationConfig | None
    world: int
    world_seed: int
    evaluation_seed: int

    @property
    def where(self) -> dict[str, Any]:
        """See `Run`."""
        return {"scenario": self.scenario.name, "agent": self.agent.label, "world": self.world}

    @property
    def work(self) -> tuple[int, str]:
        """See `Run`."""
        return self.scenario.length


class SweepRun(Run):
    """One agent at every value of a sweep, in every world.

    Attributes:
        world_seeds: Of worlds, their objects and their noise; the same at all values, for all agents.
    """

    sweep: SweepConfig
    world_seeds: tuple[int, ...]

    @property
    def where(self) -> dict[str, Any]:
        """See `Run`."""
        return {"scenario": self.sweep.name, "agent": self.agent.label}

    @property
    def work(self) -> tuple[int, str]:
        """See `Run`."""
        return len(self.sweep.over) * len(self.world_seeds), "trials"


def parse_run(text: str | bytes) -> LifetimeRun | SweepRun:
    """Reads what `model_dump_json` of a run wrote."""
    kind: type[LifetimeRun | SweepRun] = SweepRun if "sweep" in json.loads(text) else LifetimeRun
    return kind.model_validate_json(text)


def runs_of(suite: Suite) -> list[Run]:
    """All runs of a suite, agent by agent."""
    return [*_lifetimes(suite), *_sweeps(suite)]


def world_seeds(suite_seed: int, worlds: int, first: int | None = None) -> tuple[int, ...]:
    """What seeds the worlds of a suite, in their order: from `first` on where that is given."""
    if first is not None:
        return tuple(range(first, first + worlds))
    return tuple(_seed(suite_seed, _WORLD, world) for world in range(worlds))


def _worlds(suite: Suite, agent: AgentConfig, part: ScenarioConfig | SweepConfig) -> tuple[int, ...]:
    """What seeds the worlds that an agent meets in a scenario or sweep."""
    return world_seeds(suite.seed, suite.worlds_of(agent, part), suite.first_world)


def _alone(agent: AgentConfig) -> AgentConfig:
    """Without what stands in its runs already."""
    return agent.model_copy(update={"motions": None, "worlds": None})


def _with_digests(content: dict[str, Any]) -> dict[str, Any]:
    (part,) = (content[key] for key in ("scenario", "sweep") if key in content)
    arm = part["env"].pop("arm")
    if arm != MOVEMASTER_NAME:
        part["env"]["arm"] = digest(arm)
    return content


def _lifetimes(suite: Suite) -> list[LifetimeRun]:
    return [
        LifetimeRun(
            agent=_alone(agent),
            scenario=scenario.lived_by(agent),
            evaluation=suite.evaluation_of(scenario),
            world=world,
            world_seed=seed,
            evaluation_seed=_seed(suite.seed, _EVALUATION, world),
            agent_seed=_seed(suite.seed, _AGENT, world),
        )
        for scenario in suite.scenarios
        for agent in suite.agents_in(scenario)
        for world, seed in enumerate(_worlds(suite, agent, scenario))
    ]


def _sweeps(suite: Suite) -> list[SweepRun]:
    return [
        SweepRun(
            agent=_alone(agent),
            sweep=sweep.model_copy(update={"agents": None, "worlds": None}),
            world_seeds=_worlds(suite, agent, sweep),
            agent_seed=_seed(suite.seed, _AGENT, 0),
        )
        for sweep in suite.sweeps
        for agent in suite.agents_in(sweep)
    ]


def _seed(suite_seed: int, stream: int, world: int) -> int:
    sequence = np.random.SeedSequence(suite_seed, spawn_key=(stream, world))
    return int(sequence.generate_state(1)[0])
