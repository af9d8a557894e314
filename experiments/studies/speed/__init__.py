"""Speed as ratios, measured in turns within one run, so that a drifting machine cancels."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from importlib.metadata import version
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple, Self

import gymnasium as gym
import mujoco
import numpy as np
import pandas as pd
import torch
from mujoco.batch import Batch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecMonitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

import agents
from calfree_gym import Arm
from calfree_gym.engine.sight import SHADOWS_FROM
from calfree_gym.image import CAMERAS, IMAGE_SIZE
from calfree_gym.rendering.renderer import current, drawing_context, gl_context
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.simulation import SUBSTEPS
from calfree_gym.sb3 import make_sb3_env
from experiments.errors import ConfigError
from experiments.reporting.tables import Table
from experiments.studies.common import REACH, arms_of_tests

GRASP = "calfree_gym:CalFree/Grasp-v0"
ROUNDS = 60
FLOORS = {("PandaReach-v3", 1): 5.0, ("PandaReach-v3", 256): 9.0}
"""The least ratio of physics substeps a second that the project asks of itself beside a peer, by our rows."""
SMALL = 84
"""Width and height in pixels of the images of `"pixels"`, as networks take them."""
FREE, HELD = "jaws free", "object held"
WORDS = {FREE: 0.1, HELD: 0.03}
"""The largest words: what is held is carried about, and not pressed on the table."""
BESIDE_MUJOCO, BESIDE_BATCH, BESIDE_REACH = 0.85, 0.90, {FREE: 0.40, HELD: 0.25}
"""What the project asks of itself where something is grasped."""
_FORMATS = {"ratio": ".2f", "required": ".2f", "ours a second": ",.0f", "other a second": ",.0f"}

Rate = Callable[[], float]
"""Does something, and tells how much of it a second."""


def _bare_model(arm: Arm | None = None) -> mujoco.MjModel:
    """An arm, the built-in one by default, with its cameras on the waist, and no environment around it."""
    robot = MOVEMASTER if arm is None else arm.robot
    return robot.scene(robot.mounts("waist")).model


WAIST_TIMESTEP = float(_bare_model().opt.timestep)


class Ratio(NamedTuple):
    """One line of a table.

    Attributes:
        name: What was compared with what.
        unit: What is counted a second: "environment steps", "looks", "physics substeps", "simulated seconds".
        ratio: Median over rounds of our rate by the other's, each pair timed in turn.
        required: The least that the project asks of itself, if it asks.
        ours, other: Counts a second, medians.
        rounds: How many pairs.
    """

    name: str
    unit: str
    ratio: float
    required: float | None
    ours: float
    other: float
    rounds: int

    def by(self, unit: str, more: tuple[float, float], required: float | None = None) -> Ratio:
        """In another unit, of which both sides' have so many."""
        ours, other = more
        ratio = self.ratio * ours / other
        return Ratio(self.name, unit, ratio, required, self.ours * ours, self.other * other, self.rounds)


def tables(peers: Sequence[str] = (), rounds: int = ROUNDS) -> Iterator[Table]:
    """All ratios: reaching, looks, peers beside it, grasping, and other arms.

    Args:
        peers: As "PYTHON=ENV_ID".
        rounds: Pairs that are timed.

    Raises:
        ConfigError: A peer cannot be had.
    """
    packages = ("mujoco", "gymnasium", "numpy", "stable-baselines3", "torch")
    machine: dict[str, Any] = {"cores": os.cpu_count(), "python": platform.python_version()}
    machine |= {name: version(name) for name in packages}
    with ExitStack() as stack:
        others = [stack.enter_context(Peer(spec)) for spec in peers]
        ratios = [_single(rounds, truth=False, required=0.88), _single(rounds, truth=True)]
        ratios += [_single(rounds, truth=False, sensors=False), _batched(rounds), _kinematic(rounds)]
        ratios += [_ppo("kinematic", 0.70, rounds), _ppo("physics", None, rounds)]
        ratios += [_look("vision", IMAGE_SIZE, rounds), _look("pixels", SMALL, rounds)]
        for peer in others:
            for rows in (1, 256):
                ratios += _beside(peer, rows, FLOORS.get((peer.env_id, rows)), rounds)
            machine[peer.env_id] = " ".join(f"{k} {v}" for k, v in peer.versions.items())
    told = ", ".join(f"{key} {value}" for key, value in machine.items())
    yield _table("speed", "Speed, as ratios", ratios, told)
    note = f"Physics substeps; a motion has as many as its way is long. Wild worlds, waist mount. {told}"
    yield _table("grasping", "Grasping", list(_grasping(max(rounds // 3, 1))), note)
    of_arms = [
        _batched(max(rounds // 3, 1), Arm.from_dict(given), f", {name}", 0.9)
        for name, given in arms_of_tests().items()
    ]
    yield _table("arms_speed", "Other arms, 256 rows at once", of_arms, told)


def _table(name: str, title: str, ratios: list[Ratio], note: str) -> Table:
    frame = pd.DataFrame(ratios).rename(
        columns={"name": "row", "ours": "ours a second", "other": "other a second"}
    )
    return Table(name, title, frame, _FORMATS, note)


def _single(rounds: int, truth: bool, required: float | None = None, sensors: bool = True) -> Ratio:
    """One environment against `mj_step` over the same substeps, one thread.

    `mj_step` computes sensors in every substep, our environment once a motion; without `sensors`, the bare
    loop computes none.
    """
    steps = 50
    model = _bare_model()
    if not sensors:
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
    bare = _bare(model, mujoco.MjData(model), steps * SUBSTEPS)
    ours, other = "" if truth else ", truth=False", "" if sensors else " without sensors"
    name = f"one environment{ours} / bare mj_step{other}"
    with pinned(1):
        return _ratio(
            name, required, rate_of(stepping(1, steps, truth=truth), steps), rate_of(bare, steps), rounds
        )


def _bare(model: mujoco.MjModel, data: mujoco.MjData, substeps: int) -> Callable[[], None]:
    def bare() -> None:
        for _ in range(substeps):
            mujoco.mj_step(model, data)

    return bare


def _batched(rounds: int = ROUNDS, arm: Arm | None = None, named: str = "", required: float = 0.93) -> Ratio:
    """256 rows on all cores against a bare `Batch` of the same model over the same substeps."""
    rows, steps = 256, 4
    batch = Batch(_bare_model(arm), rows)

    def bare() -> None:
        for _ in range(steps):
            batch.step(nstep=SUBSTEPS)

    ours = stepping(rows, steps, **({} if arm is None else {"arm": arm}))
    made = steps * rows
    return _ratio(
        f"{rows} rows / bare Batch{named}", required, rate_of(ours, made), rate_of(bare, made), rounds
    )


def _kinematic(rounds: int) -> Ratio:
    """1,024 rows of kinematic dynamics on all cores against a bare `Batch.forward(POS)`."""
    rows, steps = 1024, 60
    batch = Batch(_bare_model(), rows)
    stage = int(mujoco.mjtStage.mjSTAGE_POS)

    def bare() -> None:
        for _ in range(steps):
            batch.forward(stage=stage)

    name = f"{rows:,} kinematic rows / bare Batch.forward(POS)"
    ours, made = stepping(rows, steps, dynamics="kinematic"), steps * rows
    return _ratio(name, 0.50, rate_of(ours, made), rate_of(bare, made), rounds)


def _look(observation: str, size: int, rounds: int, rows: int = 64) -> Ratio:
    """A look of many rows, kinematic, against bare `mjr_render`: as many pairs, alike in size and quality."""
    image: dict[str, Any] = {} if observation == "vision" else {"image_size": size}
    envs: Any = gym.make_vec(REACH, rows, dynamics="kinematic", observation=observation, **image)
    words = _there_and_back((2, *envs.action_space.shape), 0.1)
    envs.reset(seed=0)

    def ours() -> None:
        for word in words:
            envs.step(word)

    pairs = 8
    model, data = envs.unwrapped.arms._sight._renderer.picture
    bare = _bare_pairs(model, data, size, pairs)
    bare()  # OpenGL compiles what it needs
    name, looks = f"{rows} rows of {observation}, {size} px / pairs by bare mjr_render", rows * len(words)
    return _ratio(name, None, rate_of(ours, looks), rate_of(bare, pairs), max(rounds // 6, 1), "looks")


def _bare_pairs(model: mujoco.MjModel, data: mujoco.MjData, size: int, pairs: int) -> Callable[[], None]:
    """Draws what both cameras see, in a GL context of its own."""
    gl, camera, view = gl_context(size), mujoco.MjvCamera(), mujoco.MjrRect(0, 0, size, size)
    options, scene = mujoco.MjvOption(), mujoco.MjvScene(model, 1_000)
    camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
    scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = size >= SHADOWS_FROM
    image, all_of_it = np.empty((size, size, 3), np.uint8), int(mujoco.mjtCatBit.mjCAT_ALL)
    with current(gl):
        context = drawing_context(model)

    def bare() -> None:
        with current(gl):
            for camera.fixedcamid in list(range(len(CAMERAS))) * pairs:
                mujoco.mjv_updateScene(model, data, options, None, camera, all_of_it, scene)
                mujoco.mjr_render(view, scene, context)
                mujoco.mjr_readPixels(image, None, view, context)

    return bare


def _ppo(dynamics: str, required: float | None, rounds: int) -> Ratio:
    """PPO through `make_sb3_env` against PPO on an environment that costs nothing, 64 rows, defaults."""
    torch.set_num_threads(1)
    rows, steps = 64, 64
    env = make_sb3_env(n_envs=rows, dynamics=dynamics)
    free = VecMonitor(FreeVecEnv(env))
    ours, other = (PPO("MultiInputPolicy", each, n_steps=steps, seed=0, device="cpu") for each in (env, free))

    def learning(model: PPO) -> Rate:
        return rate_of(lambda: model.learn(rows * steps, reset_num_timesteps=False), rows * steps)

    name = f"PPO, 64 {dynamics} rows / PPO on a free environment"
    return _ratio(name, required, learning(ours), learning(other), max(rounds // 6, 1))


class FreeVecEnv(VecEnvWrapper):
    """Costs nothing: shows the same observation for ever, at reward 0, whatever it is put around.

    Trials are cut off after 60 motions, row after row: a learner works at the end of a trial, too.
    """

    TRIAL = 60

    def __init__(self, venv: VecEnv) -> None:
        super().__init__(venv)
        observation: Any = venv.reset()
        self._observation = {key: value.copy() for key, value in observation.items()}
        self._first = {key: value[0] for key, value in self._observation.items()}
        self._motions = np.arange(self.num_envs)

    def reset(self) -> VecEnvObs:
        """See `VecEnv`."""
        return self._observation

    def step_async(self, actions: np.ndarray) -> None:
        """See `VecEnv`."""

    def step_wait(self) -> VecEnvStepReturn:
        """See `VecEnv`."""
        self._motions += 1
        over = self._motions % self.TRIAL == 0
        infos: list[dict[str, Any]] = [{} for _ in over]
        for row in np.flatnonzero(over):
            infos[row] = {"terminal_observation": self._first, "TimeLimit.truncated": True}
        return self._observation, np.zeros(self.num_envs, np.float32), over, infos


def _beside(peer: Peer, rows: int, required: float | None, rounds: int) -> list[Ratio]:
    """Our environment, on one core or in rows on all, against a peer's, which has one row."""
    steps = 50 if rows == 1 else 4
    name = f"{'one environment' if rows == 1 else f'{rows} rows'} / {peer.env_id}"
    ours = rate_of(stepping(rows, steps), steps * rows)
    with pinned(1 if rows == 1 else os.cpu_count() or 1):
        found = [_ratio(name, None, ours, lambda: 50 / peer.seconds(50), rounds)]
    if peer.substeps:
        found.append(found[0].by("physics substeps", (SUBSTEPS, peer.substeps), required))
        if peer.timestep:
            found.append(found[1].by("simulated seconds", (WAIST_TIMESTEP, peer.timestep)))
    return found


def stepping(rows: int, steps: int, **arguments: Any) -> Callable[[], None]:
    """Makes motions there and back again, so that registers stay where they can be."""
    env: Any
    if rows == 1:
        env = gym.make(REACH, terminate_on_success=False, **arguments).unwrapped
    else:
        env = gym.make_vec(REACH, num_envs=rows, **arguments)
    words = _there_and_back((steps, *env.action_space.shape), 0.1)
    env.reset(seed=0)

    def ours() -> None:
        for word in words:
            env.step(word)

    return ours


def _there_and_back(shape: tuple[int, ...], largest: float) -> np.ndarray:
    words = np.random.default_rng(0).uniform(-largest, largest, shape).astype(np.float32)
    words[1::2] = -words[::2]
    return words


# -- Grasping


def _grasping(rounds: int, rows: int = 64, motions: int = 6, bare_steps: int = 500) -> Iterator[Ratio]:
    """Against MuJoCo alone on the same model, and against reaching, in physics substeps."""
    arguments: dict[str, Any] = {"truth": False, "terminate_on_success": False}
    with pinned(1):
        reach = rate_of(stepping(1, motions, truth=False), motions * SUBSTEPS)
        for state, make in ((FREE, _free), (HELD, _holding)):
            env = make(arguments)
            batch = env.arms.simulation._batch
            bare = rate_of(_bare(batch.get_model(0), batch.get_data(0), bare_steps), bare_steps)
            ours, unit = _moving(env, WORDS[state], motions), "physics substeps"
            name = f"one environment / bare mj_step, {state}"
            yield _ratio(name, BESIDE_MUJOCO, ours, bare, rounds, unit)
            name = f"one environment / reaching, {state}"
            yield _ratio(name, BESIDE_REACH[state], ours, reach, rounds, unit)
    mine, other = (gym.make_vec(GRASP, rows, max_episode_steps=10**9, **arguments) for _ in range(2))
    mine.reset(seed=0)
    other.reset(seed=0)
    of_rows: Any = other.unwrapped
    steps = bare_steps // 10
    bare = rate_of(lambda: of_rows.arms.simulation._batch.step(nstep=steps), rows * steps)
    ours = _moving(mine.unwrapped, WORDS[FREE], motions)
    yield _ratio(f"{rows} rows / bare Batch, {FREE}", BESIDE_BATCH, ours, bare, rounds, unit)


def _free(arguments: dict[str, Any]) -> Any:
    """An arm whose jaws are open and empty."""
    env = gym.make(GRASP, disable_env_checker=True, **arguments)
    env.reset(seed=0)
    return env.unwrapped


def _holding(arguments: dict[str, Any]) -> Any:
    """An arm that holds an object in the air."""
    env = gym.make(GRASP, shape="cylinder", disable_env_checker=True, **arguments)
    agent = agents.make("grasp", env, knowledge=None)
    for seed in count():
        (observation, _), state, over = env.reset(seed=seed), None, False
        while not over:
            words, state = agent.predict(observation, state)
            observation, _, terminated, truncated, _ = env.step(words)
            if observation["achieved_goal"][-1] == 1:
                return env.unwrapped
            over = terminated or truncated
    raise AssertionError


def _moving(env: Any, largest: float, motions: int) -> Rate:
    """Substeps a second of motions there and back again, with jaws as they are."""
    words = _there_and_back((motions, *env.action_space.shape), largest)
    words[..., -1] = 0
    simulation = env.arms.simulation
    clock, timestep = simulation._batch.bind("time"), simulation._model.opt.timestep

    def rate() -> float:
        before, start = float(clock.sum()), time.perf_counter()
        for word in words:
            env.step(word)
        seconds = time.perf_counter() - start
        return round((float(clock.sum()) - before) / timestep) / seconds

    return rate


# -- Timing


def rate_of(function: Callable[[], object], amount: float) -> Rate:
    """How much a second, where a call does so much."""

    def rate() -> float:
        start = time.perf_counter()
        function()
        return amount / (time.perf_counter() - start)

    return rate


def _ratio(
    name: str, required: float | None, ours: Rate, other: Rate, rounds: int, unit: str = "environment steps"
) -> Ratio:
    """Both in turns."""
    rates = np.array([(ours(), other()) for _ in range(rounds)])
    ratio = float(np.median(rates[:, 0] / rates[:, 1]))
    mine, others = np.median(rates, axis=0)
    return Ratio(name, unit, ratio, required, float(mine), float(others), rounds)


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


# -- Peers: other environments under other interpreters, timed in turns with ours

WORKER = Path(__file__).with_name("peer_worker.py")


class Peer:
    """An environment in a process of its own, which steps only while it is being timed.

    Attributes:
        env_id: Its Gymnasium id.
        substeps: Physics substeps in a step; None where they are not known.
        timestep: Simulated seconds in a substep; None where they are not known.
        versions: Of its interpreter and packages.

    Args:
        spec: "PYTHON=ENV_ID": an interpreter that has the environment, and the id, "module:Id" included.

    Raises:
        ConfigError: There is no such interpreter or environment; repeats its message.
    """

    def __init__(self, spec: str) -> None:
        self._spec = spec
        python, _, self.env_id = spec.rpartition("=")
        if not (python and self.env_id):
            raise ConfigError(f"--peer {spec}: found no PYTHON=ENV_ID; allowed: such as python3=CartPole-v1")
        self._said = tempfile.TemporaryFile()  # noqa: SIM115 (as long as the process; a pipe would fill up)
        try:
            self._process = subprocess.Popen(
                [python, "-c", WORKER.read_text(encoding="utf-8"), self.env_id],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._said,
                env={**os.environ, "OMP_NUM_THREADS": "1"},
                text=True,
            )
        except OSError as error:
            self._said.close()
            raise ConfigError(f"--peer {spec}: {python} cannot be run: {error.strerror}") from None
        try:
            about = self._answer()
        except ConfigError:
            self.close()
            raise
        self.substeps: int | None = about["substeps"]
        self.timestep: float | None = about["timestep"]
        self.versions: dict[str, str] = about["versions"]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the process."""
        self._process.kill()
        self._process.communicate()
        self._said.close()

    def seconds(self, steps: int) -> float:
        """Makes this many environment steps; returns the seconds that they took.

        Raises:
            ConfigError: The environment failed, or its process ended.
        """
        assert self._process.stdin is not None
        with suppress(BrokenPipeError):  # no answer then says why
            self._process.stdin.write(f"{steps}\n")
            self._process.stdin.flush()
        return float(self._answer()["seconds"])

    def _answer(self) -> Any:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        answer: Any = None
        with suppress(ValueError):
            answer = json.loads(line)
        if not isinstance(answer, dict):
            raise ConfigError(f"--peer {self._spec}: {self._last_words(line)}")
        if "error" in answer:
            raise ConfigError(f"--peer {self._spec}: {answer['error']}")
        return answer

    def _last_words(self, line: str) -> str:
        if line:
            return f"answered {line.strip()!r}; PYTHON must be a Python with gymnasium"
        code = self._process.wait()
        self._said.seek(0)
        said = self._said.read().decode(errors="replace").strip().splitlines()
        return f"it ended with code {code}" + (f": {said[-1]}" if said else "")
