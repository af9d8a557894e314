"""A robot that learns from its own motions alone which words bring about which change of what it sees."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ...base.agent import Callback
from ...base.checks import check_number, checked_array
from ...base.observation import Array, Observation
from ...base.procedure import Procedure, ProcedureAgent
from ...base.storage import AgentFile, prefixed, under
from .change_detector import ChangeDetector, Judged
from .inverse_model import InverseModel
from .reach import Reach, random_words, reach
from .replay import Pairs, Replay


@dataclass(frozen=True)
class Schedule:
    """How a robot that teaches itself spends its motions and its processor.

    Attributes:
        random_motions: The first motions are random until the robot has observed this often.
        random_extent: Random motions go to registers drawn uniformly within ± this.
        exploration: Share of random motions later, in `learn`.
        patience: After so many motions that came no nearer, a random one.
        updates: Steps of gradient descent after each motion.
        batch: Pairs of observations in each step.
        capacity: Observations that are kept.
    """

    random_motions: int
    random_extent: float
    exploration: float
    patience: int
    updates: int
    batch: int
    capacity: int

    def __post_init__(self) -> None:
        check_number("random_motions", self.random_motions, least=2, whole=True)
        check_number("exploration", self.exploration, least=0, most=1)
        check_number("random_extent", self.random_extent, above=0, most=1)
        check_number("patience", self.patience, least=1, whole=True)
        check_number("updates", self.updates, least=1, whole=True)
        check_number("batch", self.batch, least=1, whole=True)
        check_number("capacity", self.capacity, least=self.random_motions, whole=True)


class SelfTaughtAgent(ProcedureAgent):
    """What the learners of this package share: random motions first, then reaches, and every motion teaches.

    Attributes:
        model: Says words for a wanted change of the image distance.
        replay: Teaches it.
        changes: Of the world, that it has told since it was made or loaded: after which motion, and the signs
            (m,) of the motors, -1 for a reversed one, or None where the change was another.

    Args:
        env: See `Agent`.
        model: Not trained yet.
        schedule: How it spends its motions.
        consecutive: Whether only consecutive observations teach, or all pairs of a trial.
        detector: Tells changes of the world; then a trial's own motions also correct the network. Without one
            the world is taken to stay as it is.
        seed: Of random words and batches.
    """

    TOLERATED = 3.0
    """A doubtful pair has half of its weight where its error is this many times the median of errors before
    the change: so a change that was none costs little. Not tuned."""

    def __init__(
        self,
        env: gym.Env[Any, Any],
        model: InverseModel,
        schedule: Schedule,
        consecutive: bool,
        detector: ChangeDetector | None,
        seed: int,
    ) -> None:
        super().__init__(env, seed)
        self.model, self.schedule = model, schedule
        self.replay = Replay(model.motors, schedule.capacity)
        self._consecutive = consecutive
        self.detector = detector
        self._usual_error = 1.0
        self.changes: list[tuple[int, Array | None]] = []
        self._trials = 0
        self._rng = np.random.default_rng(seed)

    def new_findings(self) -> Reach:
        """See `ProcedureAgent`."""
        return Reach()

    def procedure(self, first: Observation, findings: Reach) -> Procedure:
        """See `ProcedureAgent`. Random words follow from the object, so that `predict` is deterministic."""
        rng = np.random.default_rng([self.seed, *np.frombuffer(first.object.tobytes(), np.uint32)])
        schedule, corrects = self.schedule, self.detector is not None
        return reach(first, findings, self.model, rng, schedule.patience, schedule.random_extent, corrects)

    def learn(self, total_timesteps: int, callback: Callback | None = None) -> Self:
        """See `Agent`. Its draws follow from `seed` and the motions before: with both, agents learn alike."""
        self._rng = np.random.default_rng([self.seed, self.num_timesteps])
        return super().learn(total_timesteps, callback)

    def explore(self, words: Array, now: Observation) -> Array:
        """See `ProcedureAgent`."""
        share = self.schedule.exploration if self.model.ready else 1.0
        if not now.visible.all() or self._rng.random() >= share:
            return words
        return np.clip(random_words(self._rng, now.registers, self.schedule.random_extent), -1, 1)

    def learn_motion(self, findings: Reach, before: Observation, after: Observation) -> None:
        """See `ProcedureAgent`."""
        if not findings.kept:
            findings.kept = True
            self._trials += 1
            self.replay.add(before, self._trials)
        self.replay.add(after, self._trials)
        if not self.model.ready:
            if len(self.replay) < self.schedule.random_motions:
                return
            self.model.set_scales(self.replay.sensors, self.replay.registers)
            if not self.model.ready:
                return
        seen = before.visible.all() and after.visible.all()
        if self.detector and seen and (after.registers != before.registers).any():
            self._judge(self.detector, Pairs.of(before, after), findings)
        steps = self.schedule.updates
        pairs = self.replay.sample(steps * self.schedule.batch, self._rng, self._consecutive)
        self.model.train(pairs, steps, self._usual_error)

    def _judge(self, detector: ChangeDetector, motion: Pairs, findings: Reach) -> None:
        """Judges by a motion whether the replay is still true, and doubts or mends what is not.

        What the trial's motions showed is of the network as it was before it was mended.
        """
        made, said, size = self.model.judge(motion)
        usual_error = detector.usual_error()
        judged = Judged(made[0], said[0], float(size[0]), self.replay.added, self._trials)
        change = detector.observe(judged)
        if change is None:
            return
        self.changes.append((self.num_timesteps, change.signs))
        self._trials += 1
        if change.signs is None:
            self.replay.doubt(change.since)
            self._usual_error = self.TOLERATED * usual_error
        else:
            self.replay.reverse(change.signs, change.since)
            self.model.reverse(change.signs)
            findings.changes.clear()
            findings.residuals.clear()

    def load(self, path: AgentFile) -> Self:
        """See `ProcedureAgent`."""
        super().load(path)
        self.changes = []
        return self

    @property
    def kind(self) -> str:
        """See `ProcedureAgent`. The seed is left out: what was learned by one serves any other."""
        return f"{type(self).__name__}({self.model!r}, {self.schedule!r})"

    def arrays(self) -> dict[str, NDArray[Any]]:
        """See `ProcedureAgent`."""
        return {
            **prefixed("model", self.model.arrays()),
            **prefixed("replay", self.replay.arrays()),
            **(prefixed("detector", self.detector.arrays()) if self.detector else {}),
            "trials": np.array(self._trials),
            "usual_error": np.array(self._usual_error),
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """See `ProcedureAgent`."""
        trials = int(checked_array(arrays, "trials", ()))
        usual_error = float(checked_array(arrays, "usual_error", ()))
        self.replay.restore(under("replay", arrays))
        if self.detector:
            self.detector.restore(under("detector", arrays))
        self.model.restore(under("model", arrays))
        self._trials, self._usual_error = trials, usual_error
