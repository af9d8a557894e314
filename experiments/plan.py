"""The runs of a suite, each with its seeds and a name made from everything that defines it."""

import hashlib
import json

import numpy as np

from experiments.config import AgentConfig, EvaluationConfig, Model, ScenarioConfig, Suite

_WORLD, _EVALUATION, _AGENT = range(3)


class RunSpec(Model):
    """One life: an agent in a scenario in one world. Equal contents have equal ids.

    Attributes:
        agent: Which agent, with which settings.
        scenario: Where it lives, and how its world is perturbed.
        evaluation: When it is evaluated.
        world: Index of the world; the same for all agents that are compared in it.
        world_seed: Seeds the world, its objects and its noise.
        evaluation_seed: Seeds the held-out trials.
        agent_seed: Seeds what the agent draws by itself.
    """

    agent: AgentConfig
    scenario: ScenarioConfig
    evaluation: EvaluationConfig
    world: int
    world_seed: int
    evaluation_seed: int
    agent_seed: int

    @property
    def id(self) -> str:
        """A name for the run's folder: readable words, then the hash of the whole content."""
        content = json.dumps(self.model_dump(mode="json"), sort_keys=True)
        digest = hashlib.sha256(content.encode()).hexdigest()[:12]
        return f"{self.scenario.name}-{self.agent.label}-{self.world}-{digest}"


def runs_of(suite: Suite) -> list[RunSpec]:
    """All runs of a suite, agent by agent."""
    return [
        RunSpec(
            agent=agent,
            scenario=scenario,
            evaluation=suite.evaluation,
            world=world,
            world_seed=_seed(suite.seed, _WORLD, world),
            evaluation_seed=_seed(suite.seed, _EVALUATION, world),
            agent_seed=_seed(suite.seed, _AGENT, world),
        )
        for scenario in suite.scenarios
        for agent in suite.agents
        for world in range(suite.worlds)
    ]


def _seed(suite_seed: int, stream: int, world: int) -> int:
    sequence = np.random.SeedSequence(suite_seed, spawn_key=(stream, world))
    return int(sequence.generate_state(1)[0])
