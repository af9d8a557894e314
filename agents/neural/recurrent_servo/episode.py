"""One training trial of many robots: its loss, differentiable through the black box."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from calfree_gym.image import IMAGE_UNIT

from .disturbances import Disturbances
from .network import Memory, RecurrentServoNetwork
from .robots import Look, TrainingRobots

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
        memory = Memory(*(_bounded_gradient(part) for part in memory))
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
