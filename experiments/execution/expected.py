"""How long runs take where kept results were made: by the times that stand beside these."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
from pydantic import ValidationError

from calfree_gym.robot.arms.arm import MOVEMASTER_NAME
from experiments.config.life import EvaluationConfig
from experiments.config.suite import AgentConfig, ScenarioConfig, SweepConfig
from experiments.errors import ConfigError
from experiments.running.finished import RESULTS, TIMED, TIMES, read_about, read_times
from experiments.running.results_folder import suite_written_down
from experiments.running.run import LifetimeRun, Run, SweepRun
from experiments.running.versions import REPOSITORY

KEPT = REPOSITORY / "experiments" / "results"
_COSTS = ("other", "decision", "learning")
_UNKNOWN = {"motions": (2e-4, 5e-4, 1e-3), "trials": (2e-2, 0.0, 0.0)}
"""Seconds where nothing alike is kept. Choice."""
_REACH = 5
"""Motions of a held-out trial. Choice."""


class Work(NamedTuple):
    """What a run does: so many of its `own` "motions" or "trials", and about so many `held_out` motions.

    The agent is told by its name, not its label; `env` is what its environment's pace depends on.
    """

    agent: str
    env: tuple[Any, ...]
    unit: str
    own: int
    held_out: int

    def seconds(self, costs: Sequence[float]) -> float:
        """What it takes at costs in the order of `_COSTS`: other time, decisions, learning."""
        other, decision, learning = costs
        return self.own * (other + learning) + self.held_out * (other + decision)


class KeptTimes:
    """Seconds by agent and kind of environment, from all kept results."""

    def __init__(self, kept: Path = KEPT):
        measured = (each for path in sorted(kept.glob(f"*/{TIMES}")) for each in _measured(path))
        rows = [[*work[:3], *costs] for work, costs in measured]
        self._known: dict[Work, float] = {}
        self._costs = pd.DataFrame(rows, columns=["agent", "env", "unit", *_COSTS])

    def seconds(self, run: Run) -> float:
        """What a run takes where kept times were made: by its agent in such an environment, or one alike."""
        if isinstance(run, SweepRun):
            work = _work(run.agent, run.sweep, None, len(run.world_seeds))
        else:
            assert isinstance(run, LifetimeRun)
            work = _work(run.agent, run.scenario, run.evaluation, 1)
        if work not in self._known:
            self._known[work] = self._seconds(work)
        return self._known[work]

    def _seconds(self, work: Work) -> float:
        same = {key: self._costs[key] == getattr(work, key) for key in ("agent", "unit")}
        env = self._costs["env"].map(lambda each: each == work.env).astype(bool)
        for alike in (same["agent"] & env, same["agent"], env, same["unit"]):
            found = self._costs[alike & same["unit"]]
            if len(found):
                return work.seconds(found[list(_COSTS)].median().to_list())
        return work.seconds(_UNKNOWN[work.unit])


def _work(
    agent: AgentConfig, part: ScenarioConfig | SweepConfig, evaluation: EvaluationConfig | None, worlds: int
) -> Work:
    """What an agent's run does: a life as the agent lives it, or a sweep over so many worlds."""
    task = part.env.id.removeprefix("CalFree/").partition("-")[0].removesuffix("Dense")
    env = task, part.env.dynamics, part.env.observation, part.env.arm == MOVEMASTER_NAME
    if isinstance(part, SweepConfig):
        return Work(agent.name, env, "trials", len(part.over) * worlds, 0)
    own, unit = part.length
    held_out = 0
    if evaluation:
        once = sum("at" in each for each in part.perturbations)
        stretches = 1 + once if evaluation.begins_anew else 1
        scheduled = len(evaluation.offsets(part.most_motions // stretches)) * stretches
        held_out = (scheduled + 2 * once + 1) * evaluation.trials * _REACH
    return Work(agent.name, env, unit, own, held_out)


def _measured(times: Path) -> Iterator[tuple[Work, tuple[float, float, float]]]:
    """What the runs of a kept suite did, and what that cost: medians over worlds.

    Nothing of a suite that cannot be read now.
    """
    try:
        suite = suite_written_down(read_about(times.with_name(RESULTS))["suite"])
    except (ConfigError, KeyError, ValidationError):
        return
    rows = read_times(times).fillna({"decision": 0.0, "learning": 0.0})
    for part in suite.parts:
        for agent in suite.agents_in(part):
            name = re.escape(f"{part.name}-{agent.label}")
            mine = rows[rows["run"].str.fullmatch(rf"{name}(-\d+)?-[0-9a-f]+")]  # a sweep has no world
            if mine.empty:
                continue
            wall, decision, learning = mine[[*TIMED[1:]]].median()
            if isinstance(part, SweepConfig):
                work = _work(agent, part, None, suite.worlds_of(agent, part))
            else:
                work = _work(agent, part.lived_by(agent), suite.evaluation_of(part), 1)
            if work.unit == "trials":  # whose motions are not known
                decision = learning = 0.0
            spent = work.seconds((0.0, decision, learning))
            yield work, (max(wall - spent, 0.0) / (work.own + work.held_out), decision, learning)
