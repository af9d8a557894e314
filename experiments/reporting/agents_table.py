"""The table of all agents in docs/agents.md: what each does, and what it must know."""

from functools import cache

import pandas as pd

import agents
from agents.base.registration import AGENTS
from experiments.config.environment import EnvironmentConfig
from experiments.config.requirements import requirements
from experiments.config.suite import AgentConfig
from experiments.reporting.tables import Table, must_know


@cache
def agents_table() -> Table:
    """One row an agent, from the code alone."""
    nominal = {"id": "CalFree/Reach-v0", "world": "nominal", "camera_mount": "stand"}
    env = EnvironmentConfig.model_validate(nominal)
    rows = []
    for name in agents.names():
        required = requirements(AgentConfig(name=name, label=name), env)
        known = must_know(required.privileged, required.prior_knowledge)
        rows.append((f"[`{name}`](agent-settings.md#{name})", AGENTS[name].does, known))
    columns = ["agent", "what it does", "what it must know"]
    return Table("agents", "Agents", pd.DataFrame(rows, columns=columns))
