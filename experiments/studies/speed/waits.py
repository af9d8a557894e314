"""What users wait for beside motions: imports, new worlds, pictures, decisions, a learner's own work."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecMonitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

import agents
from calfree_gym import Arm
from calfree_gym.engine.sight import SHADOWS_FROM
from calfree_gym.image import CAMERAS, IMAGE_SIZE
from calfree_gym.rendering.renderer import current, drawing_context, gl_context
from calfree_gym.sb3 import make_sb3_env
from experiments.studies.common import REACH, arms_of_tests
from experiments.studies.speed.motions import (
    SEVEN_MOTORS,
    Line,
    Timer,
    alone,
    in_turns,
    pinned,
    repeated,
    stepping,
    timer,
)

KINEMATIC: dict[str, Any] = {"dynamics": "kinematic", "truth": False}
SMALL = 84
"""Width and height in pixels of the images of `"pixels"`, as networks take them."""
TRIAL, POOL = 20, 64
"""Motions of a trial, and worlds of the pool, where every trial is in another world."""
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
    """From look to word, of agents that learn on, beside the paper's servo; CPU time, by trials' order."""
    seven = Arm.from_dict(arms_of_tests()[SEVEN_MOTORS])
    for arm, named in (({}, ""), ({"arm": seven}, ", seven motors")):
        of_servo = np.median(_decided("paper_servo", 2 * rounds, **arm))
        for name in DECIDING:
            if arm and name in ("grid_table", "cooperstock_milios"):
                continue
            found = _decided(name, 2 * rounds, **arm)
            middle, worst = float(np.median(found)), float(found.max())
            what = f"a decision of {name}{named} / paper_servo"
            usual, slowest = REQUIRED.get(name, (None, None))
            yield Line(what, middle, of_servo, of_servo / middle, usual)
            yield Line(f"{what}, the slowest", worst, of_servo, of_servo / worst, slowest)


def _decided(name: str, trials: int, **arguments: Any) -> np.ndarray:
    """CPU seconds of each decision (n,)."""
    env = _Watched(gym.make(REACH, **{**KINEMATIC, **arguments}), trials)
    env.reset(seed=0)
    agents.make(name, env, seed=0).learn(60 * trials, callback=lambda _: env.trials > 0)
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
