"""The recurrent network: image points and registers in, control words out, all memory of one trial between.

Its memory is a gated recurrent unit (Cho et al. 2014) and a least-squares estimate of the Jacobian. The unit
decides how far the estimate is to be trusted, forgotten and corrected; a damped Gauss-Newton step follows.
Where a point is lost, the step leads some of the way back to where all points were seen last.

With features, all of this outlasts the trial (RL²; Duan et al. 2016), with a regression of where objects
were met (see `places`), towards which the step leads as far as the unit trusts it.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import torch
from safetensors.torch import load, save
from torch import Tensor, nn

from calfree_gym.image import IMAGE_UNIT

from ...base.checks import check_number
from ...base.observation import STANDARD_KEYS
from ...base.storage import AgentFile, content, written
from .places import LEAST_VARIANCE, Features, PlaceRegression

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
PLACE_GATES = 3
"""Numbers that rule the regression: trust, variance, forget."""
RIGHT_BY, WRONG_BY = 1e-5, 0.1
"""Variance of the place to which a step leads: of one of no length, and by the square of its length. Choice;
the unit multiplies both."""


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
        weights, covariance, features: See `PlaceRegression`; empty without features.
        home: The gripper's sensor vector (n, 4) when this trial began.
        jump: By how much it was another one than in the trial before (n, 4).
    """

    hidden: Tensor
    points: Tensor
    registers: Tensor
    seen: Tensor
    looks: Tensor
    information: Tensor
    moment: Tensor
    weights: Tensor
    covariance: Tensor
    features: Tensor
    home: Tensor
    jump: Tensor


class RecurrentServoNetwork(nn.Module):
    """Maps an observation and its memory to control words and the next memory.

    Args:
        motors: m.
        hidden: Width h of the recurrent unit and of the layers around it.
        features: Of places; 0: it keeps nothing from trial to trial.
    """

    def __init__(self, motors: int = 3, hidden: int = 128, features: int = 0) -> None:
        super().__init__()
        self.motors, self.hidden, self.features = motors, hidden, features
        self._outputs = [COORDINATES * motors, COORDINATES * motors, motors, GATES]
        inputs = 35 + (4 + COORDINATES) * motors  # see `_inputs`
        if features:
            self._outputs.append(PLACE_GATES)
            inputs += 1 + COORDINATES + motors  # see `_of_places`
            self.of_view = Features(features, hidden)
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
        """The memory of `robots` robots that know nothing."""
        like = self.test_words.new_zeros
        return RecurrentState(
            hidden=like(robots, self.hidden),
            points=like(robots, 4, 2),
            registers=like(robots, self.motors),
            seen=like(robots, dtype=torch.bool),
            looks=like(robots, dtype=torch.long),
            information=like(robots, self.motors, self.motors),
            moment=like(robots, COORDINATES, self.motors),
            weights=like(robots, self.motors, self.features),
            covariance=torch.diag_embed(like(robots, self.features) + 1),
            features=like(robots, self.features),
            home=like(robots, COORDINATES),
            jump=like(robots, COORDINATES),
        )

    def begin_trial(self, memory: RecurrentState) -> RecurrentState:
        """The memory at the beginning of a robot's next trial."""
        if not self.features:
            return self.begin(len(memory.looks))
        return memory._replace(
            points=torch.zeros_like(memory.points),
            registers=torch.zeros_like(memory.registers),
            seen=torch.zeros_like(memory.seen),
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
        if self.features:
            memory = self._first_view(points, memory, motion)
            inputs = torch.cat([inputs, _of_places(registers, memory)], 1)
        hidden = self.unit(self.encoder(inputs), memory.hidden)
        decoded = self.decoder(torch.cat([hidden, inputs], 1))
        prior, correction, extra, gates, *place_gates = decoded.split(self._outputs, 1)
        keep, take = torch.sigmoid(gates[:, 0] + 2), torch.sigmoid(gates[:, 1] + 1)
        ridge, damping = RIDGE * gates[:, 2:4].clamp(-STEEPEST_GATE, STEEPEST_GATE).exp().T
        limit, retreat = torch.sigmoid(gates[:, 4:5]), torch.sigmoid(gates[:, 5:])

        information = keep[:, None, None] * memory.information + take[:, None, None] * motion.information
        moment = keep[:, None, None] * memory.moment + take[:, None, None] * motion.moment
        jacobian = _jacobian(information, moment, LEAST_RIDGE + ridge, prior.view_as(moment))
        jacobian = jacobian + correction.view_as(moment)
        step = _gauss_newton(jacobian, motion.distance, LEAST_DAMPING + damping)
        if self.features:
            step, memory = _by_places(step, registers, memory, motion, *place_gates)
        step = torch.where(motion.seen[:, None], step, (1 - retreat) * step + retreat * motion.back)
        words = limit * torch.tanh((step + FREELY * extra) / limit) + self._tests(memory.looks)
        return words.clamp(-1, 1), memory._replace(
            hidden=hidden,
            points=torch.where(motion.seen[:, None, None], points, memory.points),
            registers=torch.where(motion.seen[:, None], registers, memory.registers),
            seen=motion.seen | memory.seen,
            looks=memory.looks + 1,
            information=information,
            moment=moment,
        )

    def _first_view(self, points: Tensor, memory: RecurrentState, motion: "_Motion") -> RecurrentState:
        """The memory with what is seen when all points are seen for the first time in a trial."""
        first = (motion.seen & ~memory.seen)[:, None]
        home = points[:, :2].flatten(1)
        jump = (home - memory.home) * (memory.looks > 0)[:, None]
        return memory._replace(
            features=torch.where(first, self.of_view(points.flatten(1)), memory.features),
            home=torch.where(first, home, memory.home),
            jump=torch.where(first, jump, memory.jump),
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


def places_in(memory: RecurrentState) -> PlaceRegression:
    """The regression in a memory."""
    return PlaceRegression(memory.weights, memory.covariance, memory.features)


def _of_places(registers: Tensor, memory: RecurrentState) -> Tensor:
    """What the network is shown of the regression (n, 5 + m), and of how the gripper's view has jumped."""
    places = places_in(memory)
    way = (places.registers - registers).clamp(-1, 1)
    doubt = 0.5 * torch.log(places.variance + LEAST_VARIANCE)[:, None]
    return torch.cat([2 * way, 0.3 * doubt, 3 * memory.jump], 1)


def _by_places(
    step: Tensor, registers: Tensor, memory: RecurrentState, motion: "_Motion", gates: Tensor
) -> tuple[Tensor, RecurrentState]:
    """A step (n, m) that leads to where the object is expected, once the regression is told of it."""
    steepness = gates.clamp(-STEEPEST_GATE, STEEPEST_GATE)
    trust, forget = torch.sigmoid(gates[:, :1] - 2), torch.sigmoid(2 * steepness[:, 2] - 6)
    step = step.clamp(-1, 1)
    variance = LEAST_VARIANCE + steepness[:, 1].exp() * (RIGHT_BY + WRONG_BY * step.square().sum(1))
    variance = torch.where(motion.seen, variance, torch.inf)
    places = places_in(memory).forgotten(forget).told(registers + step, variance)
    step = step + trust * (places.registers - registers - step)
    return step, memory._replace(**places._asdict())


def _jacobian(
    information: Tensor, moment: Tensor, ridge: Tensor | float, prior: Tensor | float = 0.0
) -> Tensor:
    """Estimate (n, 4, m) of J, drawn towards `prior` (n, 4, m) by the ridge (n,)."""
    ridge = _of_each(ridge, information)
    return (moment + ridge * prior) @ _inverse(information + ridge * _identity(information))


def _gauss_newton(jacobian: Tensor, distance: Tensor, damping: Tensor | float) -> Tensor:
    """The damped least-squares solution c (n, m) of J c = -d, with J (n, 4, m) and d (n, 4)."""
    transposed = jacobian.transpose(1, 2)
    normal = transposed @ jacobian + _of_each(damping, jacobian) * _identity(jacobian)
    return -(_inverse(normal) @ transposed @ distance[:, :, None]).squeeze(-1)


def _of_each(number: Tensor | float, matrices: Tensor) -> Tensor:
    """A number (n, 1, 1) of each matrix, or of all."""
    if not isinstance(number, Tensor):
        number = torch.full((1,), number, device=matrices.device)
    return number.reshape(-1, 1, 1)


def _identity(matrices: Tensor) -> Tensor:
    return torch.eye(matrices.shape[-1], dtype=matrices.dtype, device=matrices.device)


def _inverse(matrices: Tensor) -> Tensor:
    """Inverses (n, m, m), without the check for which a device would have to be waited for."""
    return torch.linalg.inv_ex(matrices).inverse


Tensors = TypeVar("Tensors", bound=tuple[Tensor, ...])


def chosen(where: Tensor, first: Tensors, second: Tensors) -> Tensors:
    """Two named tuples of tensors (n, ...) as one: the first where (n,) so marked, else the second."""
    return type(first)(
        *(
            torch.where(where.reshape(-1, *[1] * (old.ndim - 1)), new, old)
            for new, old in zip(first, second, strict=True)
        )
    )


KEPT = {
    "recurrent_servo": Path(__file__).parent / "weights.safetensors",
    "in_context": Path(__file__).parent / "in_context.safetensors",
}
"""The networks that come with the code, by agent."""
_HEADER = "calfree"
_FIELDS = ("observation_format", "hidden", "num_timesteps", "training")
_LIFE = "life."
"""Begins the names of tensors that are memory, not weights."""


class SavedNetwork(NamedTuple):
    """What stands in a file of weights.

    Attributes:
        network: The network.
        training: How it was trained.
        num_timesteps: Motions of `learn`.
        life: Its memory of one robot, where it keeps one from trial to trial.
    """

    network: RecurrentServoNetwork
    training: dict[str, Any]
    num_timesteps: int
    life: RecurrentState


def observation_format(observations: Any, actions: Any) -> dict[str, list[int]]:
    """Shapes of all that a network observes and sends, by key, of one robot's spaces."""
    spaces: Mapping[str, Any] = getattr(observations, "spaces", {})
    shapes = {key: list(spaces[key].shape or ()) for key in STANDARD_KEYS if key in spaces}
    return shapes | {"words": list(actions.shape)}


def kind_of(features: int) -> str:
    """The agent whose network has so many features."""
    return "in_context" if features else "recurrent_servo"


def save_network(
    path: AgentFile,
    network: RecurrentServoNetwork,
    shapes: Mapping[str, list[int]],
    training: Mapping[str, Any],
    num_timesteps: int = 0,
    life: RecurrentState | None = None,
) -> None:
    """Writes what `load_network` reads: see `SavedNetwork`, and `observation_format` for the shapes."""
    header = {
        "kind": kind_of(network.features),
        "observation_format": dict(shapes),
        "hidden": network.hidden,
        "num_timesteps": num_timesteps,
        "training": dict(training),
    }
    if network.features:
        header["features"] = network.features
    tensors = {
        name: tensor.detach().float().cpu().contiguous() for name, tensor in network.state_dict().items()
    }
    if life is not None:
        tensors |= {_LIFE + name: part.contiguous() for name, part in life._asdict().items()}
    with written(path) as file:
        file.write(save(tensors, {_HEADER: json.dumps(header)}))  # of several entries the order would change


def load_network(
    path: AgentFile, shapes: Mapping[str, list[int]], kind: str = "recurrent_servo"
) -> SavedNetwork:
    """Reads a network that observes what `shapes` says.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is damaged, of another agent than `kind`, or of another observation format.
    """
    found = content(path)
    try:
        tensors = load(found)
        header = json.loads(_metadata(found).get(_HEADER, "{}"))
    except Exception as error:  # what is raised on a damaged file depends on where the damage is
        raise ValueError(f"{path} is damaged or no safetensors file: {error!r}") from error
    if not isinstance(header, dict):
        raise ValueError(f"{path} is damaged: its header is {header!r:.80}; it must be a mapping")
    if header.get("kind") != kind:
        raise ValueError(f"{path} holds {header.get('kind', 'no known agent')}; this agent is {kind}")
    if missing := [name for name in _FIELDS if name not in header]:
        raise ValueError(f"{path} is damaged: its header has no {', '.join(missing)}")
    try:
        hidden = check_number("hidden", header["hidden"], least=1, whole=True)
        recurrent = tensors.get("unit.weight_hh")
        if recurrent is None or recurrent.shape != (3 * hidden, hidden):
            raise ValueError(
                f"hidden is {hidden}, but its unit.weight_hh is {getattr(recurrent, 'shape', None)}"
            )
        features = check_number("features", header.get("features", 0), least=0, most=1000, whole=True)
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
        network = RecurrentServoNetwork(saved["words"][0], hidden, features)
        lived = {name: tensors.pop(name) for name in [*tensors] if name.startswith(_LIFE)}
        network.load_state_dict(tensors)
        network = network.double().requires_grad_(False)
        life = network.begin(1)
        if lived:
            life = RecurrentState(**{name.removeprefix(_LIFE): part for name, part in lived.items()})
        if [part.shape for part in life] != [part.shape for part in network.begin(1)]:
            raise ValueError("its memory does not fit")
        if not all(torch.isfinite(tensor).all() for tensor in (*tensors.values(), *life)):
            raise ValueError("a weight is not finite")
    except (RuntimeError, TypeError, ValueError) as error:
        raise ValueError(f"{path} is damaged: {error}") from error
    return SavedNetwork(network, header["training"], motions, life)


def _metadata(found: bytes) -> dict[str, str]:
    """What stands in a safetensors file beside tensors: under one key of the JSON with which it begins."""
    size = int.from_bytes(found[:8], "little")
    metadata: dict[str, str] = json.loads(found[8 : 8 + size]).get("__metadata__", {})
    return metadata
