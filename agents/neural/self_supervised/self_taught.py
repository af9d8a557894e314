"""A robot that learns from its own motions alone which words bring about which change of what it sees."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ...base.agent import Callback
from ...base.checks import check_number, checked_array
from ...base.observation import Array, Observation
from ...base.procedure import Procedure, ProcedureAgent
from ...base.registration import agent
from ...base.storage import AgentFile, prefixed, under
from .change_detector import ErrorDetector, JudgedMotion
from .inverse_model import InverseModel, Replay, ReplayPairs


@dataclass
class LearnedReach:
    """What is known of a trial while it goes on.

    Attributes:
        latest: The last observation in which all points were seen.
        nearest: The one of them with the shortest image distance.
        idle: Motions since that one.
        kept: Whether the replay holds its first observation.
        changes: Changes of the image distance (4,) on the trial's motions.
        residuals: By how much the words (m,) of these motions differ from the network's for these changes.
    """

    latest: Observation | None = None
    nearest: Observation | None = None
    idle: int = 0
    kept: bool = False
    changes: list[Array] = field(default_factory=list)
    residuals: list[Array] = field(default_factory=list)

    def observe(self, now: Observation, model: InverseModel) -> None:
        """Takes in an observation."""
        self.idle += 1
        if not now.visible.all():
            return
        before, self.latest = self.latest, now
        if self.nearest is None or np.linalg.norm(now.distance) < np.linalg.norm(self.nearest.distance):
            self.nearest, self.idle = now, 0
        if before is not None and model.ready and (now.registers != before.registers).any():
            change = now.distance - before.distance
            self.changes.append(change)
            made = now.registers - before.registers
            self.residuals.append(made - _words(model, before, change))

    def stuck(self, patience: int, small: float) -> bool:
        """Whether it is not near, and came no nearer in `patience` motions.

        Args:
            patience: In motions.
            small: A shorter image distance is near.
        """
        near = self.nearest is not None and np.linalg.norm(self.nearest.distance) <= small
        return self.idle >= patience and not near

    def correction(self, small: float) -> Array:
        """The linear correction E (m, 4) of the network that explains the residuals, by ridge regression.

        Args:
            small: Changes of the image distance of this length are noise as much as motion.
        """
        if not self.changes:
            return np.zeros((1, 4))  # of any number of motors
        changes, residuals = np.array(self.changes), np.array(self.residuals)
        normal = changes.T @ changes + small**2 * np.eye(4)
        return np.asarray(np.linalg.solve(normal, changes.T @ residuals).T)


def _words(model: InverseModel, at: Observation, change: Array) -> Array:
    sensors = at.points.reshape(1, -1)
    return model.words(sensors, at.registers[None], change[None])[0]


def reach(
    first: Observation,
    trial: LearnedReach,
    model: InverseModel,
    rng: np.random.Generator,
    patience: int,
    extent: float,
    adapts: bool,
) -> Procedure:
    """Asks for the change of the image distance that makes it zero, again and again.

    Where a point gets out of view, the arm goes half the way back to the nearest place so far, again and
    again. Where it is stuck, it makes a random motion.

    Args:
        first: The trial's first observation.
        trial: Filled as the trial goes on.
        model: Says the words.
        rng: Draws random ones.
        patience: In motions.
        extent: Random motions go to registers of at most this magnitude.
        adapts: Whether the trial's own motions correct the model.
    """
    now = first
    while True:
        trial.observe(now, model)
        small = model.SMALL_CHANGE * model.image_scale
        lost = not now.visible.all()
        if trial.nearest is None or not (lost or model.ready) or trial.stuck(patience, small):
            trial.idle = 0
            words = random_words(rng, now.registers, extent)
        elif lost:
            words = (trial.nearest.registers - now.registers) / 2
        else:
            words = _words(model, now, -now.distance)
            if adapts:
                words -= trial.correction(small) @ now.distance
        now = yield np.clip(words, -1, 1)


def random_words(rng: np.random.Generator, registers: Array, extent: float) -> Array:
    """Words (m,) to registers drawn uniformly within ±`extent`."""
    return rng.uniform(-extent, extent, len(registers)) - registers


@dataclass(frozen=True)
class Schedule:
    """How a robot that teaches itself spends its motions and its processor: see `SelfSupervised`."""

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


@agent("self_supervised", "A small network that learns from its own motions alone, without a reward.")
class SelfSupervised(ProcedureAgent):
    """Learns from its own motions alone, without a reward, which words bring about which change.

    A reconstruction in the manner of J. Cooperstock and E. Milios, "Self-supervised learning for docking
    and target reaching" (Robotics and Autonomous Systems 11, 1993). Theirs is the principle: a network learns
    from random motions, then on line, by which control words a change came about that was seen, and is asked
    for the change that is wanted. This much is ours:

    - The network puts out a matrix M, and the words are M Δd, d the image distance: it is asked for Δd = -d.
      A change of zero so takes no words, whatever it has learned. Registers are among its inputs.
    - Every ordered pair of observations of a trial teaches, not only those that are one motion apart.
    - In a trial, M is corrected by what the trial's own motions have shown: a ridge regression of their
      residuals. So it reaches while it knows little, and right after a change.
    - Weights that act are averaged.
    - It tells by itself when the world has changed (`ErrorDetector`). Where one reversed motor explains the
      errors, the replay is mended: the motor's registers get the other sign. Otherwise the replay from before
      the change is doubtful: each of its pairs counts as far as the network, which learns from new ones,
      confirms it.

    Nothing is told of the camera mount, of the unit of image points, or of noise; only `random_extent` is
    chosen for motors of some strength. Under latency registers and image points are of different times: it
    does not know that.

    Args:
        seed: Of first weights, random words and batches.
        hidden: Widths of the network's hidden layers.
        learning_rate: Of Adam.
        random_motions: The first motions are random until the robot has observed this often.
        random_extent: Random motions go to registers drawn uniformly within ± this.
        exploration: Share of random motions later, in `learn`.
        patience: After so many motions that came no nearer, it makes a random one.
        updates: Steps of Adam after each motion.
        batch: Pairs of observations in each step.
        capacity: Observations that are kept.

    Attributes:
        model: Says words for a wanted change of the image distance.
        replay: Teaches it.
        changes: Of the world, that it has told since it was made or loaded: after which motion, and the signs
            (m,) of the motors, -1 for a reversed one, or None where the change was another.
    """

    plain: ClassVar[bool] = False
    """Whether it is as Cooperstock & Milios had it."""
    TOLERATED = 3.0
    """A doubtful pair has half of its weight where its error is this many times the median of errors before
    the change: so a change that was none costs little. Not tuned."""

    def __init__(
        self,
        env: gym.Env[Any, Any],
        seed: int = 0,
        hidden: tuple[int, ...] = (64, 64),
        learning_rate: float = 3e-3,
        random_motions: int = 40,
        random_extent: float = 0.5,
        exploration: float = 0.05,
        patience: int = 6,
        updates: int = 3,
        batch: int = 256,
        capacity: int = 20_000,
    ) -> None:
        super().__init__(env, seed)
        motors = env.action_space.shape[0]  # type: ignore[index]
        ours = not self.plain
        self.model = InverseModel(motors, seed, hidden, learning_rate, matrix=ours, knows_registers=ours)
        self.schedule = Schedule(
            random_motions, random_extent, exploration, patience, updates, batch, capacity
        )
        self.replay = Replay(motors, capacity)
        self.detector = None if self.plain else ErrorDetector(motors)
        self._usual_error = 1.0
        self.changes: list[tuple[int, Array | None]] = []
        self._trials = 0
        self._rng = np.random.default_rng(seed)

    def new_findings(self) -> LearnedReach:
        return LearnedReach()

    def procedure(self, first: Observation, findings: LearnedReach) -> Procedure:
        """See `ProcedureAgent`. Random words follow from the object, so that `predict` is deterministic."""
        rng = np.random.default_rng([self.seed, *np.frombuffer(first.object.tobytes(), np.uint32)])
        schedule, corrects = self.schedule, self.detector is not None
        return reach(first, findings, self.model, rng, schedule.patience, schedule.random_extent, corrects)

    def learn(self, total_timesteps: int, callback: Callback | None = None) -> Self:
        """See `Agent`. Its draws follow from `seed` and the motions before: with both, agents learn alike."""
        self._rng = np.random.default_rng([self.seed, self.num_timesteps])
        return super().learn(total_timesteps, callback)

    def explore(self, words: Array, now: Observation) -> Array:
        share = self.schedule.exploration if self.model.ready else 1.0
        if not now.visible.all() or self._rng.random() >= share:
            return words
        return np.clip(random_words(self._rng, now.registers, self.schedule.random_extent), -1, 1)

    def learn_motion(self, findings: LearnedReach, before: Observation, after: Observation) -> None:
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
            self._judge(self.detector, ReplayPairs.of(before, after), findings)
        steps = self.schedule.updates
        pairs = self.replay.sample(steps * self.schedule.batch, self._rng, self.plain)
        self.model.train(pairs, steps, self._usual_error)

    def _judge(self, detector: ErrorDetector, motion: ReplayPairs, findings: LearnedReach) -> None:
        """Judges by a motion whether the replay is still true, and doubts or mends what is not.

        What the trial's motions showed is of the network as it was before it was mended.
        """
        made, said, size = self.model.judge(motion)
        usual_error = detector.usual_error()
        judged = JudgedMotion(made[0], said[0], float(size[0]), self.replay.added, self._trials)
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
        super().load(path)
        self.changes = []
        return self

    @property
    def kind(self) -> str:
        """See `ProcedureAgent`. The seed is left out: what was learned by one serves any other."""
        return f"{type(self).__name__}({self.model!r}, {self.schedule!r})"

    def arrays(self) -> dict[str, NDArray[Any]]:
        return {
            **prefixed("model", self.model.arrays()),
            **prefixed("replay", self.replay.arrays()),
            **(prefixed("detector", self.detector.arrays()) if self.detector else {}),
            "trials": np.array(self._trials),
            "usual_error": np.array(self._usual_error),
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        self.replay.restore(under("replay", arrays))
        latest = max(self.replay.trials, default=0)
        trials = int(checked_array(arrays, "trials", (), least=latest, whole=True))
        usual_error = float(checked_array(arrays, "usual_error", (), least=0))
        if self.detector:
            self.detector.restore(under("detector", arrays))
        self.model.restore(under("model", arrays))
        self._trials, self._usual_error = trials, usual_error


PLAIN = {
    "hidden": (128, 128),
    "learning_rate": 1e-3,
    "random_motions": 500,
    "updates": 2,
    "capacity": 1_500,
}
"""Settings of `CooperstockMilios`. It keeps few looks: after a change of the world, older ones mislead."""


@agent(
    "cooperstock_milios",
    "Its plain form: one network, no reaction to changes (Cooperstock, Milios 1993).",
    defaults=lambda given: PLAIN,
)
class CooperstockMilios(SelfSupervised):
    """Learns (s, Δs seen) → Δc from random motions, then on line.

    After J. Cooperstock and E. Milios, "Self-supervised learning for docking and target reaching"
    (Robotics and Autonomous Systems 11, 1993). A multi-layer perceptron learns from single motions by which
    words Δc, in the state s, the change Δs came about that was seen. Then it is asked for the change that is
    wanted, and each motion that it makes so teaches it, too.

    Reconstructed are: s, here the sensor vectors of gripper and object, and Δs, here the change of the image
    distance; size, activation and optimiser of the network; the replay of motions; errors of words relative
    to the size of the change; averaged weights; random motions where it comes no nearer, and half of the way
    back where a point is out of view.

    Settings are those of `SelfSupervised`; `agents.make` has those of `PLAIN` by default.
    """

    plain = True
