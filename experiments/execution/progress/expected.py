"""How long runs take where kept results were made: by the times that stand beside these."""

import base64
import json
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
import pyarrow.parquet as pq

from calfree_gym.robot.arms.arm import MOVEMASTER_NAME
from experiments.config.evaluation import EvaluationConfig
from experiments.running.plan import LifetimeRun, Run
from experiments.running.versions import REPOSITORY

KEPT = REPOSITORY / "experiments" / "results"
_RESULTS, _TIMES = "results.parquet", "timings.csv"
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
    """Seconds by agent and kind of environment, from all kept results.

    Args:
        kept: Their folder.
    """

    def __init__(self, kept: Path = KEPT):
        rows = [
            [*work[:3], *costs]
            for path in sorted(kept.glob(f"*/{_TIMES}"))
            for work, costs in _measured(path)
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
    amount, unit = run.work
    if not isinstance(run, LifetimeRun):
        return Work(run.agent.name, _env(run.model_dump(mode="json")["sweep"]["env"]), unit, amount, 0)
    env = run.scenario.env
    held_out = _held_out(run.evaluation, run.scenario.most_motions, run.scenario.perturbations)
    return Work(run.agent.name, _env(env.model_dump()), unit, amount, held_out)


def _measured(times: Path) -> Iterator[tuple[Work, tuple[float, float, float]]]:
    """What the runs of a kept suite did, and what that cost: medians over worlds."""
    works = _works_kept(times.with_name(_RESULTS))
    rows = pd.read_csv(times).fillna({"decision": 0.0, "learning": 0.0})
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
    """What the runs of a kept suite did, by how their names begin."""
    try:
        packed = pq.read_metadata(results).metadata[b"calfree"]
        suite = json.loads(zlib.decompress(base64.b64decode(packed)))["suite"]
    except (OSError, KeyError, ValueError, TypeError, zlib.error):
        return {}
    found = {}
    for agent in suite["agents"]:
        for part in suite["scenarios"]:
            motions = part["motions"] and (agent.get("motions") or part["motions"])
            most = motions or part["trials"] * part["env"]["max_episode_steps"]
            when = part.get("evaluation") or suite["evaluation"]
            evaluation = when and EvaluationConfig.model_validate(when)
            held_out = _held_out(evaluation, most, part["perturbations"])
            unit, own = ("motions", motions) if motions else ("trials", part["trials"])
            work = Work(agent["name"], _env(part["env"]), unit, own, held_out)
            found[f"{part['name']}-{agent['label']}"] = work
        for part in suite["sweeps"]:
            own = len(part["over"]) * (agent.get("worlds") or suite["worlds"])
            work = Work(agent["name"], _env(part["env"]), "trials", own, 0)
            found[f"{part['name']}-{agent['label']}"] = work
    return found


def _env(env: Mapping[str, Any]) -> tuple[Any, ...]:
    task = str(env["id"]).removeprefix("CalFree/").partition("-")[0].removesuffix("Dense")
    built_in = env.get("arm", MOVEMASTER_NAME) == MOVEMASTER_NAME
    return task, env.get("dynamics"), env.get("observation", "points"), built_in


def _held_out(evaluation: EvaluationConfig | None, motions: int, schedule: Sequence[Any]) -> int:
    """About how many motions a life's held-out trials have."""
    if evaluation is None:
        return 0
    once = sum("at" in each for each in schedule)
    stretches = 1 + once if evaluation.begins_anew else 1
    checkpoints = len(evaluation.offsets(motions // stretches)) * stretches + 2 * once + 1
    return checkpoints * evaluation.trials * _REACH
