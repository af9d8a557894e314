"""The recurrent network: image points and registers in, control words out, all memory of one trial between.

Its memory is a gated recurrent unit (Cho et al. 2014) and a least-squares estimate of the Jacobian. The unit
decides how far the estimate is to be trusted, forgotten and corrected; a damped Gauss-Newton step follows.
Where a point is lost, the step leads some of the way back to where all points were seen last.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from calfree_gym.image import IMAGE_UNIT

NOISE_FLOOR = 4 * IMAGE_UNIT
"""Image distances below this look alike to the network: a few times the noise of image points."""
WORD_FLOOR = 0.01
"""Motions shorter than this count for less: they move a point by little more than the noise."""
COORDINATES = 4
"""Of a sensor vector."""


class Memory(NamedTuple):
    """All that the network keeps of a trial, for n robots with m motors.

    Attributes:
        hidden: Of the recurrent unit (n, h).
        points: Image points (n, 4, 2) when last all four were seen.
        registers: At that time (n, m).
        seen: Whether there was such a time (n,).
        looks: Observations so far (n,).
        information: Sum of Δr Δrᵀ over the motions seen (n, m, m), weighted.
        moment: Sum of Δd Δrᵀ (n, 4, m), weighted alike.
    """

    hidden: Tensor
    points: Tensor
    registers: Tensor
    seen: Tensor
    looks: Tensor
    information: Tensor
    moment: Tensor


class RecurrentServoNetwork(nn.Module):
    """Maps an observation and its memory to control words and the next memory.

    Args:
        motors: m.
        hidden: Width h of the recurrent unit and of the layers around it.
    """

    def __init__(self, motors: int = 3, hidden: int = 128) -> None:
        super().__init__()
        self.motors, self.hidden = motors, hidden
        self._outputs = [COORDINATES * motors, COORDINATES * motors, motors, 6]
        inputs = 8 + 4 + COORDINATES + motors + motors + 8 + COORDINATES + 2 + COORDINATES + 1
        inputs += COORDINATES * motors + motors + motors
        self.encoder = nn.Sequential(nn.Linear(inputs, hidden), nn.SiLU())
        self.unit = nn.GRUCell(hidden, hidden)
        first, last = nn.Linear(hidden + inputs, hidden), nn.Linear(hidden, sum(self._outputs))
        self.decoder = nn.Sequential(first, nn.SiLU(), last)
        with torch.no_grad():
            last.weight.mul_(0.3)
            last.bias.zero_()
        self.test_words = nn.Parameter(0.15 * torch.eye(motors))
        """The first m words of a trial (m, m), to which the decoder adds; at first one motor at a time."""

    def begin(self, robots: int) -> Memory:
        """The memory of `robots` robots at the beginning of a trial."""
        like = self.test_words.new_zeros
        return Memory(
            hidden=like(robots, self.hidden),
            points=like(robots, 4, 2),
            registers=like(robots, self.motors),
            seen=torch.zeros(robots, dtype=torch.bool),
            looks=torch.zeros(robots, dtype=torch.long),
            information=like(robots, self.motors, self.motors),
            moment=like(robots, COORDINATES, self.motors),
        )

    def forward(
        self, points: Tensor, visible: Tensor, registers: Tensor, memory: Memory
    ) -> tuple[Tensor, Memory]:
        """Control words (n, m) in [-1, 1], and the memory for the next observation.

        Args:
            points: Image points (n, 4, 2) as last seen: gripper left, right, object left, right.
            visible: Which of them are seen now (n, 4).
            registers: Executed sums of words since home (n, m).
            memory: Of the trial so far.
        """
        seen = visible.all(1)
        moved = (seen & memory.seen).to(points.dtype)
        distance = (points[:, :2] - points[:, 2:]).flatten(1)
        points_change = (points - memory.points).flatten(1) * moved[:, None]
        distance_change = points_change[:, :4] - points_change[:, 4:]
        back = memory.registers - registers
        change = -back * moved[:, None]

        weight = moved / (change.square().sum(1) + WORD_FLOOR**2)
        added = (weight[:, None] * change)[:, None]
        information = change[:, :, None] * added
        moment = distance_change[:, :, None] * added
        plain = _jacobian(memory.information + information, memory.moment + moment, 0.02)
        plain_step = _gauss_newton(plain, distance, 0.05).clamp(-1, 1)

        lengths = distance.view(-1, 2, 2).square().sum(-1).add(1e-12).sqrt()
        inputs = torch.cat(
            [
                points.flatten(1),
                visible.to(points.dtype),
                distance,
                registers,
                5 * change,
                3 * points_change,
                distance / (lengths.amax(1, keepdim=True) + NOISE_FLOOR),
                torch.log(lengths + NOISE_FLOOR),
                0.3 * distance_change / (change.norm(dim=1, keepdim=True) + WORD_FLOOR),
                (memory.looks == 0).to(points.dtype)[:, None],
                0.5 * plain.flatten(1),
                2 * plain_step,
                2 * back,
            ],
            1,
        )
        hidden = self.unit(self.encoder(inputs), memory.hidden)
        decoded = self.decoder(torch.cat([hidden, inputs], 1))
        prior, correction, extra, gates = decoded.split(self._outputs, 1)
        keep, take = torch.sigmoid(gates[:, 0] + 2), torch.sigmoid(gates[:, 1] + 1)
        trust, damping = 0.02 * gates[:, 2:4].clamp(-4, 4).exp().T
        limit, retreat = torch.sigmoid(gates[:, 4:5]), torch.sigmoid(gates[:, 5:])

        information = keep[:, None, None] * memory.information + take[:, None, None] * information
        moment = keep[:, None, None] * memory.moment + take[:, None, None] * moment
        jacobian = _jacobian(information, moment, 0.01 + trust, prior.view_as(moment))
        step = _gauss_newton(jacobian + correction.view_as(moment), distance, 0.002 + damping)
        step = torch.where(seen[:, None], step, (1 - retreat) * step + retreat * back)
        words = limit * torch.tanh((step + 0.3 * extra) / limit) + self._tests(memory.looks)
        return words.clamp(-1, 1), Memory(
            hidden=hidden,
            points=torch.where(seen[:, None, None], points, memory.points),
            registers=torch.where(seen[:, None], registers, memory.registers),
            seen=seen | memory.seen,
            looks=memory.looks + 1,
            information=information,
            moment=moment,
        )

    def _tests(self, looks: Tensor) -> Tensor:
        """The test words (n, m) that are due after so many looks (n,); zero once all were sent."""
        testing = looks < self.motors
        return self.test_words[looks.clamp(max=self.motors - 1)] * testing[:, None]


def _jacobian(
    information: Tensor, moment: Tensor, trust: Tensor | float, prior: Tensor | float = 0.0
) -> Tensor:
    """Ridge estimate (n, 4, m) of J, drawn towards `prior` (n, 4, m) with `trust` (n,) in it."""
    ridge = torch.as_tensor(trust).reshape(-1, 1, 1)
    identity = torch.eye(information.shape[-1], dtype=information.dtype)
    return (moment + ridge * prior) @ torch.linalg.inv(information + ridge * identity)


def _gauss_newton(jacobian: Tensor, distance: Tensor, damping: Tensor | float) -> Tensor:
    """The damped least-squares solution c (n, m) of J c = -d, with J (n, 4, m) and d (n, 4)."""
    transposed = jacobian.transpose(1, 2)
    identity = torch.eye(jacobian.shape[-1], dtype=jacobian.dtype)
    normal = transposed @ jacobian + torch.as_tensor(damping).reshape(-1, 1, 1) * identity
    return -(torch.linalg.inv(normal) @ transposed @ distance[:, :, None]).squeeze(-1)
