"""How long runs take where kept results were made: by the times that stand beside these."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
from pydantic import ValidationError

from calfree_gym.robot.arms.arm import MOVEMASTER_NAME
from experiments.config.environment import EnvironmentConfig
from experiments.config.life import EvaluationConfig
from experiments.config.suite import ScenarioConfig, Suite, SweepConfig
from experiments.errors import ConfigError
from experiments.running.finished import RESULTS, TIMES, read_about, read_times
from experiments.running.run import LifetimeRun, Run, SweepRun
from experiments.running.versions import REPOSITORY

KEPT = REPOSITORY / "experiments" / "results"
_COSTS = ("other", "decision", "learning")
_UNKNOWN = {"motions": (2e-4, 5e-4, 1e-3), "trials": (2e-2, 0.0, 0.0)}
"""Seconds where nothing alike is kept. Choice."""
_REACH = 5
"""Motions of a held-out trial. Choice."""


class Work(NamedTuple):
    """What a run does.

    Attributes:
        agent: Its name, not its label.
        env: What its environment's pace depends on.
        unit: What its life is counted in: "motions" or "trials".
        own: So many of them.
        held_out: Motions in held-out trials, about.
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
        rows = [
            [*work[:3], *costs] for path in sorted(kept.glob(f"*/{TIMES}")) for work, costs in _measured(path)
        ]
        self._known: dict[Work, float] = {}
        self._costs = pd.DataFrame(rows, columns=["agent", "env", "unit", *_COSTS])

    def seconds(self, run: Run) -> float:
        """What a run takes where kept times were made: by its agent in such an environment, or one alike."""
        work = work_of(run)
        if work not in self._known:
            self._known[work] = self._seconds(work)
        return self._known[work]

    def _seconds(self, work: Work) -> float:
        same = {key: self._costs[key] == getattr(work, key) for key in ("agent", "unit")}
        env = self._costs["env"].map(lambda each: each == work.env).astype(bool)
        for alike in (same["agent"] & env, same["agent"], env, same["unit"] | ~same["unit"]):
            found = self._costs[alike & same["unit"]]
            if len(found):
                return work.seconds(found[list(_COSTS)].median().to_list())
        return work.seconds(_UNKNOWN[work.unit])


def work_of(run: Run) -> Work:
    """What a run does."""
    if isinstance(run, SweepRun):
        return _of_sweep(run.agent.name, run.sweep, len(run.world_seeds))
    assert isinstance(run, LifetimeRun)
    return _of_life(run.agent.name, run.scenario, run.evaluation)


def _of_sweep(agent: str, sweep: SweepConfig, worlds: int) -> Work:
    return Work(agent, _env(sweep.env), "trials", len(sweep.over) * worlds, 0)


def _of_life(agent: str, scenario: ScenarioConfig, evaluation: EvaluationConfig | None) -> Work:
    own, unit = scenario.length
    held_out = 0
    if evaluation:
        once = sum("at" in each for each in scenario.perturbations)
        stretches = 1 + once if evaluation.begins_anew else 1
        scheduled = len(evaluation.offsets(scenario.most_motions // stretches)) * stretches
        held_out = (scheduled + 2 * once + 1) * evaluation.trials * _REACH
    return Work(agent, _env(scenario.env), unit, own, held_out)


def _env(env: EnvironmentConfig) -> tuple[Any, ...]:
    task = env.id.removeprefix("CalFree/").partition("-")[0].removesuffix("Dense")
    return task, env.dynamics, env.observation, env.arm == MOVEMASTER_NAME


def _measured(times: Path) -> Iterator[tuple[Work, tuple[float, float, float]]]:
    """What the runs of a kept suite did, and what that cost: medians over worlds."""
    works = _works_kept(times.with_name(RESULTS))
    rows = read_times(times).fillna({"decision": 0.0, "learning": 0.0})
    names = rows.pop("run").str.rsplit("-", n=1).str[0]  # without the hash
    of_lives = names.str.rsplit("-", n=1).str[0]  # nor the world, which sweeps have not
    for name, (wall, decision, learning) in (
        rows.groupby(names.where(names.isin(works), of_lives)).median().iterrows()
    ):
        if work := works.get(str(name)):
            if work.unit == "trials":  # whose motions are not known
                decision = learning = 0.0
            spent = work.seconds((0.0, decision, learning))
            yield work, (max(wall - spent, 0.0) / (work.own + work.held_out), decision, learning)


def _works_kept(results: Path) -> dict[str, Work]:
    """What the runs of a kept suite did, by how their names begin; nothing of one that cannot be read now."""
    try:
        suite = Suite.model_validate(read_about(results)["suite"])
    except (ConfigError, KeyError, ValidationError):
        return {}
    found = {}
    for part in suite.parts:
        for agent in suite.agents_in(part):
            found[f"{part.name}-{agent.label}"] = (
                _of_sweep(agent.name, part, suite.worlds_of(agent.label))
                if isinstance(part, SweepConfig)
                else _of_life(agent.name, part.lived_by(agent), suite.evaluation_of(part))
            )
    return found
