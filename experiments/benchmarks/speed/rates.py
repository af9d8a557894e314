"""Speed as ratios, measured in turns within one run, so that a drifting machine cancels."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from importlib.metadata import version
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
from mujoco.batch import Batch

from calfree_gym import Arm
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.simulation import SUBSTEPS
from experiments.benchmarks.speed.peer import Peer

REACH = "calfree_gym:CalFree/Reach-v0"
ROUNDS = 60
FLOORS = {("PandaReach-v3", 1): 5.0, ("PandaReach-v3", 256): 9.0}
"""The least ratio of physics substeps a second that the project asks of itself beside a peer, by our rows."""


def _bare_model(arm: Arm | None = None) -> mujoco.MjModel:
    """An arm, the built-in one by default, with its cameras on the waist, and no environment around it."""
    robot = MOVEMASTER if arm is None else arm.robot
    return robot.scene(robot.mounts("waist")).model


WAIST_TIMESTEP = float(_bare_model().opt.timestep)


@dataclass(frozen=True)
class Ratio:
    """One line of the benchmark.

    Attributes:
        name: What was compared with what.
        unit: What is counted a second: "environment steps", "physics substeps" or "simulated seconds".
        ratio: Median over rounds of our rate by the other's, each pair timed in turn.
        wanted: The least that the project asks of itself, if it asks.
        ours, other: Counts a second, medians.
        rounds: How many pairs.
    """

    name: str
    unit: str
    ratio: float
    wanted: float | None
    ours: float
    other: float
    rounds: int


@dataclass(frozen=True)
class Speed:
    """All lines of one benchmark, and where it was made."""

    ratios: tuple[Ratio, ...]
    machine: dict[str, Any]

    def to_dict(self) -> dict[str, Any]:
        """As plain values, for JSON."""
        return asdict(self)


def speed(peers: Sequence[str] = (), rounds: int = ROUNDS) -> Speed:
    """Measures all ratios; peers, as "PYTHON=ENV_ID", beside them.

    Raises:
        ConfigError: A peer cannot be had.
    """
    machine: dict[str, Any] = {
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        **{name: version(name) for name in ("mujoco", "gymnasium", "numpy", "stable-baselines3", "torch")},
    }
    with ExitStack() as stack:
        others = [stack.enter_context(Peer(spec)) for spec in peers]
        ratios = [_single(rounds, truth=False, wanted=0.88), _single(rounds, truth=True, wanted=None)]
        ratios += [_single(rounds, truth=False, wanted=None, sensors=False)]
        ratios += [batched(rounds), _kinematic(rounds)]
        ratios += [_ppo("kinematic", 0.70, rounds), _ppo("physics", None, rounds)]
        for peer in others:
            for rows in (1, 256):
                ratios += _beside(peer, rows, FLOORS.get((peer.env_id, rows)), rounds)
            machine[peer.env_id] = " ".join(f"{k} {v}" for k, v in peer.versions.items())
    return Speed(tuple(ratios), machine)


def _single(rounds: int, truth: bool, wanted: float | None, sensors: bool = True) -> Ratio:
    """One environment against `mj_step` over the same substeps, one thread.

    `mj_step` computes sensors in every substep, our environment once a motion; without `sensors`, the bare
    loop computes none.
    """
    steps = 50
    model = _bare_model()
    if not sensors:
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
    data = mujoco.MjData(model)

    def bare() -> None:
        for _ in range(steps * SUBSTEPS):
            mujoco.mj_step(model, data)

    ours, other = "" if truth else ", truth=False", "" if sensors else " without sensors"
    name = f"one environment{ours} / bare mj_step{other}"
    with pinned(1):
        return _ratio(name, wanted, stepping(1, steps, truth=truth), bare, steps, rounds)


def batched(rounds: int = ROUNDS, arm: Arm | None = None, wanted: float = 0.93) -> Ratio:
    """256 rows on all cores against a bare `Batch` of the same model over the same substeps.

    Args:
        rounds: Pairs that are timed.
        arm: The arm; the built-in one by default.
        wanted: The ratio that is asked for.
    """
    rows, steps = 256, 4
    batch = Batch(_bare_model(arm), rows)

    def bare() -> None:
        for _ in range(steps):
            batch.step(nstep=SUBSTEPS)

    name = f"{rows} rows / bare Batch"
    arguments = {} if arm is None else {"arm": arm}
    return _ratio(name, wanted, stepping(rows, steps, **arguments), bare, steps * rows, rounds)


def _kinematic(rounds: int) -> Ratio:
    """1,024 rows of kinematic dynamics on all cores against a bare `Batch.forward(POS)`."""
    rows, steps = 1024, 60
    batch = Batch(_bare_model(), rows)
    stage = int(mujoco.mjtStage.mjSTAGE_POS)

    def bare() -> None:
        for _ in range(steps):
            batch.forward(stage=stage)

    name = f"{rows:,} kinematic rows / bare Batch.forward(POS)"
    ours = stepping(rows, steps, dynamics="kinematic")
    return _ratio(name, 0.50, ours, bare, steps * rows, rounds)


def _ppo(dynamics: str, wanted: float | None, rounds: int) -> Ratio:
    """PPO through `make_sb3_env` against PPO on an environment that costs nothing, 64 rows, defaults."""
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecMonitor

    from calfree_gym.sb3 import make_sb3_env
    from experiments.benchmarks.speed.free_env import FreeVecEnv

    torch.set_num_threads(1)
    rows, steps = 64, 64
    env = make_sb3_env(n_envs=rows, dynamics=dynamics)
    free = VecMonitor(FreeVecEnv(rows, env.observation_space, env.action_space))
    ours, other = (PPO("MultiInputPolicy", each, n_steps=steps, seed=0, device="cpu") for each in (env, free))

    def learning(model: PPO) -> Callable[[], object]:
        return lambda: model.learn(rows * steps, reset_num_timesteps=False)

    name = f"PPO, 64 {dynamics} rows / PPO on a free environment"
    rounds = max(rounds // 6, 1)
    return _ratio(name, wanted, learning(ours), learning(other), rows * steps, rounds)


def _beside(peer: Peer, rows: int, wanted: float | None, rounds: int) -> list[Ratio]:
    """Our environment, on one core or in rows on all, against a peer's, which has one row."""
    steps = 50 if rows == 1 else 4
    ours_steps = stepping(rows, steps)
    seconds = np.empty((rounds, 2))
    with pinned(1 if rows == 1 else os.cpu_count() or 1):
        for row in seconds:
            row[:] = _seconds(ours_steps), peer.seconds(50)
    ours, other = (steps * rows, 50) / np.median(seconds, axis=0)
    ratio = float(np.median(seconds[:, 1] / seconds[:, 0])) * steps * rows / 50
    name = f"{'one environment' if rows == 1 else f'{rows} rows'} / {peer.env_id}"
    found = [Ratio(name, "environment steps", ratio, None, float(ours), float(other), rounds)]
    if peer.substeps:
        more = SUBSTEPS / peer.substeps
        rates = float(ours) * SUBSTEPS, float(other) * peer.substeps
        found.append(Ratio(name, "physics substeps", ratio * more, wanted, *rates, rounds))
        if peer.timestep:
            more *= WAIST_TIMESTEP / peer.timestep
            rates = rates[0] * WAIST_TIMESTEP, rates[1] * peer.timestep
            found.append(Ratio(name, "simulated seconds", ratio * more, None, *rates, rounds))
    return found


def stepping(rows: int, steps: int, **arguments: Any) -> Callable[[], None]:
    """Makes motions there and back again, so that registers stay where they can be."""
    env: Any
    if rows == 1:
        env = gym.make(REACH, terminate_on_success=False, **arguments).unwrapped
    else:
        env = gym.make_vec(REACH, num_envs=rows, **arguments)
    shape = (steps, *env.action_space.shape)
    words = np.random.default_rng(0).uniform(-0.1, 0.1, shape).astype(np.float32)
    words[1::2] = -words[::2]
    env.reset(seed=0)

    def ours() -> None:
        for word in words:
            env.step(word)

    return ours


def _ratio(
    name: str,
    wanted: float | None,
    ours: Callable[[], object],
    other: Callable[[], object],
    steps: int,
    rounds: int,
) -> Ratio:
    seconds = np.array([(_seconds(ours), _seconds(other)) for _ in range(rounds)])
    ratio = float(np.median(seconds[:, 1] / seconds[:, 0]))
    ours_s, other_s = np.median(seconds, axis=0)
    return Ratio(
        name, "environment steps", ratio, wanted, steps / float(ours_s), steps / float(other_s), rounds
    )


def _seconds(function: Callable[[], object]) -> float:
    start = time.perf_counter()
    function()
    return time.perf_counter() - start


@contextmanager
def pinned(cores: int) -> Iterator[None]:
    """Holds the process to this many cores, where the system can."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, set(sorted(before)[:cores]))
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)
