"""Trains the network of `recurrent_servo`: `python -m agents.neural.recurrent_servo.train --out FILE`.

Back-propagation through time and through the simulated robots minimises how far the gripper is from the
object after every motion. So test motions, what is concluded from them and the way to the object are learned
as one. The trainer knows the true image points and their derivatives by the registers; the network does not.
"""

import argparse
import math
import platform
import time
from collections.abc import Iterator
from importlib.metadata import version
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from calfree_gym.image import IMAGE_UNIT

from .network import RecurrentServoNetwork, RecurrentState, save_network
from .robots import Disturbances, Look, TrainingRobots

TOLERANCE = 4 * IMAGE_UNIT
"""Image distance of the rendezvous that ends a training trial: that of `Reach-v0`."""
GRADIENT_BOUND = 5.0
"""Of the loss of one robot by its words or its memory (a guard): few wild trials must not rule the batch."""


class Episode(NamedTuple):
    """What a training trial came to.

    Attributes:
        loss: Mean over robots and motions ().
        motions: Mean number of motions, those without rendezvous counted with all.
        reached: Share of robots that observed a rendezvous.
    """

    loss: Tensor
    motions: float
    reached: float


def make_episode(
    network: RecurrentServoNetwork,
    robots: TrainingRobots,
    motions: int,
    finishing: float,
    rng: np.random.Generator,
) -> Episode:
    """Lets all robots make one trial with the network.

    Args:
        network: Chooses the words.
        robots: Make the motions.
        motions: Of the trial; a robot that has observed a rendezvous counts no more.
        finishing: Weight in [0, 1] of the last pixels against the whole way, see `motion_loss`.
        rng: Draws the disturbances.
    """
    befall = Disturbances(robots.robots, robots.motors, rng)
    look, memory = robots.begin(), network.begin(robots.robots)
    registers = look.registers
    points, visible = befall.measured(look.points, look.visible)
    loss = torch.zeros(())
    under_way = torch.ones(robots.robots)
    made = 0.0
    for motion in range(1, motions + 1):
        words, memory = network(points, visible, befall.to_network(registers), memory)
        memory = RecurrentState(*(_bounded_gradient(part) for part in memory))
        words = befall.to_robot(_bounded_gradient(words))
        asked = look.registers + words.detach()
        look = robots.move(words.detach().numpy())
        registers = _executed(registers + words, asked, look.registers)
        befall.begin_motion(motion)
        true = befall.in_images(_moved(look.true_points, look, registers))
        points, visible = befall.measured(_moved(look.points, look, registers), look.visible)
        loss = loss + (under_way * motion_loss(true, finishing)).mean() / motions
        made += under_way.mean().item()
        under_way = under_way * (_lengths(points.detach()).amax(1) > TOLERANCE)
    return Episode(loss, made, 1 - under_way.mean().item())


def motion_loss(points: Tensor, finishing: float) -> Tensor:
    """What a motion that ends at true image points (n, 4, 2) costs (n,).

    On the whole way the logarithm of the image distance counts, so that to halve it is worth as much far away
    as near. To finish, a smooth step about the tolerance counts: how many motions are yet to be made.
    """
    squares = _lengths(points).square()
    way = 0.5 * torch.log1p(squares / (0.75 * TOLERANCE) ** 2).mean(1)
    worst = squares.amax(1)
    near, far = (worst / (worst + (k * TOLERANCE) ** 2) for k in (1.5, 7.5))
    return (1 - finishing) * way + finishing * (2 * near + 0.6 * far)


def _lengths(points: Tensor) -> Tensor:
    """Image distances (n, 2) in each camera, of gripper and object at points (n, 4, 2)."""
    return (points[:, :2] - points[:, 2:]).square().sum(-1).add(1e-12).sqrt().clamp(max=3.0)


def _moved(points: Tensor, look: Look, registers: Tensor) -> Tensor:
    """Image points (n, 4, 2) as functions of the registers (n, m), to first order; their values stay."""
    change = registers - registers.detach()
    return points + torch.einsum("npcm,nm->npc", look.derivatives, change)


def _executed(wanted: Tensor, asked: Tensor, executed: Tensor) -> Tensor:
    """The executed registers (n, m), as functions of the wanted ones where no motor has stopped."""
    free = ((asked - executed).abs() < 1e-4).float()
    return executed + free * (wanted - wanted.detach())


def _bounded_gradient(tensor: Tensor) -> Tensor:
    """The same tensor (n, ...), through which the gradient of a row is at most `GRADIENT_BOUND` / n long."""
    if not tensor.requires_grad:
        return tensor

    def bounded(gradient: Tensor) -> Tensor:
        gradient = torch.nan_to_num(gradient)
        lengths = gradient.flatten(1).norm(dim=1).clamp(min=1e-12)
        shares = (GRADIENT_BOUND / len(gradient) / lengths).clamp(max=1)
        return gradient * shares.view(-1, *[1] * (gradient.ndim - 1))

    tensor = tensor.view_as(tensor)
    tensor.register_hook(bounded)
    return tensor


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
