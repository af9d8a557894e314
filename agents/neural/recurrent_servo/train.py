"""Trains recurrent networks to servo: `python -m agents.neural.recurrent_servo.train --out FILE`.

Back-propagation through time and through the simulated robots minimises how far the gripper is from the
object after every motion. So test motions, what is concluded from them and the way to the object are learned
as one. The trainer knows the true image points and their derivatives by the registers; the network does not.

With `--features` it is the network of `in_context`, which keeps its memory from trial to trial; without, that
of `recurrent_servo`, which knows nothing at the beginning of each.
"""

import argparse
import math
import platform
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors.torch import load_file
from torch import Tensor, nn

from .network import RecurrentServoNetwork, RecurrentState, chosen, places_in, save_network
from .robots import MOTORS, MOUNTS, SHAPES, TOLERANCE, Look, TrainingRobots, cut, draw_worlds, worlds_on

GRADIENT_BOUND = 5.0
"""Of the loss of one robot by its words or its memory (a guard): few wild trials must not rule the batch."""
LONGEST = 12
"""Motions after which a trial ends without rendezvous. Choice, as all numbers here."""
NEW_LIFE, CHANGED = 0.15, 0.1
"""Shares of the robots that begin another life, and of which a camera changes, between two windows."""
OF_PLACES, MOST_SURPRISE = 0.02, 50.0
"""Weight of the negative log-likelihood of where an object is met, against that of a motion, and its most."""
CURVE = 26
"""Trials of a life that are told apart in what is printed; the last stands for all after."""

Step = Callable[..., tuple[Tensor, Tensor, Look, RecurrentState]]
"""`go_on`, or that compiled."""


class Window(NamedTuple):
    """What a window of motions came to.

    Attributes:
        loss: Mean over robots and motions ().
        motions: Made in the first, second, ... trials of a life (`CURVE`,).
        trials: Of these, how many ended (`CURVE`,).
    """

    loss: Tensor
    motions: Tensor
    trials: Tensor


def make_window(
    network: RecurrentServoNetwork,
    robots: TrainingRobots,
    memory: RecurrentState,
    motions: int,
    finishing: Tensor,
    step: Step,
) -> tuple[Window, RecurrentState]:
    """Lets all robots go on with the network; those that have reached their object begin the next trial.

    Args:
        network: Chooses the words.
        robots: Make the motions.
        memory: Of the lives so far.
        motions: So many, ways home included.
        finishing: Weight () in [0, 1] of the last pixels against the whole way, see `motion_loss`.
        step: One motion of all.

    Returns:
        What it came to, and the memory.
    """
    robots.detach()
    memory = RecurrentState(*(cut(part) for part in memory))
    look = robots.look()
    loss = finishing.new_zeros(())
    made, ended = loss.new_zeros(2, CURVE)
    for _ in range(motions):
        trial = (robots.trials - 1).clamp(max=CURVE - 1)
        cost, moved, look, memory = step(network, robots, look, memory, finishing)
        loss = loss + cost
        made, ended = made.scatter_add(0, trial, moved), ended.scatter_add(0, trial, 1 - moved)
    return Window(loss / motions, made, ended), memory


def go_on(
    network: RecurrentServoNetwork,
    robots: TrainingRobots,
    look: Look,
    memory: RecurrentState,
    finishing: Tensor,
) -> tuple[Tensor, Tensor, Look, RecurrentState]:
    """Each robot makes a motion, or, once the network has seen the end of the trial, begins the next.

    Returns:
        The loss (), which robots have made a motion (n,), what is seen now, and the memory.
    """
    over = look.reached | (robots.motions >= LONGEST)
    moved = (~over).to(finishing.dtype)
    loss = finishing.new_zeros(())
    if network.features:
        met = look.reached & (robots.motions > 0)
        surprise = places_in(memory).surprise(look.registers.detach()).clamp(max=MOST_SURPRISE)
        loss = OF_PLACES * (met * surprise).mean()
    words, memory = network(look.points, look.visible, look.registers, memory)
    memory = RecurrentState(*(bounded_gradient(part) for part in memory))
    memory = chosen(over, network.begin_trial(memory), memory)
    robots.move(bounded_gradient(words), ~over)
    robots.begin_trials(over)
    look = robots.look()
    return loss + (moved * motion_loss(look.true_points, finishing)).mean(), moved, look, memory


def finite(memory: RecurrentState) -> Tensor:
    """Whether all that a robot remembers is finite (n,)."""
    return torch.stack([part.flatten(1).isfinite().all(1) for part in memory if part.ndim > 1]).all(0)


def motion_loss(points: Tensor, finishing: Tensor) -> Tensor:
    """What a motion that ends at true image points (n, 4, 2) costs (n,).

    On the whole way the logarithm of the image distance counts, so that to halve it is worth as much far away
    as near. To finish, a smooth step about the tolerance counts: how many motions are yet to be made.
    """
    squares = (points[:, :2] - points[:, 2:]).square().sum(-1).clamp(max=9.0)
    way = 0.5 * torch.log1p(squares / (0.75 * TOLERANCE) ** 2).mean(1)
    worst = squares.amax(1)
    near, far = (worst / (worst + (k * TOLERANCE) ** 2) for k in (1.5, 7.5))
    return (1 - finishing) * way + finishing * (2 * near + 0.6 * far)


class _BoundedGradient(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, tensor: Tensor) -> Tensor:
        return tensor.view_as(tensor)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Tensor:
        gradient = torch.nan_to_num(gradient)
        lengths = gradient.flatten(1).norm(dim=1).clamp(min=1e-12)
        shares = (GRADIENT_BOUND / len(gradient) / lengths).clamp(max=1)
        return gradient * shares.view(-1, *[1] * (gradient.ndim - 1))


def bounded_gradient(tensor: Tensor) -> Tensor:
    """The same tensor (n, ...), through which the gradient of a row is at most `GRADIENT_BOUND` / n long."""
    return _BoundedGradient.apply(tensor) if tensor.is_floating_point() else tensor


CLIP = 0.5
"""Of the gradient's norm over all weights."""
WARM_UP = 100
"""Updates in which the learning rate rises."""
FINISHING = (0.2, 0.6)
"""Shares of the training between which the loss turns from the whole way to the last pixels."""
SAVED_EVERY = 60.0
"""Seconds between two writings of the file."""


def train(
    network: RecurrentServoNetwork,
    robots: TrainingRobots,
    motions: int,
    learning_rate: float,
    updates: int,
    seconds: float = math.inf,
    step: Step | None = None,
) -> Iterator[Window]:
    """Trains a network by windows of its robots' lives.

    Args:
        network: Changed in place.
        robots: In whose worlds it learns.
        motions: Of a window, after which the weights are updated; the gradient goes no further back.
        learning_rate: Of Adam at its height; it rises, and falls to a hundredth as half a cosine.
        updates: How many at most.
        seconds: For how long at most.
        step: One motion of all; `go_on` where none is given.

    Yields:
        What each window came to, once the weights are updated.
    """
    optimiser = torch.optim.Adam(network.parameters(), learning_rate)
    first, last = FINISHING
    device, memory = network.test_words.device, network.begin(robots.robots)
    started = time.monotonic()
    for update in range(updates):
        done = max(update / updates, (time.monotonic() - started) / seconds)
        if done >= 1:
            break
        rate = learning_rate * min(1.0, (update + 1) / WARM_UP) * (0.505 + 0.495 * math.cos(math.pi * done))
        for parameters in optimiser.param_groups:
            parameters["lr"] = rate
        begun = (torch.rand(robots.robots, device=device) < NEW_LIFE) | ~finite(memory)
        robots.change_cameras(torch.rand(robots.robots, device=device) < CHANGED)
        robots.begin_lives(begun)
        memory = chosen(begun, network.begin(robots.robots), memory)
        finishing = torch.full((), min(1.0, max(0.0, (done - first) / (last - first))), device=device)
        window, memory = make_window(network, robots, memory, motions, finishing, step or go_on)
        optimiser.zero_grad()
        window.loss.backward()
        norm = nn.utils.clip_grad_norm_(network.parameters(), CLIP)
        for each in network.parameters():
            if each.grad is not None:
                each.grad = torch.where(norm.isfinite(), each.grad, 0)
        optimiser.step()
        yield window._replace(loss=window.loss.detach())


def start_from(network: RecurrentServoNetwork, path: str) -> None:
    """Gives a network the weights of one without features; it begins as that one, but for what is new."""
    tensors = network.state_dict()
    for name, saved in load_file(path).items():
        tensors[name].zero_()[tuple(slice(size) for size in saved.shape)] = saved


PROGRAM = "python -m agents.neural.recurrent_servo.train"


def main(arguments: list[str] | None = None) -> None:
    """Reads the command line, trains, and writes the file."""
    parser = argparse.ArgumentParser(prog=PROGRAM, description="Trains recurrent networks to servo.")
    parser.add_argument("--out", required=True, help="file of weights, .safetensors")
    parser.add_argument("--seed", type=int, default=0, help="of weights and of what befalls the robots")
    parser.add_argument("--worlds-file", help=".npz of worlds: read if it is there, else written")
    parser.add_argument("--worlds-from", type=int, default=100_000, help="seed of the first training world")
    parser.add_argument("--worlds-a-mount", type=int, default=2048, help="of those")
    parser.add_argument("--robots", type=int, default=512, help="that live side by side")
    parser.add_argument("--updates", type=int, default=12_000, help="of the weights, at most")
    parser.add_argument("--minutes", type=float, default=1e6, help="of training, at most")
    parser.add_argument("--motions", type=int, default=16, help="between two updates, ways home included")
    parser.add_argument("--hidden", type=int, default=128, help="width of the network")
    parser.add_argument("--features", type=int, default=0, help="of places; 0: nothing outlasts a trial")
    parser.add_argument("--start", help="file of weights of a network without features, to begin with")
    parser.add_argument("--learning-rate", type=float, default=1e-3, help="of Adam")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--compile", action="store_true", help="let torch.compile fuse kernels")
    given = parser.parse_args(arguments)

    torch.set_num_threads(1)
    torch.manual_seed(given.seed)
    device = torch.device(given.device)
    worlds = worlds_on(device, _worlds(given))
    network = RecurrentServoNetwork(MOTORS, given.hidden, given.features)
    if given.start:
        start_from(network, given.start)
    network.to(device)
    robots = TrainingRobots(worlds, given.robots)
    print(f"{len(worlds.noise)} worlds, {time.process_time() / 60:.1f} CPU minutes", flush=True)
    step = torch.compile(go_on, dynamic=False) if given.compile else go_on
    progress = train(
        network, robots, given.motions, given.learning_rate, given.updates, 60 * given.minutes, step
    )
    started = said = saved = time.monotonic()
    recent: list[Window] = []
    update = 0
    for update, window in enumerate(progress, 1):
        recent.append(window)
        if (now := time.monotonic()) > said + SAID_EVERY:
            print(f"update {update}, {(now - started) / 60:.1f} minutes: {_in_words(recent)}", flush=True)
            recent.clear()
            said = now
        if now > saved + SAVED_EVERY:
            save_network(given.out, network, SHAPES, _record(given, update, started))
            saved = now
    save_network(given.out, network, SHAPES, _record(given, update, started))


SAID_EVERY = 10.0
"""Seconds between two lines."""
SPANS = {"1": (0, 1), "2-5": (1, 5), "6-25": (5, 25), "later": (25, 26)}
"""Of trials, in these lines."""


def _in_words(windows: list[Window]) -> str:
    loss, motions, trials = (torch.stack(each).mean(0).cpu() for each in zip(*windows, strict=True))
    by_trial = (motions[slice(*span)].sum() / trials[slice(*span)].sum() for span in SPANS.values())
    lengths = ", ".join(f"{length:.2f} in {name}" for name, length in zip(SPANS, by_trial, strict=True))
    return f"loss {loss:.4f}, motions a trial {lengths}"


def _worlds(given: argparse.Namespace) -> dict[str, NDArray[np.float32]]:
    """Worlds on both mounts, from the file that was given, or drawn."""
    if given.worlds_file and Path(given.worlds_file).exists():
        worlds = dict(np.load(given.worlds_file))
        if (count := len(worlds["noise"])) != len(MOUNTS) * given.worlds_a_mount:
            raise ValueError(f"{given.worlds_file} holds {count} worlds, not --worlds-a-mount of each")
        return worlds
    drawn = [
        draw_worlds(given.worlds_a_mount, mount, given.worlds_from + i * given.worlds_a_mount)
        for i, mount in enumerate(MOUNTS)
    ]
    worlds = {name: np.concatenate([each[name] for each in drawn]) for name in drawn[0]}
    if given.worlds_file:
        np.savez_compressed(given.worlds_file, **worlds)
    return worlds


NOT_SETTINGS = ("out", "worlds_file", "compile")
"""Options that do not say what is trained."""


def _record(given: argparse.Namespace, updates_made: int, started: float) -> dict[str, object]:
    """How a network came about, for its file."""
    settings = {
        name: value for name, value in vars(given).items() if value is not None and name not in NOT_SETTINGS
    }
    command = " ".join(f"--{key.replace('_', '-')} {value}" for key, value in settings.items())
    last = given.worlds_from + len(MOUNTS) * given.worlds_a_mount - 1
    return {
        "command": f"{PROGRAM} {command} --out FILE",
        **settings,
        "updates_made": updates_made,
        "worlds": f"wild, kinematic, seeds {given.worlds_from} to {last}, mounts {' and '.join(MOUNTS)}",
        "learned_by": "analytic gradient of the image distance through the simulated robots",
        "cpu_minutes": round(time.process_time() / 60, 1),
        "wall_minutes": round((time.monotonic() - started) / 60, 1),
        "hardware": torch.cuda.get_device_name() if given.device.startswith("cuda") else "one core",
        "versions": {"python": platform.python_version()} | dict(_versions()),
    }


def _versions() -> Iterator[tuple[str, str]]:
    for name in ("torch", "numpy", "gymnasium", "mujoco", "safetensors"):
        with suppress(PackageNotFoundError):  # worlds may have been drawn elsewhere
            yield name, version(name)


if __name__ == "__main__":
    main()
