"""The bodies of runs, each in a process of its own: `python -m experiments.running.worker`."""

import os
import sys
import threading
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import agents
from experiments.config.requirements import requirements
from experiments.evaluation import TrialRecord, evaluate
from experiments.running.cpu_time import CPU, CpuTimes, TimedPredictor
from experiments.running.lifetime import LifetimeRecorder
from experiments.running.plan import LifetimeRun, SweepRun, parse_run
from experiments.running.results_folder import DONE, ENDED, SPEC, TIMINGS, write_json
from experiments.running.rows import RowsRecorder
from experiments.running.sweep_trials import run_sweep
from experiments.running.tensorboard_curves import Curves
from experiments.running.trial_log import TrialLog

Recorder = LifetimeRecorder | RowsRecorder
_PROGRESS_EVERY = 25
"""A lifetime that is counted in trials prints its progress each time that this many have ended."""


class Checkpoints:
    """Evaluates an agent during its lifetime: on schedule, and right after a perturbation.

    Between two scheduled checkpoints there is one more at most, so that a world that is perturbed
    at every trial does not turn into one long evaluation.
    """

    def __init__(
        self,
        spec: LifetimeRun,
        recorder: Recorder,
        log: TrialLog,
        curves: Curves,
        privileged: tuple[str, ...],
        times: CpuTimes,
    ):
        assert spec.evaluation is not None
        self._evaluation = spec.evaluation
        self._spec = spec
        self._recorder = recorder
        self._log = log
        self._curves = curves
        self._times = times
        self._env = spec.scenario.env.make(tell=privileged)
        self._next_scheduled = 0
        self._perturbations_seen = 0
        self._one_more_made = False
        self._last = -1

    def evaluate_if_due(self, agent: Any) -> None:
        """Evaluates where a scheduled checkpoint is reached, or the world has just been perturbed."""
        perturbations = len(self._recorder.perturbations)
        if self._recorder.motions >= self._next_scheduled:
            self._evaluate(agent)
            self._next_scheduled += self._evaluation.every
            self._perturbations_seen, self._one_more_made = perturbations, False
        elif perturbations > self._perturbations_seen and not self._one_more_made:
            self._evaluate(agent)
            self._one_more_made = True

    def finish(self, agent: Any) -> None:
        """Evaluates at the end of the lifetime, unless that has just been done."""
        if self._last != self._recorder.motions:
            self._evaluate(agent)

    def _evaluate(self, agent: Any) -> None:
        held_out: Any = self._env.unwrapped
        held_out.set_world(self._recorder.world)
        trials = self._evaluation.trials
        with self._times.of("evaluation"):
            timed = TimedPredictor(agent, self._times)
            records = evaluate(timed, self._env, trials, self._spec.evaluation_seed)
        for record in records:
            self._log.write("eval", self._recorder.motions, self._recorder.since_perturbation, record)
        self._curves.write("eval", self._recorder.motions, records)
        self._last = self._recorder.motions
        reached = sum(record.rendezvous for record in records)
        print_progress(self._spec, self._recorder, f": {reached} of {trials} held-out trials reached")


def print_progress(spec: LifetimeRun, recorder: Recorder, more: str = "") -> None:
    """Prints how far a lifetime is, as `progress.made_in` reads it."""
    length, of = spec.work
    print(f"{of} {getattr(recorder, of)}/{length}{more}", flush=True)


def run_lifetime(spec: LifetimeRun, folder: Path, times: CpuTimes) -> tuple[dict[str, Any], int]:
    """Makes one agent's lifetime in its scenario, and logs every trial into `folder`.

    Args:
        spec: The run.
        folder: Of the run.
        times: Counts CPU seconds.

    Returns:
        What the run says about itself: the agent's privileged observations, what it is built on, and how
        its world was perturbed. And the motions from which it learned.
    """
    with TrialLog(folder) as log, closing(Curves(folder)) as curves:

        def log_trial(record: TrialRecord) -> None:
            log.write("train", recorder.motions, recorder.since_perturbation, record)
            curves.add_own(recorder.motions, record)
            if scenario.trials is not None and recorder.trials % _PROGRESS_EVERY == 0:
                print_progress(spec, recorder)

        scenario = spec.scenario
        privileged, settings, rows, known = requirements(spec.agent, scenario.env)
        recorder: Any = _recorder(spec, privileged, rows, log_trial)
        times.watch(recorder, "environment", "reset", "step")
        agent = agents.make(spec.agent.name, recorder, seed=spec.agent_seed, **settings)
        checkpoints = Checkpoints(spec, recorder, log, curves, privileged, times) if spec.evaluation else None
        if checkpoints:
            checkpoints.evaluate_if_due(agent)

        def after_motion(progress: Any) -> bool:
            if checkpoints:
                checkpoints.evaluate_if_due(agent)
            return scenario.trials is None or recorder.trials < scenario.trials

        length, of = spec.work
        with times.of("learning"):
            agent.learn(scenario.most_motions, callback=after_motion)
        if abs(getattr(recorder, of) - length) >= rows:  # rows move together
            raise RuntimeError(f"{spec.agent.name} made {getattr(recorder, of)} {of}; it was given {length}")
        if checkpoints:
            checkpoints.finish(agent)
    outcome = {
        "privileged": list(privileged),
        "prior_knowledge": list(known),
        "perturbations": recorder.perturbations,
    }
    return outcome, recorder.motions


def _recorder(
    spec: LifetimeRun, privileged: tuple[str, ...], rows: int, on_trial: Callable[[TrialRecord], None]
) -> Recorder:
    """The environment of the agent's lifetime, of one arm or of rows."""
    scenario = spec.scenario
    if rows > 1:
        return RowsRecorder(scenario.env, rows, privileged, scenario.perturbations, spec.world_seed, on_trial)
    env = scenario.env.make(scenario.perturbations, privileged)
    return LifetimeRecorder(env, spec.world_seed, on_trial)


def main(folder: Path) -> None:
    """Makes the run that `folder` describes; DONE.json is the last thing to appear in it.

    But for what it took, which stands in timings.json, a run leaves the same in each repetition.
    """
    run = parse_run((folder / SPEC).read_text(encoding="utf-8"))
    start, times = time.monotonic(), CpuTimes()
    if isinstance(run, SweepRun):
        outcome, learned = run_sweep(run, folder, times), 0
    else:
        outcome, learned = run_lifetime(run, folder, times)
    wall = round(time.monotonic() - start, 1)
    write_json(folder / TIMINGS, {"wall_seconds": wall, CPU: times.a_motion(learned)})
    write_json(folder / DONE, outcome)


def end_with_the_parent() -> None:
    """Ends this process at once when the one that holds the other end of its input is gone."""
    sys.stdin.read()
    os._exit(1)


def serve() -> None:
    """Makes the runs whose folders stand on the lines of its input, each in a copy of this process.

    So what they need is imported once. Where copies of processes are not as good as fresh ones (macOS), or
    there are none (Windows), this process makes one run itself, and ends.
    """
    for line in sys.stdin:
        body = os.fork() if sys.platform == "linux" else 0
        if not body:
            threading.Thread(target=end_with_the_parent, daemon=True).start()
            main(Path(line.rstrip("\n")))
            sys.stdout.flush()
            os._exit(0)  # all is written; to take a copy apart takes longer than a short run
        _, status = os.waitpid(body, 0)
        print(f"{ENDED}{os.waitstatus_to_exitcode(status)}", flush=True)


if __name__ == "__main__":
    serve()
