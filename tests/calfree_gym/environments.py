"""Environments of all tasks; what they show, and that it is the same, bit by bit."""

import importlib.util
import warnings
from pathlib import Path

import gymnasium as gym
import numpy as np
from gymnasium.utils.env_checker import check_env

from calfree_gym.perturbations import TYPES
from calfree_gym.robot.arms.movemaster import MOVEMASTER

OF_ARMS = sorted(name for name, kind in TYPES.items() if kind.built is MOVEMASTER)
"""Types of perturbations that an arm can have."""
TASKS = ("Reach", "SafeReach", "Grasp", "Insert")
OF_CAMERAS = [
    *("camera_position", "camera_orientation", "focal_length", "principal_point", "lens_k1", "lens_k2"),
    *("pixel_aspect", "exposure", "blur", "image_noise"),
]
"""Fields of a world that have one entry a camera."""


def make(task="Reach", rows=None, **arguments):
    """One environment of a task, or a batched one of so many rows."""
    env_id = f"calfree_gym:CalFree/{task}-v0"
    if rows is not None:
        return gym.make_vec(env_id, num_envs=rows, **arguments)
    return gym.make(env_id, disable_env_checker=True, **arguments)


def kinematic(rows=None, **arguments):
    """The same of Reach, in which arms are placed and not moved by physics."""
    return make("Reach", rows, dynamics="kinematic", **arguments)


def example(name):
    """The module of an example."""
    file = Path(__file__).parents[2] / "examples" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def assert_checkers_pass(make):
    """That Gymnasium's and SB3's checkers pass without a warning what is made."""
    from stable_baselines3.common.env_checker import check_env as sb3_check_env

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(make().unwrapped, skip_render_check=True)
        sb3_check_env(make().unwrapped)


def begun(env, seed=0, **options):
    """An environment, in its first trial."""
    env.reset(seed=seed, **options)
    return env


def trials(env, count, seed=0):
    """Begins so many trials, the first with a seed; what each reset shows."""
    for trial in range(count):
        yield env.reset(seed=seed if trial == 0 else None)


def alone(env, words, seed):
    """All that a reset and a motion for each of `words` show; the next trial follows one that is over."""

    def begun(**options):
        observation, info = env.reset(**options)
        return observation, 0.0, False, False, info, env.unwrapped.applied

    found = [begun(seed=seed)]
    for word in words:
        over = found[-1][2] or found[-1][3]
        found.append(begun() if over else (*env.step(word), env.unwrapped.applied))
    return found


def together(envs, words, seed):
    """The same of each row of a batched environment; `words` are (motions, rows, m)."""
    observation, infos = envs.reset(seed=seed)
    zeros, nothing = np.zeros(envs.num_envs), np.zeros(envs.num_envs, bool)
    found = [(observation, zeros, nothing, nothing, infos, envs.unwrapped.applied)]
    found += [(*envs.step(each), envs.unwrapped.applied) for each in words]
    return [[of_row(shown, row) for shown in found] for row in range(envs.num_envs)]


def of_row(value, row):
    """What of a batched result is one row's."""
    if isinstance(value, dict):
        return {key: of_row(each, row) for key, each in value.items() if not key.startswith("_")}
    if isinstance(value, tuple):
        return tuple(of_row(each, row) for each in value)
    return value[row]


def assert_same(one, other):
    """Of two results, however nested, that they are the same bit by bit."""
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for key, value in one.items():
            assert_same(value, other[key])
    elif isinstance(one, list | tuple):
        for pair in zip(one, other, strict=True):
            assert_same(*pair)
    elif isinstance(one, np.ndarray | np.generic | float):
        one, other = np.asarray(one), np.asarray(other)
        assert one.dtype == other.dtype
        assert one.tobytes() == other.tobytes(), (one, other)
    else:
        assert one == other
