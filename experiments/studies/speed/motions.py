"""Times as ratios, both sides in turns; how long a motion takes, beside MuJoCo alone on the same model.

In turns a drifting machine cancels.
"""

from __future__ import annotations

import os
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
from mujoco.batch import Batch

import agents
from calfree_gym import Arm
from calfree_gym.robot.arms.movemaster import MOVEMASTER
from calfree_gym.robot.simulation import SUBSTEPS
from experiments.studies.common import REACH, arms_of_tests

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


GRASP = "calfree_gym:CalFree/Grasp-v0"
FREE, HELD = "jaws free", "object held"
WORDS = {FREE: 0.1, HELD: 0.03}
"""The largest words: what is held is carried about, and not pressed on the table."""
BESIDE_MUJOCO = {FREE: 0.88, HELD: 0.85}
SEVEN_MOTORS = "redundant"
"""Of the arms of the tests."""
ROWS = 1, 8, 64, 512, 1024, 8192


def bare_model(arm: Arm | None = None, mount: str = "waist") -> mujoco.MjModel:
    """An arm, the built-in one by default, with its cameras, and no environment around it."""
    robot = MOVEMASTER if arm is None else arm.robot
    return robot.scene(robot.mounts(mount)).model


def ratios(rounds: int) -> Iterator[Line]:
    """Reaching, other arms and grasping."""
    few = max(rounds // 3, 1)
    yield _single(rounds, truth=False, required=0.92)
    yield _single(rounds, truth=True)
    yield _single(rounds, truth=False, sensors=False)
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


def _single(rounds: int, truth: bool, required: float | None = None, sensors: bool = True) -> Line:
    """One environment, one thread.

    `mj_step` computes sensors in every substep, our environment once a motion; without `sensors`, the bare
    loop computes none.
    """
    motions = 50
    model = bare_model()
    if not sensors:
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
    bare = repeated(partial(mujoco.mj_step, model, mujoco.MjData(model)), motions * SUBSTEPS)
    ours, other = "" if truth else ", truth=False", "" if sensors else " without sensors"
    what = f"a motion of one arm{ours} / mj_step{other}"
    with pinned(1):
        moving = timer(stepping(1, motions, truth=truth), motions)
        return in_turns(what, moving, timer(bare, motions), rounds, required)


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
    bare = repeated(partial(Batch(bare_model(arm), rows).step, nstep=SUBSTEPS), motions)
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
    batch = Batch(bare_model(arm, mount), rows, nthread=threads)
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
