"""Trains the network of `recurrent_servo`: `python -m agents.neural.recurrent_servo.train --out FILE`.

Back-propagation through time and through the simulated robots minimises how far the gripper is from the
object after every motion. So test motions, what is concluded from them and the way to the object are learned
as one. The trainer knows the true image points and their derivatives by the registers; the network does not.
"""

from __future__ import annotations

import argparse
import math
import platform
import time
from collections.abc import Iterator
from importlib.metadata import version

import numpy as np
import torch
from torch import nn

from .episode import Episode, make_episode
from .network import RecurrentServoNetwork
from .robots import TrainingRobots
from .weights import save_network

MOUNTS = ("waist", "stand")
CLIP = 0.5
"""Of the gradient's norm over all weights. Choice, like those below."""
WARM_UP = 100
"""Updates in which the learning rate rises."""
FINISHING = (0.3, 0.7)
"""Shares of the training between which the loss turns from the whole way to the last pixels."""
KEPT_EVERY = 500
"""Updates between two writings of the file."""


def train(
    network: RecurrentServoNetwork,
    groups: list[TrainingRobots],
    updates: int,
    motions: int,
    learning_rate: float,
    rng: np.random.Generator,
) -> Iterator[Episode]:
    """Trains a network by one trial of one group of robots after the other.

    Args:
        network: Changed in place.
        groups: Of robots; all learn alike, in turn.
        updates: How many trials, each followed by an update of the weights.
        motions: Of each trial.
        learning_rate: Of Adam at its height; it rises, and falls to a hundredth as half a cosine.
        rng: Draws the disturbances.

    Yields:
        What each trial came to, once the weights are updated.
    """
    optimiser = torch.optim.Adam(network.parameters(), learning_rate)
    first, last = FINISHING
    for update in range(updates):
        done = update / updates
        rate = learning_rate * min(1.0, (update + 1) / WARM_UP) * (0.505 + 0.495 * math.cos(math.pi * done))
        for parameters in optimiser.param_groups:
            parameters["lr"] = rate
        finishing = min(1.0, max(0.0, (done - first) / (last - first)))
        episode = make_episode(network, groups[update % len(groups)], motions, finishing, rng)
        optimiser.zero_grad()
        episode.loss.backward()
        if torch.isfinite(nn.utils.clip_grad_norm_(network.parameters(), CLIP)):
            optimiser.step()
        yield episode


def main(arguments: list[str] | None = None) -> None:
    """Reads the command line, trains, and writes the file."""
    parser = argparse.ArgumentParser(
        prog="python -m agents.neural.recurrent_servo.train", description="Trains recurrent_servo."
    )
    parser.add_argument("--out", required=True, help="file of weights, .safetensors")
    parser.add_argument("--seed", type=int, default=0, help="of weights and disturbances")
    parser.add_argument("--worlds-from", type=int, default=100_000, help="seed of the first training world")
    parser.add_argument("--groups", type=int, default=8, help="groups of robots, by turns on waist and stand")
    parser.add_argument("--robots", type=int, default=512, help="robots in a group, each in its own world")
    parser.add_argument("--updates", type=int, default=12_000, help="updates of the weights")
    parser.add_argument("--motions", type=int, default=12, help="motions of a training trial")
    parser.add_argument("--hidden", type=int, default=128, help="width of the network")
    parser.add_argument("--learning-rate", type=float, default=1e-3, help="of Adam")
    given = parser.parse_args(arguments)

    torch.set_num_threads(1)
    torch.manual_seed(given.seed)
    groups = [
        TrainingRobots(given.robots, MOUNTS[i % len(MOUNTS)], given.worlds_from + i * given.robots)
        for i in range(given.groups)
    ]
    print(f"{given.groups * given.robots} worlds, {time.process_time() / 60:.1f} CPU minutes", flush=True)
    network = RecurrentServoNetwork(groups[0].motors, given.hidden)
    progress = train(
        network, groups, given.updates, given.motions, given.learning_rate, np.random.default_rng(given.seed)
    )
    recent = []
    for update, episode in enumerate(progress, 1):
        recent.append((episode.loss.item(), episode.motions, episode.reached))
        if update % 100 == 0:
            loss, motions, reached = np.mean(recent, 0)
            recent.clear()
            print(
                f"update {update}: loss {loss:.4f}, motions {motions:.2f}, reached {reached:.1%}, "
                f"{time.process_time() / 60:.1f} CPU minutes",
                flush=True,
            )
        if update % KEPT_EVERY == 0 or update == given.updates:
            save_network(given.out, network, groups[0].shapes, _record(given, update))


def _record(given: argparse.Namespace, updates_made: int) -> dict[str, object]:
    """How a network came about, for its file."""
    settings = {key: value for key, value in vars(given).items() if key != "out"}
    command = " ".join(f"--{key.replace('_', '-')} {value}" for key, value in settings.items())
    last = given.worlds_from + given.groups * given.robots - 1
    return {
        "command": f"python -m agents.neural.recurrent_servo.train {command} --out FILE",
        **settings,
        "updates_made": updates_made,
        "worlds": f"wild, kinematic, seeds {given.worlds_from} to {last}, mounts {' and '.join(MOUNTS)}",
        "learned_by": "analytic gradient of the image distance through the simulated robots",
        "cpu_minutes": round(time.process_time() / 60, 1),
        "versions": {
            "python": platform.python_version(),
            **{name: version(name) for name in ("torch", "numpy", "gymnasium", "mujoco", "safetensors")},
        },
    }


if __name__ == "__main__":
    main()
