"""The process that makes runs, each in a copy of itself: `python -m experiments.running.worker`."""

import hashlib
import json
import os
import sys
import threading
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium

import agents
from calfree_gym import World
from calfree_gym.perturbations import parse_schedule
from calfree_gym.perturbations.schedule import Event
from experiments.config.requirements import requirements
from experiments.evaluation import TrialRecord, evaluate
from experiments.running.cpu_time import CPU, CpuTimes, TimedPredictor
from experiments.running.lifetime import LifetimeRecorder, Onlooker, RowsRecorder
from experiments.running.process import ENDED, OVER_BUDGET
from experiments.running.records import Curves, TrialLog
from experiments.running.results_folder import DONE, RUN, TIMINGS, write_json
from experiments.running.run import LifetimeRun, SweepRun, parse_run

Recorder = LifetimeRecorder | RowsRecorder


_PROGRESS_EVERY = 2.0
"""Seconds after which a lifetime prints how far it is."""


def run_lifetime(run: LifetimeRun, folder: Path, times: CpuTimes) -> tuple[dict[str, Any], int]:
    """Makes one agent's lifetime in its scenario, and logs every trial into `folder`.

    Returns what the run says about itself, and the motions from which the agent learned.
    """
    with closing(TrialLog(folder)) as log, closing(Curves(folder)) as curves:

        def log_trial(record: TrialRecord) -> None:
            log.write("train", recorder.motions, recorder.since_perturbation, record)
            curves.add_own(recorder.motions, record)

        scenario, said = run.scenario, time.monotonic()
        privileged, settings, rows, known = requirements(run.agent, scenario.env)
        recorder: Any = _recorder(run, privileged, rows, log_trial)
        world = recorder.world
        times.watch(recorder, "environment", "reset", "step")
        agent = agents.make(run.agent.name, recorder, seed=run.agent_seed, **settings)
        checkpoints = Checkpoints(run, agent, rows, recorder, log, curves, times) if run.evaluation else None
        recorder.onlooker = checkpoints or recorder.onlooker

        def after_motion(progress: Any) -> bool:
            nonlocal said
            if time.monotonic() > said + _PROGRESS_EVERY:
                print_progress(run, recorder)
                said = time.monotonic()
            return scenario.trials is None or recorder.trials < scenario.trials

        length, of = run.work
        with times.of("learning"):
            agent.learn(scenario.most_motions, callback=after_motion)
        if (made := getattr(recorder, of)) != length:
            raise RuntimeError(f"{run.agent.name} made {made} {of}; it was given {length}")
        if checkpoints:
            checkpoints.evaluate()
    outcome = {
        "privileged": list(privileged),
        "prior_knowledge": list(known),
        "perturbations": recorder.perturbations,
        "met": _met(run, world, [drawn for *_, drawn in recorder.perturbations]),
    }
    return outcome, recorder.motions


def _met(run: LifetimeRun, world: World, drawn: list[dict[str, Any]]) -> str:
    """A digest of the world in which a life began, and of what changes it met, where each comes once.

    Whoever is compared must have met the same. Numbers count to nine digits, whichever machine drew them.
    """
    once = not any(event.every for event in parse_schedule(list(run.scenario.perturbations)))
    told = json.dumps([world.to_dict(), sorted(drawn, key=json.dumps) if once else []])
    rounded = json.loads(told, parse_float=lambda number: float(f"{float(number):.9g}"))
    return hashlib.sha256(json.dumps(rounded).encode()).hexdigest()[:12]


def _recorder(
    run: LifetimeRun, privileged: tuple[str, ...], rows: int, on_trial: Callable[[TrialRecord], None]
) -> Recorder:
    """The environment of the agent's lifetime, of one arm or of rows."""
    scenario = run.scenario
    if rows > 1:
        return RowsRecorder(scenario.env, rows, privileged, scenario.perturbations, run.world_seed, on_trial)
    env = scenario.env.make(scenario.perturbations, privileged)
    return LifetimeRecorder(env, run.world_seed, on_trial, scenario.places)


@dataclass
class Checkpoints(Onlooker):
    """Evaluates an agent on schedule, and right before and after a perturbation, without learning in between.

    Where one comes again and again, this is done once between two scheduled checkpoints or changes that come
    once, so that a world that is perturbed at every trial does not turn into one long evaluation.
    """

    run: LifetimeRun
    agent: Any
    rows: int
    recorder: Recorder
    log: TrialLog
    curves: Curves
    times: CpuTimes

    def __post_init__(self) -> None:
        run = self.run
        assert run.evaluation is not None
        self._evaluation = run.evaluation
        self._env = run.scenario.env.make(tell=self.agent.privileged)
        self._once = [
            event
            for event in parse_schedule(list(run.scenario.perturbations))
            if not event.every and (event.clock, event.at) != ("trial", 0)  # with which the life began
        ]
        self._scheduled: set[int] = set()
        self._schedule()
        self._again = False
        self._last: tuple[int, int] | None = None

    def before_motion(self) -> None:
        """Evaluates where a scheduled checkpoint is reached."""
        if self.recorder.motions in self._scheduled:
            self._again = False
            self.evaluate()

    def before_change(self, trial: int) -> None:
        """Evaluates in the world as it still is."""
        if not self._again or len(self._ahead(trial)) < len(self._once):
            self.evaluate()

    def after_change(self) -> None:
        """Evaluates in the changed world; from a change that comes once, checkpoints are counted anew."""
        _, trial, _ = self.recorder.perturbations[-1]
        ahead = self._ahead(trial)
        once, self._once = len(ahead) < len(self._once), ahead
        if once and self._evaluation.begins_anew:
            self._schedule()
        if once or not self._again:
            self.evaluate()
        self._again = not once

    def _ahead(self, trial: int) -> list[Event]:
        """What comes once, and after this moment."""
        counts = {"motion": self.recorder.motions, "trial": trial}
        return [event for event in self._once if event.at > counts[event.clock]]

    def _schedule(self) -> None:
        """Adds the checkpoints that are counted from now on."""
        now = self.recorder.motions
        left = self.run.scenario.most_motions - now
        self._scheduled |= {now + offset for offset in self._evaluation.offsets(left, self.rows)}

    def evaluate(self) -> None:
        """Makes the held-out trials, unless that has been done in this moment and world."""
        recorder = self.recorder
        self._scheduled.discard(recorder.motions)
        if self._last == (now := (recorder.motions, len(recorder.perturbations))):
            return
        self._last = now
        held_out: Any = self._env.unwrapped
        held_out.set_world(recorder.world)
        trials = self._evaluation.trials
        with self.times.of("evaluation"):
            timed = TimedPredictor(self.agent, self.times)
            records = evaluate(timed, self._env, trials, self.run.evaluation_seed)
        for record in records:
            self.log.write("eval", recorder.motions, recorder.since_perturbation, record)
        self.curves.write("eval", recorder.motions, records)
        reached = sum(record.rendezvous for record in records)
        print_progress(self.run, recorder, f": {reached} of {trials} held-out trials reached")


def print_progress(run: LifetimeRun, recorder: Recorder, more: str = "") -> None:
    """Prints how far a lifetime is, as `progress.made_in` reads it."""
    length, of = run.work
    print(f"{of} {getattr(recorder, of)}/{length}{more}", flush=True)


def run_sweep(run: SweepRun, folder: Path, times: CpuTimes) -> dict[str, Any]:
    """Makes the trials of a sweep, and logs each into `folder`; returns what the run says about itself.

    At every value the agent is made afresh, and learns nothing. A trial is in view where its first
    observation shows all points to both cameras, whatever the agent then does.
    """
    config = run.sweep
    privileged, settings, _, known = requirements(run.agent, config.env)
    trials, of = run.work
    with closing(TrialLog(folder)) as log:
        for i, value in enumerate(config.over, start=1):
            env = config.env.make(config.perturbations(value), privileged)
            agent = agents.make(run.agent.name, env, seed=run.agent_seed, **settings)
            reached = 0
            for world, seed in enumerate(run.world_seeds):
                in_view = _in_view(env, seed)
                (record,) = evaluate(TimedPredictor(agent, times), env, trials=1, seed=seed)
                log.write("sweep", 0, 0, record, world=world, value=float(value), in_view=in_view)
                reached += record.rendezvous
            env.close()
            made = i * len(run.world_seeds)
            print(f"{of} {made}/{trials}: {reached} reached at {config.vary} {value:g}", flush=True)
    return {"privileged": list(privileged), "prior_knowledge": list(known)}


def _in_view(env: gymnasium.Env[Any, Any], seed: int) -> bool:
    """Whether all points are in view at first, whatever is then lost of them."""
    env.reset(seed=seed)
    unwrapped: Any = env.unwrapped
    return bool(unwrapped.arms.in_view.all())


def main(folder: Path) -> None:
    """Makes the run that `folder` describes; DONE.json is the last thing to appear in it.

    But for what it took, which stands in timings.json, a run leaves the same in each repetition.
    """
    run = parse_run((folder / RUN).read_text(encoding="utf-8"))
    start, times, learned = time.monotonic(), CpuTimes(), 0
    try:
        if isinstance(run, SweepRun):
            outcome = run_sweep(run, folder, times)
        else:
            outcome, learned = run_lifetime(run, folder, times)
    finally:
        wall, cpu = round(time.monotonic() - start, 1), time.process_time()
        about = {"wall_seconds": wall, "cpu_seconds": cpu, CPU: times.a_motion(learned)}
        write_json(folder / TIMINGS, about)
    write_json(folder / DONE, outcome)


def end_with_the_parent() -> None:
    """Ends this process at once when the one that holds the other end of its input is gone."""
    sys.stdin.read()
    os._exit(1)


def end_after(cpu_seconds: float) -> None:
    """Ends this process when it has taken so much CPU time."""
    while (left := cpu_seconds - time.process_time()) > 0:
        time.sleep(min(left, 1_000))  # it has one thread that works: CPU time does not pass faster
    os._exit(OVER_BUDGET)


def serve() -> None:
    """Makes the runs whose CPU times and folders stand on the lines of its input, each in a copy of itself.

    So what they need is imported once. Where copies of processes are not as good as fresh ones (macOS), or
    there are none (Windows), this process makes one run itself, and ends.
    """
    for line in sys.stdin:
        copy = os.fork() if sys.platform == "linux" else 0
        if not copy:
            cpu_seconds, _, folder = line.rstrip("\n").partition(" ")
            threading.Thread(target=end_with_the_parent, daemon=True).start()
            threading.Thread(target=end_after, args=(float(cpu_seconds),), daemon=True).start()
            main(Path(folder))
            sys.stdout.flush()
            os._exit(0)  # all is written; to take a copy apart takes longer than a short run
        _, status = os.waitpid(copy, 0)
        print(f"{ENDED}{os.waitstatus_to_exitcode(status)}", flush=True)


if __name__ == "__main__":
    serve()
