"""The strongest learner here: a matrix for each state and wanted change, taught by whole trials."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

from .agent import Schedule, SelfTaughtAgent
from .change_detector import ChangeDetector
from .inverse_model import InverseModel


class SelfSupervised(SelfTaughtAgent):
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
    - It tells by itself when the world has changed (`ChangeDetector`). Where one reversed motor explains the
      errors, the replay is mended: the motor's registers get the other sign. Otherwise the replay from before
      the change is doubtful: each of its pairs counts as far as the network, which learns from new ones,
      confirms it.

    Nothing is told of the camera mount, of the unit of image points, or of noise; only `random_extent` is
    chosen for motors of some strength. Under latency registers and image points are of different times: it
    does not know that.

    Args:
        env: See `Agent`.
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

    Raises:
        ValueError: A setting is not allowed.
    """

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
        model = InverseModel(
            env.action_space.shape[0],  # type: ignore[index]
            seed,
            hidden,
            learning_rate,
            matrix=True,
            knows_registers=True,
        )
        schedule = Schedule(random_motions, random_extent, exploration, patience, updates, batch, capacity)
        super().__init__(
            env, model, schedule, consecutive=False, detector=ChangeDetector(model.motors), seed=seed
        )
