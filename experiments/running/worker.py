"""The process that makes runs, each in a copy of itself: `python -m experiments.running.worker`."""

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
from experiments.evaluation import TrialRecord
from experiments.running.checkpoints import Checkpoints, Recorder, print_progress
from experiments.running.cpu_time import CPU, CpuTimes
from experiments.running.lifetime import LifetimeRecorder
from experiments.running.process import ENDED
from experiments.running.results_folder import DONE, RUN, TIMINGS, write_json
from experiments.running.rows import RowsRecorder
from experiments.running.run import LifetimeRun, SweepRun, parse_run
from experiments.running.sweep_trials import run_sweep
from experiments.running.tensorboard_curves import Curves
from experiments.running.trial_log import TrialLog

_PROGRESS_EVERY = 2.0
"""Seconds after which a lifetime prints how far it is."""


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

        scenario, said = spec.scenario, time.monotonic()
        privileged, settings, rows, known = requirements(spec.agent, scenario.env)
        recorder: Any = _recorder(spec, privileged, rows, log_trial)
        times.watch(recorder, "environment", "reset", "step")
        agent = agents.make(spec.agent.name, recorder, seed=spec.agent_seed, **settings)
        checkpoints = (
            Checkpoints(spec, agent, rows, recorder, log, curves, times) if spec.evaluation else None
        )
        recorder.onlooker = checkpoints or recorder.onlooker

        def after_motion(progress: Any) -> bool:
            nonlocal said
            if time.monotonic() > said + _PROGRESS_EVERY:
                print_progress(spec, recorder)
                said = time.monotonic()
            return scenario.trials is None or recorder.trials < scenario.trials

        length, of = spec.work
        with times.of("learning"):
            agent.learn(scenario.most_motions, callback=after_motion)
        if (made := getattr(recorder, of)) != length:
            raise RuntimeError(f"{spec.agent.name} made {made} {of}; it was given {length}")
        if checkpoints:
            checkpoints.finish()
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
    run = parse_run((folder / RUN).read_text(encoding="utf-8"))
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
        copy = os.fork() if sys.platform == "linux" else 0
        if not copy:
            threading.Thread(target=end_with_the_parent, daemon=True).start()
            main(Path(line.rstrip("\n")))
            sys.stdout.flush()
            os._exit(0)  # all is written; to take a copy apart takes longer than a short run
        _, status = os.waitpid(copy, 0)
        print(f"{ENDED}{os.waitstatus_to_exitcode(status)}", flush=True)


if __name__ == "__main__":
    serve()
