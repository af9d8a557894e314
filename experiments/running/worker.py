"""The body of one run, in a process of its own: `python -m experiments.running.worker FOLDER`."""

import os
import sys
import threading
import time
from contextlib import closing
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

import agents
from experiments.config.requirements import asked
from experiments.evaluation import TrialRecord, evaluate
from experiments.running.lifetime import Life
from experiments.running.plan import LifeRun, SweepRun
from experiments.running.results_folder import DONE, SPEC, write_json
from experiments.running.sweep_trials import sweep
from experiments.running.tensorboard_curves import Curves
from experiments.running.trial_log import TrialLog

_TOLD = 25
"""A life that is counted in trials tells how far it is each time that so many have ended."""


class Checkpoints:
    """Evaluates an agent in mid-life: on schedule, and right after a perturbation.

    Between two scheduled checkpoints there is one more at most, so that a world that is perturbed
    at every trial does not turn into one long evaluation.
    """

    def __init__(self, spec: LifeRun, life: Life, log: TrialLog, curves: Curves, tell: tuple[str, ...]):
        assert spec.evaluation is not None
        self._evaluation = spec.evaluation
        self._spec = spec
        self._life = life
        self._log = log
        self._curves = curves
        self._env = spec.scenario.env.make(tell=tell)
        self._next_scheduled = 0
        self._perturbations_seen = 0
        self._one_more_made = False
        self._last = -1

    def evaluate_if_due(self, agent: Any) -> None:
        """Evaluates where a scheduled checkpoint is reached, or the world has just been perturbed."""
        perturbations = len(self._life.perturbations)
        if self._life.motions >= self._next_scheduled:
            self._evaluate(agent)
            self._next_scheduled += self._evaluation.every
            self._perturbations_seen, self._one_more_made = perturbations, False
        elif perturbations > self._perturbations_seen and not self._one_more_made:
            self._evaluate(agent)
            self._one_more_made = True

    def finish(self, agent: Any) -> None:
        """Evaluates at the end of the life, unless that has just been done."""
        if self._last != self._life.motions:
            self._evaluate(agent)

    def _evaluate(self, agent: Any) -> None:
        held_out: Any = self._env.unwrapped
        held_out.set_world(self._life.world)
        trials = self._evaluation.trials
        records = evaluate(agent, self._env, trials, self._spec.evaluation_seed)
        for record in records:
            self._log.write("eval", self._life.motions, self._life.since_perturbation, record)
        self._curves.write("eval", self._life.motions, records)
        self._last = self._life.motions
        reached = sum(record.success for record in records)
        tell_progress(self._spec, self._life, f": {reached} of {trials} held-out trials reached")


def tell_progress(spec: LifeRun, life: Life, more: str = "") -> None:
    """Prints how far a life is, as `progress.done_by` reads it."""
    length, of = spec.work
    print(f"{of} {getattr(life, of)}/{length}{more}", flush=True)


def live(spec: LifeRun, folder: Path) -> dict[str, Any]:
    """Lets one agent live through its scenario, and logs every trial into `folder`.

    Returns:
        What the run says about itself: what the agent was told, and how its world was perturbed.
    """
    with TrialLog(folder) as log, closing(Curves(folder)) as curves:

        def log_trial(record: TrialRecord) -> None:
            log.write("train", life.motions, life.since_perturbation, record)
            curves.write("train", life.motions, [record])
            if scenario.trials is not None and life.trials % _TOLD == 0:
                tell_progress(spec, life)

        scenario = spec.scenario
        tell, settings = asked(spec.agent, scenario.env)
        env = scenario.env.make(scenario.perturbations, tell)
        life = Life(env, spec.world_seed, log_trial)
        agent = agents.make(spec.agent.name, life, seed=spec.agent_seed, **settings)
        checkpoints = Checkpoints(spec, life, log, curves, tell) if spec.evaluation else None
        if checkpoints:
            checkpoints.evaluate_if_due(agent)

        def after_motion(progress: Any) -> bool:
            if checkpoints:
                checkpoints.evaluate_if_due(agent)
            return life.trials != scenario.trials

        agent.learn(scenario.most_motions, callback=after_motion)
        length, of = spec.work
        if getattr(life, of) != length:
            raise RuntimeError(f"{spec.agent.name} made {getattr(life, of)} {of}; it was given {length}")
        if checkpoints:
            checkpoints.finish(agent)
    return {"told": list(tell), "perturbations": life.perturbations}


def main(folder: Path) -> None:
    """Makes the run that `folder` describes; DONE.json is the last thing to appear in it."""
    kinds: TypeAdapter[LifeRun | SweepRun] = TypeAdapter(LifeRun | SweepRun)
    run = kinds.validate_json((folder / SPEC).read_text(encoding="utf-8"))
    start = time.monotonic()
    outcome = sweep(run, folder) if isinstance(run, SweepRun) else live(run, folder)
    outcome["wall_seconds"] = round(time.monotonic() - start, 1)
    write_json(folder / DONE, outcome)


def _end_with_the_runner() -> None:
    """Ends this process at once when the runner that holds the other end of its input is gone."""
    sys.stdin.read()
    os._exit(1)


if __name__ == "__main__":
    threading.Thread(target=_end_with_the_runner, daemon=True).start()
    main(Path(sys.argv[1]))
