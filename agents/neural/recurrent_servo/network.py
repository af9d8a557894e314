"""The recurrent network: image points and registers in, control words out, all memory of one trial between.

Its memory is a gated recurrent unit (Cho et al. 2014) and a least-squares estimate of the Jacobian. The unit
decides how far the estimate is to be trusted, forgotten and corrected; a damped Gauss-Newton step follows.
Where a point is lost, the step leads some of the way back to where all points were seen last.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import torch
from safetensors.torch import load, save
from torch import Tensor, nn

from calfree_gym.image import IMAGE_UNIT

from ...base.checks import check_number
from ...base.observation import STANDARD_KEYS
from ...base.storage import AgentFile, content, written

NOISE_FLOOR = 4 * IMAGE_UNIT
"""Image distances below this look alike to the network. Choice: a few times the noise of image points."""
WORD_FLOOR = 0.01
"""Motions shorter than this count for less. Choice: they move a point by little more than the noise."""
COORDINATES = 4
"""Of a sensor vector."""
PLAIN_RIDGE, PLAIN_DAMPING = 0.02, 0.05
"""Of the estimate and the step that the network is shown; a clean motion adds information of 1. Choice: what
it acts by, it sets itself."""
RIDGE, STEEPEST_GATE = 0.02, 4.0
"""What it sets them to lies about this, and within e to the power of so much. Choice."""
FREELY = 0.3
"""Share that it adds to its step as it likes, before the limit. Choice."""
LEAST_RIDGE, LEAST_DAMPING = 0.01, 0.002
"""Of those that it sets (guards): they keep the inverses within what float32 can hold."""
GATES = 6
"""Numbers that rule estimate and step: keep, take, ridge, damping, limit, retreat."""


class RecurrentState(NamedTuple):
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
        self._outputs = [COORDINATES * motors, COORDINATES * motors, motors, GATES]
        inputs = 35 + (4 + COORDINATES) * motors  # see `_inputs`
        self.encoder = nn.Sequential(nn.Linear(inputs, hidden), nn.SiLU())
        self.unit = nn.GRUCell(hidden, hidden)
        first, last = nn.Linear(hidden + inputs, hidden), nn.Linear(hidden, sum(self._outputs))
        self.decoder = nn.Sequential(first, nn.SiLU(), last)
        with torch.no_grad():
            last.weight.mul_(0.3)
            last.bias.zero_()
        self.test_words = nn.Parameter(0.15 * torch.eye(motors))
        """The first m words of a trial (m, m), to which the decoder adds; at first one motor at a time."""

    def begin(self, robots: int) -> RecurrentState:
        """The memory of `robots` robots at the beginning of a trial."""
        like = self.test_words.new_zeros
        return RecurrentState(
            hidden=like(robots, self.hidden),
            points=like(robots, 4, 2),
            registers=like(robots, self.motors),
            seen=torch.zeros(robots, dtype=torch.bool),
            looks=torch.zeros(robots, dtype=torch.long),
            information=like(robots, self.motors, self.motors),
            moment=like(robots, COORDINATES, self.motors),
        )

    def forward(
        self, points: Tensor, visible: Tensor, registers: Tensor, memory: RecurrentState
    ) -> tuple[Tensor, RecurrentState]:
        """Control words (n, m) in [-1, 1], and the memory for the next observation.

        Args:
            points: Image points (n, 4, 2) as last seen: gripper left, right, object left, right.
            visible: Which of them are seen now (n, 4).
            registers: Executed sums of words since home (n, m).
            memory: Of the trial so far.
        """
        motion = _last_motion(points, visible, registers, memory)
        inputs = _inputs(points, visible, registers, memory, motion)
        hidden = self.unit(self.encoder(inputs), memory.hidden)
        decoded = self.decoder(torch.cat([hidden, inputs], 1))
        prior, correction, extra, gates = decoded.split(self._outputs, 1)
        keep, take = torch.sigmoid(gates[:, 0] + 2), torch.sigmoid(gates[:, 1] + 1)
        ridge, damping = RIDGE * gates[:, 2:4].clamp(-STEEPEST_GATE, STEEPEST_GATE).exp().T
        limit, retreat = torch.sigmoid(gates[:, 4:5]), torch.sigmoid(gates[:, 5:])

        information = keep[:, None, None] * memory.information + take[:, None, None] * motion.information
        moment = keep[:, None, None] * memory.moment + take[:, None, None] * motion.moment
        jacobian = _jacobian(information, moment, LEAST_RIDGE + ridge, prior.view_as(moment))
        jacobian = jacobian + correction.view_as(moment)
        step = _gauss_newton(jacobian, motion.distance, LEAST_DAMPING + damping)
        step = torch.where(motion.seen[:, None], step, (1 - retreat) * step + retreat * motion.back)
        words = limit * torch.tanh((step + FREELY * extra) / limit) + self._tests(memory.looks)
        return words.clamp(-1, 1), RecurrentState(
            hidden=hidden,
            points=torch.where(motion.seen[:, None, None], points, memory.points),
            registers=torch.where(motion.seen[:, None], registers, memory.registers),
            seen=motion.seen | memory.seen,
            looks=memory.looks + 1,
            information=information,
            moment=moment,
        )

    def _tests(self, looks: Tensor) -> Tensor:
        """The test words (n, m) that are due after so many looks (n,); zero once all were sent."""
        testing = looks < self.motors
        return self.test_words[looks.clamp(max=self.motors - 1)] * testing[:, None]


class _Motion(NamedTuple):
    """What has changed since all points were seen last; zero where some are not seen now.

    Attributes:
        seen: Whether all points are seen now (n,).
        distance: d now (n, 4), of points as last seen.
        back: Words (n, m) that lead to where all were seen last.
        change: Of the registers (n, m).
        points_change: Of the image points (n, 8).
        distance_change: Of d (n, 4).
        information, moment: Δr Δrᵀ (n, m, m) and Δd Δrᵀ (n, 4, m), weighted.
    """

    seen: Tensor
    distance: Tensor
    back: Tensor
    change: Tensor
    points_change: Tensor
    distance_change: Tensor
    information: Tensor
    moment: Tensor


def _last_motion(points: Tensor, visible: Tensor, registers: Tensor, memory: RecurrentState) -> _Motion:
    seen = visible.all(1)
    moved = (seen & memory.seen).to(points.dtype)[:, None]
    points_change = (points - memory.points).flatten(1) * moved
    distance_change = points_change[:, :4] - points_change[:, 4:]
    back = memory.registers - registers
    change = -back * moved
    weighted = (moved / (change.square().sum(1, keepdim=True) + WORD_FLOOR**2) * change)[:, None]
    return _Motion(
        seen=seen,
        distance=(points[:, :2] - points[:, 2:]).flatten(1),
        back=back,
        change=change,
        points_change=points_change,
        distance_change=distance_change,
        information=change[:, :, None] * weighted,
        moment=distance_change[:, :, None] * weighted,
    )


def _inputs(
    points: Tensor, visible: Tensor, registers: Tensor, memory: RecurrentState, motion: _Motion
) -> Tensor:
    """What the network is shown (n, inputs); factors bring all to the order of one."""
    distance, change = motion.distance, motion.change
    information, moment = memory.information + motion.information, memory.moment + motion.moment
    plain = _jacobian(information, moment, PLAIN_RIDGE)
    lengths = distance.view(-1, 2, 2).square().sum(-1).add(1e-12).sqrt()
    return torch.cat(
        [
            points.flatten(1),
            visible.to(points.dtype),
            distance,
            registers,
            5 * change,
            3 * motion.points_change,
            distance / (lengths.amax(1, keepdim=True) + NOISE_FLOOR),
            torch.log(lengths + NOISE_FLOOR),
            0.3 * motion.distance_change / (change.norm(dim=1, keepdim=True) + WORD_FLOOR),
            (memory.looks == 0).to(points.dtype)[:, None],
            0.5 * plain.flatten(1),
            2 * _gauss_newton(plain, distance, PLAIN_DAMPING).clamp(-1, 1),
            2 * motion.back,
        ],
        1,
    )


def _jacobian(
    information: Tensor, moment: Tensor, ridge: Tensor | float, prior: Tensor | float = 0.0
) -> Tensor:
    """Estimate (n, 4, m) of J, drawn towards `prior` (n, 4, m) by the ridge (n,)."""
    ridge = torch.as_tensor(ridge).reshape(-1, 1, 1)
    identity = torch.eye(information.shape[-1], dtype=information.dtype)
    return (moment + ridge * prior) @ torch.linalg.inv(information + ridge * identity)


def _gauss_newton(jacobian: Tensor, distance: Tensor, damping: Tensor | float) -> Tensor:
    """The damped least-squares solution c (n, m) of J c = -d, with J (n, 4, m) and d (n, 4)."""
    transposed = jacobian.transpose(1, 2)
    identity = torch.eye(jacobian.shape[-1], dtype=jacobian.dtype)
    normal = transposed @ jacobian + torch.as_tensor(damping).reshape(-1, 1, 1) * identity
    return -(torch.linalg.inv(normal) @ transposed @ distance[:, :, None]).squeeze(-1)


KEPT = Path(__file__).parent / "weights.safetensors"
"""The network that comes with the code."""
_HEADER = "calfree"
_KIND = "recurrent_servo"
_FIELDS = ("observation_format", "hidden", "num_timesteps", "training")


def observation_format(observations: Any, actions: Any) -> dict[str, list[int]]:
    """Shapes of all that a network observes and sends, by key, of one robot's spaces."""
    spaces: Mapping[str, gym.Space[Any]] = getattr(observations, "spaces", {})
    shapes = {key: list(spaces[key].shape or ()) for key in STANDARD_KEYS if key in spaces}
    return shapes | {"words": list(actions.shape)}


def save_network(
    path: AgentFile,
    network: RecurrentServoNetwork,
    shapes: Mapping[str, list[int]],
    training: Mapping[str, Any],
    num_timesteps: int = 0,
) -> None:
    """Writes a network, what it observes (see `observation_format`) and how it was trained."""
    header = {
        "kind": _KIND,
        "observation_format": dict(shapes),
        "hidden": network.hidden,
        "num_timesteps": num_timesteps,
        "training": dict(training),
    }
    tensors = {name: tensor.float().contiguous() for name, tensor in network.state_dict().items()}
    with written(path) as file:
        file.write(save(tensors, {_HEADER: json.dumps(header)}))  # of several entries the order would change


def load_network(
    path: AgentFile, shapes: Mapping[str, list[int]]
) -> tuple[RecurrentServoNetwork, dict[str, Any], int]:
    """Reads a network that observes what `shapes` says, how it was trained, and its motions of `learn`.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is damaged, no such network, or of another observation format.
    """
    found = content(path)
    try:
        tensors = load(found)
        header = json.loads(_metadata(found).get(_HEADER, "{}"))
    except Exception as error:  # what is raised on a damaged file depends on where the damage is
        raise ValueError(f"{path} is damaged or no safetensors file: {error!r}") from error
    if not isinstance(header, dict):
        raise ValueError(f"{path} is damaged: its header is {header!r:.80}; it must be a mapping")
    if header.get("kind") != _KIND:
        raise ValueError(f"{path} holds {header.get('kind', 'no known agent')}; this agent is {_KIND}")
    if missing := [name for name in _FIELDS if name not in header]:
        raise ValueError(f"{path} is damaged: its header has no {', '.join(missing)}")
    try:
        hidden = check_number("hidden", header["hidden"], least=1, whole=True)
        recurrent = tensors.get("unit.weight_hh")
        if recurrent is None or recurrent.shape != (3 * hidden, hidden):
            raise ValueError(
                f"hidden is {hidden}, but its unit.weight_hh is {getattr(recurrent, 'shape', None)}"
            )
        motions = check_number("num_timesteps", header["num_timesteps"], least=0, whole=True)
        if not isinstance(header["training"], dict):
            raise ValueError(f"training is {header['training']!r:.80}; it must be a mapping")
    except ValueError as error:
        raise ValueError(f"{path} is damaged: {error}") from error
    saved = header["observation_format"]
    if saved != dict(shapes):
        raise ValueError(
            f"{path} is of a network with the observation format {saved}; here it is {dict(shapes)}: "
            "it acts where the keys and shapes are the same, with as many motors"
        )
    try:
        network = RecurrentServoNetwork(saved["words"][0], hidden)
        network.load_state_dict(tensors)
        if not all(torch.isfinite(tensor).all() for tensor in tensors.values()):
            raise ValueError("a weight is not finite")
    except (RuntimeError, ValueError) as error:
        raise ValueError(f"{path} is damaged: {error}") from error
    return network, header["training"], motions


def _metadata(found: bytes) -> dict[str, str]:
    """What stands in a safetensors file beside tensors: under one key of the JSON with which it begins."""
    size = int.from_bytes(found[:8], "little")
    metadata: dict[str, str] = json.loads(found[8 : 8 + size]).get("__metadata__", {})
    return metadata
