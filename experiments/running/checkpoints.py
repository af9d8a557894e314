"""Held-out trials during a lifetime, in moments at which the agent neither moves nor learns."""

from typing import Any

from calfree_gym.perturbations import parse_schedule
from experiments.evaluation import evaluate
from experiments.running.cpu_time import CpuTimes, TimedPredictor
from experiments.running.lifetime import LifetimeRecorder, Onlooker
from experiments.running.rows import RowsRecorder
from experiments.running.run import LifetimeRun
from experiments.running.tensorboard_curves import Curves
from experiments.running.trial_log import TrialLog

Recorder = LifetimeRecorder | RowsRecorder


class Checkpoints(Onlooker):
    """Evaluates an agent on schedule, and right before and after a perturbation, without learning in between.

    Where one comes again and again, this is done once between two scheduled checkpoints, so that a world
    that is perturbed at every trial does not turn into one long evaluation.

    Args:
        spec: The run, which has an evaluation.
        agent: Made for `recorder`.
        rows: How many arms it moves at once.
        recorder: Whose motions count.
        log: Gets one row a trial.
        curves: Gets the means.
        times: Counts CPU seconds.
    """

    def __init__(
        self,
        spec: LifetimeRun,
        agent: Any,
        rows: int,
        recorder: Recorder,
        log: TrialLog,
        curves: Curves,
        times: CpuTimes,
    ):
        assert spec.evaluation is not None
        self._evaluation = spec.evaluation
        self._spec, self._agent, self._rows, self._recorder = spec, agent, rows, recorder
        self._log, self._curves, self._times = log, curves, times
        self._env = spec.scenario.env.make(tell=agent.privileged)
        self._once = {
            (event.clock, event.at)
            for event in parse_schedule(list(spec.scenario.perturbations))
            if not event.every
        }
        self._scheduled: set[int] = set()
        self._schedule()
        self._again = False
        self._last: tuple[int, int] | None = None

    def before_motion(self) -> None:
        """Evaluates where a scheduled checkpoint is reached."""
        if self._recorder.motions in self._scheduled:
            self._again = False
            self._evaluate()

    def before_change(self) -> None:
        """Evaluates in the world as it still is."""
        if not self._again:
            self._evaluate()

    def after_change(self) -> None:
        """Evaluates in the changed world; from a change that comes once, checkpoints are counted anew."""
        motions, trial, _ = self._recorder.perturbations[-1]
        once = not self._once.isdisjoint({("motion", motions), ("trial", trial)})
        if once and self._evaluation.begins_anew:
            self._schedule()
        if once or not self._again:
            self._evaluate()
        self._again = not once

    def finish(self) -> None:
        """Evaluates at the end of the lifetime."""
        self._evaluate()

    def _schedule(self) -> None:
        """Adds the checkpoints that are counted from now on."""
        now = self._recorder.motions
        left = self._spec.scenario.most_motions - now
        self._scheduled |= {now + offset for offset in self._evaluation.offsets(left, self._rows)}

    def _evaluate(self) -> None:
        """Makes the held-out trials, unless that has been done in this moment and world."""
        recorder = self._recorder
        self._scheduled.discard(recorder.motions)
        if self._last == (now := (recorder.motions, len(recorder.perturbations))):
            return
        self._last = now
        held_out: Any = self._env.unwrapped
        held_out.set_world(recorder.world)
        trials = self._evaluation.trials
        with self._times.of("evaluation"):
            timed = TimedPredictor(self._agent, self._times)
            records = evaluate(timed, self._env, trials, self._spec.evaluation_seed)
        for record in records:
            self._log.write("eval", recorder.motions, recorder.since_perturbation, record)
        self._curves.write("eval", recorder.motions, records)
        reached = sum(record.rendezvous for record in records)
        print_progress(self._spec, recorder, f": {reached} of {trials} held-out trials reached")


def print_progress(spec: LifetimeRun, recorder: Recorder, more: str = "") -> None:
    """Prints how far a lifetime is, as `progress.made_in` reads it."""
    length, of = spec.work
    print(f"{of} {getattr(recorder, of)}/{length}{more}", flush=True)
