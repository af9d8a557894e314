"""The plain form of self-supervised learning, as its authors had it."""

from __future__ import annotations

from typing import Any

import gymnasium as gym

from .agent import Schedule, SelfTaughtAgent
from .inverse_model import InverseModel


class CooperstockMilios(SelfTaughtAgent):
    """Learns (s, Δs seen) → Δc from random motions, then on line.

    After J. Cooperstock and E. Milios, "Self-supervised learning for docking and target reaching"
    (Robotics and Autonomous Systems 11, 1993). A multi-layer perceptron learns from single motions by which
    words Δc, in the state s, the change Δs came about that was seen. Then it is asked for the change that is
    wanted, and each motion that it makes so teaches it, too.

    Reconstructed are: s, here the sensor vectors of gripper and object, and Δs, here the change of the image
    distance; size, activation and optimiser of the network; the replay of motions; errors of words relative
    to the size of the change; averaged weights; random motions where it comes no nearer, and half of the way
    back where a point is out of view.

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
        batch: Motions in each step.
        capacity: Observations that are kept: after a change of the world, older ones mislead.

    Raises:
        ValueError: A setting is not allowed.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        seed: int = 0,
        hidden: tuple[int, ...] = (128, 128),
        learning_rate: float = 1e-3,
        random_motions: int = 500,
        random_extent: float = 0.5,
        exploration: float = 0.05,
        patience: int = 6,
        updates: int = 2,
        batch: int = 256,
        capacity: int = 1_500,
    ) -> None:
        model = InverseModel(
            env.action_space.shape[0],  # type: ignore[index]
            seed,
            hidden,
            learning_rate,
            matrix=False,
            knows_registers=False,
        )
        schedule = Schedule(random_motions, random_extent, exploration, patience, updates, batch, capacity)
        super().__init__(env, model, schedule, consecutive=True, detector=None, seed=seed)
