"""Times as ratios, both sides in turns: of motions, beside MuJoCo alone, and of all else that users wait for.

In turns a drifting machine cancels.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import count
from typing import Any, NamedTuple

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
from calfree_gym.robot.arms.robot import Scene
from calfree_gym.robot.simulation import NOT_STEPPED, SUBSTEPS
from calfree_gym.sb3 import make_sb3_env
from experiments.studies.common import GRASP, REACH, arms_of_tests

Timer = Callable[[], float]
"""Does something once, and tells the seconds that one unit of it took."""


class Line(NamedTuple):
    """One line of the table.

    Attributes:
        what: What took so long, and beside what.
        seconds: Of one unit, the median over rounds.
        beside: Of the other side, if there is one.
        ratio: Median over rounds of the other's time by ours: how many times as fast we are.
        required: The least ratio that the project asks of itself, if it asks.
    """

    what: str
    seconds: float
    beside: float | None = None
    ratio: float | None = None
    required: float | None = None


def alone(what: str, timer: Timer, rounds: int) -> Line:
    """What is beside nothing."""
    return Line(what, float(np.median([timer() for _ in range(rounds)])))


def in_turns(what: str, ours: Timer, other: Timer, rounds: int, required: float | None = None) -> Line:
    """Both in turns."""
    seconds = np.array([(ours(), other()) for _ in range(rounds)])
    ratio = float(np.median(seconds[:, 1] / seconds[:, 0]))
    mine, others = np.median(seconds, axis=0)
    return Line(what, float(mine), float(others), ratio, required)


def timer(
    function: Callable[[], object], units: float, clock: Callable[[], float] = time.perf_counter
) -> Timer:
    """Seconds of a unit, where a call makes so many of them."""

    def seconds() -> float:
        start = clock()
        function()
        return (clock() - start) / units

    return seconds


def written(seconds: float | None) -> str:
    """With two digits and more, in the unit in which they are easiest to read."""
    if seconds is None:
        return ""
    units = ((1e-6, "µs"), (1e-3, "ms"), (1.0, "s"))
    unit, name = next((each for each in units if seconds < 999.5 * each[0]), units[-1])
    return f"{seconds / unit:.{1 if seconds < 9.95 * unit else 0}f} {name}"


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


FREE, HELD = "jaws free", "object held"
WORDS = {FREE: 0.1, HELD: 0.03}
"""The largest words: what is held is carried about, and not pressed on the table."""
BESIDE_MUJOCO = {FREE: 0.88, HELD: 0.85}
SEVEN_MOTORS = "redundant"
"""Of the arms of the tests."""
ROWS = 1, 8, 64, 512, 1024, 8192


def bare_scene(arm: Arm | None = None, mount: str = "waist") -> Scene:
    """An arm, the built-in one by default, with its cameras, and no environment around it."""
    robot = MOVEMASTER if arm is None else arm.robot
    return robot.scene(robot.mounts(mount))


def ratios(rounds: int) -> Iterator[Line]:
    """Reaching, other arms and grasping."""
    few = max(rounds // 3, 1)
    yield _single(rounds, truth=False, required=0.92)
    yield _single(rounds, truth=True)
    yield _single(rounds, truth=False, bare=True)
    yield _batched(rounds, truth=False, required=0.97)
    yield _batched(rounds, truth=True)
    yield _kinematic(rounds, threads=1, required=1.2)
    yield _kinematic(rounds, threads=0)
    arms = {name: Arm.from_dict(given) for name, given in arms_of_tests().items()}
    for mount in ("waist", "stand"):
        yield _kinematic(few, 1, 1.0, arms[SEVEN_MOTORS], f", seven motors, {mount}", mount)
    of_arms = [_batched(few, arm=arm, named=f", {name}", required=0.9) for name, arm in arms.items()]
    slowest = min(of_arms, key=lambda line: line.ratio or 0)
    yield slowest._replace(what=f"{slowest.what}, the slowest of {len(arms)} arms")
    yield from grasping(few)


def _single(rounds: int, truth: bool, required: float | None = None, bare: bool = False) -> Line:
    """One environment, one thread.

    `mj_step` computes sensors and places shapes in every substep. Our environment computes sensors once a
    motion, and moves the arm without shapes and constraints: so does the other loop where it is to be `bare`.
    """
    motions = 50
    scene = bare_scene()
    model = scene.stepped if bare else scene.model
    if bare:
        model.opt.disableflags |= NOT_STEPPED
    stepped = repeated(partial(mujoco.mj_step, model, mujoco.MjData(model)), motions * SUBSTEPS)
    ours, other = "" if truth else ", truth=False", " of as little" if bare else ""
    what = f"a motion of one arm{ours} / mj_step{other}"
    with pinned(1):
        moving = timer(stepping(1, motions, truth=truth), motions)
        return in_turns(what, moving, timer(stepped, motions), rounds, required)


def repeated(function: Callable[[], object], times: int) -> Callable[[], None]:
    """Calls a function so many times."""

    def calls() -> None:
        for _ in range(times):
            function()

    return calls


def _batched(
    rounds: int,
    truth: bool = True,
    arm: Arm | None = None,
    named: str = "",
    required: float | None = None,
) -> Line:
    """256 rows on all cores."""
    rows, motions = 256, 4
    bare = repeated(partial(Batch(bare_scene(arm).model, rows).step, nstep=SUBSTEPS), motions)
    ours = stepping(rows, motions, truth=truth, **({} if arm is None else {"arm": arm}))
    what = f"a motion of {rows} rows{'' if truth else ', truth=False'} / Batch.step{named}"
    return in_turns(what, timer(ours, motions), timer(bare, motions), rounds, required)


def _kinematic(
    rounds: int,
    threads: int,
    required: float | None = None,
    arm: Arm | None = None,
    named: str = "",
    mount: str = "waist",
) -> Line:
    """1,024 rows of kinematic dynamics, on one thread or (0) all."""
    rows, motions = 1024, 60
    batch = Batch(bare_scene(arm, mount).model, rows, nthread=threads)
    bare = repeated(partial(batch.forward, stage=int(mujoco.mjtStage.mjSTAGE_POS)), motions)
    of = {} if arm is None else {"arm": arm}
    chosen: dict[str, Any] = {"truth": False, "threads": threads, "camera_mount": mount, **of}
    ours = stepping(rows, motions, dynamics="kinematic", **chosen)
    what = f"a motion of {rows:,} kinematic rows, {'one thread' if threads else 'all threads'}{named}"
    with pinned(threads or os.cpu_count() or 1):
        return in_turns(
            f"{what} / Batch.forward(POS)", timer(ours, motions), timer(bare, motions), rounds, required
        )


def stepping(rows: int, motions: int, **arguments: Any) -> Callable[[], None]:
    """Makes motions there and back again, so that registers stay where they can be."""
    env: Any
    if rows == 1:
        arguments.pop("threads", None)
        env = gym.make(REACH, terminate_on_success=False, **arguments).unwrapped
    else:
        env = gym.make_vec(REACH, num_envs=rows, **arguments)
    words = _there_and_back((motions, *env.action_space.shape), 0.1)
    env.reset(seed=0)

    def ours() -> None:
        for word in words:
            env.step(word)

    return ours


def _there_and_back(shape: tuple[int, ...], largest: float) -> np.ndarray:
    words = np.random.default_rng(0).uniform(-largest, largest, shape).astype(np.float32)
    words[1::2] = -words[::2]
    return words


def by_rows(rounds: int, counts: tuple[int, ...] = ROWS) -> pd.DataFrame:
    """Motions a second of so many rows, with either dynamics and either number of threads."""
    found = []
    for rows in counts:
        line: dict[str, Any] = {"rows": rows}
        for dynamics in ("kinematic", "physics"):
            for threads in (1, 2):
                motions = 2 * max(1, 256 // rows) if dynamics == "kinematic" else 2
                arguments = {"dynamics": dynamics, "truth": False, "threads": threads, "world": "nominal"}
                with pinned(threads):
                    seconds = timer(stepping(rows, motions, **arguments), rows * motions)
                    column = f"{dynamics}, {threads} thread{'s' * (threads > 1)}"
                    line[column] = 1 / float(np.median([seconds() for _ in range(rounds)]))
        found.append(line)
    return pd.DataFrame(found)


# -- Grasping, by physics substeps: a motion has as many as its way is long


def grasping(rounds: int, rows: int = 64, motions: int = 6, bare_steps: int = 500) -> Iterator[Line]:
    """Against MuJoCo alone on the same model."""
    arguments: dict[str, Any] = {"truth": False, "terminate_on_success": False}
    with pinned(1):
        for state, make in ((FREE, _free), (HELD, _holding)):
            env = make(arguments)
            batch = env.arms.simulation._batch
            step = partial(mujoco.mj_step, batch.get_model(0), batch.get_data(0))
            bare = timer(repeated(step, bare_steps), bare_steps)
            what = f"a substep of grasping, {state} / mj_step"
            yield in_turns(what, _moving(env, WORDS[state], motions), bare, rounds, BESIDE_MUJOCO[state])
    mine, other = (gym.make_vec(GRASP, rows, max_episode_steps=10**9, **arguments) for _ in range(2))
    mine.reset(seed=0)
    other.reset(seed=0)
    of_rows: Any = other.unwrapped
    steps = bare_steps // 10
    bare = timer(partial(of_rows.arms.simulation._batch.step, nstep=steps), rows * steps)
    what = f"a substep of {rows} grasping rows, {FREE} / Batch.step"
    yield in_turns(what, _moving(mine.unwrapped, WORDS[FREE], motions), bare, rounds, 0.90)


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


def _moving(env: Any, largest: float, motions: int) -> Timer:
    """Seconds a substep of motions there and back again, with jaws as they are."""
    words = _there_and_back((motions, *env.action_space.shape), largest)
    words[..., -1] = 0
    simulation = env.arms.simulation
    clock, timestep = simulation._batch.bind("time"), simulation._model.opt.timestep

    def seconds() -> float:
        before, start = float(clock.sum()), time.perf_counter()
        for word in words:
            env.step(word)
        took = time.perf_counter() - start
        return took / round((float(clock.sum()) - before) / timestep)

    return seconds


# -- What users wait for beside motions: imports, new worlds, pictures, decisions, a learner's own work

KINEMATIC: dict[str, Any] = {"dynamics": "kinematic", "truth": False}
SMALL = 84
"""Width and height in pixels of the images of `"pixels"`, as networks take them."""
TRIAL, POOL = 20, 64
"""Motions of a trial, and worlds of the pool, where every trial is in another world."""
DECIDED = 20
"""Trials in which an agent decides."""
DECIDING = "grid_table", "cooperstock_milios", "unified_servo", "memory", "body_schema"
REQUIRED = dict.fromkeys(("unified_servo", "memory"), (1 / 5, 1 / 20))
"""What the project asks of decisions of some beside the paper's servo, in the median and at worst."""


def lines(rounds: int) -> Iterator[Line]:
    """All of them."""
    few = max(rounds // 6, 1)
    yield from _beginning(few)
    yield from _worlds(few)
    yield from _looks(few)
    yield from _decisions(few)
    for dynamics in ("kinematic", "physics"):
        yield _ppo(dynamics, 0.70 if dynamics == "kinematic" else None, few)


def _beginning(rounds: int) -> Iterator[Line]:
    """In a fresh interpreter."""
    make = "import gymnasium, calfree_gym; gymnasium.make('CalFree/Reach-v0')"
    for what, code in (
        ("import gymnasium, calfree_gym / import gymnasium", "import gymnasium, calfree_gym"),
        ("the same, and gym.make / import gymnasium", make),
        ("import gymnasium and the agents / import gymnasium", "import gymnasium, calfree_gym, agents"),
    ):
        yield in_turns(what, _interpreter(code), _interpreter("import gymnasium"), rounds)


def _interpreter(code: str) -> Timer:
    def seconds() -> float:
        timed = f"import time; {code}; print(time.process_time())"
        done = subprocess.run([sys.executable, "-c", timed], capture_output=True, text=True, check=True)
        return float(done.stdout.split()[-1])

    return seconds


def _worlds(rounds: int) -> Iterator[Line]:
    """A world that is drawn, and training in many of them beside training in one."""
    single = gym.make(REACH, **KINEMATIC)
    single.reset(seed=0)
    moving = timer(stepping(1, 50, **KINEMATIC), 50)
    with pinned(1):
        yield in_turns(
            "reset(), one arm in its world / a kinematic motion", timer(single.reset, 1), moving, rounds
        )
        drawing = timer(partial(single.reset, seed=1), 1)
        yield in_turns(
            "reset(seed=), one arm, a world is drawn / a kinematic motion", drawing, moving, rounds
        )
        rows = gym.make_vec(REACH, 1024, threads=1, **KINEMATIC)
        yield alone("reset(seed=) of 1,024 rows, a world each", timer(partial(rows.reset, seed=1), 1), 1)
        for count in (16, 64, 1024):
            in_one, drawn, of_pool = (_trials(count, **of) for of in ({}, {"redraw": "trial"}, _OF_POOL))
            what = f"a motion of {count:,} kinematic rows, each trial in a world"
            yield in_turns(f"{what} of a pool / in one world", of_pool, in_one, rounds, 1 / 1.5)
            yield in_turns(f"{what} of its own / in one world", drawn, in_one, max(rounds // 5, 1))


_OF_POOL = {"redraw": "trial", "pool": POOL}


def _trials(rows: int, **arguments: Any) -> Timer:
    """Two trials of each row, by words that end none before its time."""
    envs = gym.make_vec(
        REACH, rows, threads=1, max_episode_steps=TRIAL, terminate_on_success=False, **KINEMATIC, **arguments
    )
    envs.reset(seed=0)
    move = repeated(partial(envs.step, np.zeros(envs.action_space.shape or (), np.float32)), 2 * TRIAL)
    for _ in range(20 * POOL // rows if arguments == _OF_POOL else 1):
        move()  # each world of the pool is met for the first time
    return timer(move, 2 * TRIAL, time.process_time)


def _looks(rounds: int, rows: int = 64) -> Iterator[Line]:
    """A look of many rows beside pictures alone: as many pairs, alike in size and quality."""
    for observation, size in (("vision", IMAGE_SIZE), ("pixels", SMALL)):
        image: dict[str, Any] = {} if observation == "vision" else {"image_size": size}
        envs: Any = gym.make_vec(REACH, rows, dynamics="kinematic", observation=observation, **image)
        envs.reset(seed=0)
        looking = timer(partial(envs.step, np.zeros(envs.action_space.shape, np.float32)), rows)
        model, data = envs.unwrapped.arms._sight._renderer.picture
        bare = _bare_pair(model, data, size)
        bare()  # OpenGL compiles what it needs
        what = f"a look of a row, {observation}, {size} px / mjr_render of a pair"
        yield in_turns(what, looking, timer(bare, 1), rounds)


def _bare_pair(model: mujoco.MjModel, data: mujoco.MjData, size: int) -> Callable[[], None]:
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
            for camera.fixedcamid in range(len(CAMERAS)):
                mujoco.mjv_updateScene(model, data, options, None, camera, all_of_it, scene)
                mujoco.mjr_render(view, scene, context)
                mujoco.mjr_readPixels(image, None, view, context)

    return bare


def _decisions(rounds: int) -> Iterator[Line]:
    """From look to word, of agents that learn on, beside the paper's servo; CPU time, a world a round.

    The slowest is that beside the servo's median in its own world.
    """
    seven = Arm.from_dict(arms_of_tests()[SEVEN_MOTORS])
    for arm, named in (({}, ""), ({"arm": seven}, ", seven motors")):
        for name in DECIDING:
            if arm and name in ("grid_table", "cooperstock_milios"):
                continue
            found = [
                [_decided(each, seed, **arm) for each in (name, "paper_servo")] for seed in range(rounds)
            ]
            middle, worst, servo = np.array(
                [(np.median(own), own.max(), np.median(others)) for own, others in found]
            ).T
            what = f"a decision of {name}{named} / paper_servo"
            usual, slowest = REQUIRED.get(name, (None, None))
            ratio, least = float(np.median(servo / middle)), int((servo / worst).argmin())
            yield Line(what, float(np.median(middle)), float(np.median(servo)), ratio, usual)
            pair = float(worst[least]), float(servo[least])
            yield Line(f"{what}, the slowest", *pair, pair[1] / pair[0], slowest)


def _decided(name: str, seed: int, **arguments: Any) -> np.ndarray:
    """CPU seconds of each decision (n,) in one world."""
    env = _Watched(gym.make(REACH, **{**KINEMATIC, **arguments}), DECIDED)
    env.reset(seed=seed)
    agents.make(name, env, seed=0).learn(60 * DECIDED, callback=lambda _: env.trials > 0)
    return np.array(env.decisions)


class _Watched(gym.Wrapper[Any, Any, Any, Any]):
    """Takes the time from what a step returns to the next word."""

    def __init__(self, env: gym.Env[Any, Any], trials: int) -> None:
        super().__init__(env)
        self.trials, self.decisions = trials, list[float]()
        self._since = 0.0

    def reset(self, **arguments: Any) -> Any:
        """See `gymnasium.Env`."""
        found = self.env.reset(**arguments)
        self._since = time.process_time()
        return found

    def step(self, action: Any) -> Any:
        """See `gymnasium.Env`."""
        self.decisions.append(time.process_time() - self._since)
        found = self.env.step(action)
        self.trials -= found[2] or found[3]
        self._since = time.process_time()
        return found


def _ppo(dynamics: str, required: float | None, rounds: int) -> Line:
    """PPO through `make_sb3_env` beside PPO on an environment that costs nothing, 64 rows, defaults."""
    torch.set_num_threads(1)
    rows, steps = 64, 64
    env = make_sb3_env(n_envs=rows, dynamics=dynamics)
    free = VecMonitor(FreeVecEnv(env))
    ours, other = (PPO("MultiInputPolicy", each, n_steps=steps, seed=0, device="cpu") for each in (env, free))

    def learning(model: PPO) -> Timer:
        return timer(lambda: model.learn(rows * steps, reset_num_timesteps=False), rows * steps)

    what = f"a motion of PPO, 64 {dynamics} rows / on a free environment"
    return in_turns(what, learning(ours), learning(other), rounds, required)


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
