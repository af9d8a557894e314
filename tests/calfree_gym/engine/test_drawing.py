"""Drawing: of models of any size, in any thread, and never in a copy of a process that has drawn."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from threading import Thread

import mujoco
import numpy as np
import pytest

import calfree_gym
from calfree_gym.image import PIXELS_PER_UNIT
from tests.arms.own import MODELS
from tests.calfree_gym.environments import assert_same, kinematic, make

pytestmark = pytest.mark.usefixtures("opengl")
FRAMES = {"render_mode": "rgb_array", "width": 240, "height": 160}
FORKS = pytest.mark.skipif(not hasattr(os, "fork"), reason="there are no copies of processes")
SECONDS = 60
"""Within which a process ends that does not wait for ever."""


def seen_with(grains, observation):
    spec = mujoco.MjSpec.from_file(str(MODELS / "hobby.xml"))
    for place in np.random.default_rng(0).uniform(-1e-3, 1e-3, (grains, 3)) - [0, 0, 0.3]:
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[5e-4, 0, 0], pos=place)
    arm = {"arm": calfree_gym.Arm(spec, "tip"), "world": "nominal", "camera_mount": "stand"}
    env = kinematic(observation=observation, **arm, **FRAMES)
    seen = dict(env.reset(seed=0)[0])
    if observation == "vision":
        seen["frame"] = env.render()
    if observation == "depth":
        for name in ("left_depth", "right_depth"):
            seen[name] = np.minimum(seen[name], 1)  # the background is as far as the model is large
    env.close()
    return seen


@pytest.mark.parametrize(
    ("observation", "grains"),
    [("vision", 1_100), ("vision", 3_000), ("rgb", 3_000), ("pixels", 1_100), ("depth", 3_000)],
)
def test_a_model_of_many_geoms_is_drawn_whole(observation, grains):
    seen, alone = seen_with(grains, observation), seen_with(0, observation)
    if observation == "vision":
        np.testing.assert_array_equal(seen["observation"][:4], 1)
    for name, without in alone.items():
        if without.ndim > 1:
            far = np.abs(seen[name].astype(float) - without)
            assert far.mean() < 0.002 * np.ptp(without), "arm, marks and object cover more than that"
        else:
            np.testing.assert_allclose(seen[name], without, atol=0.1 / PIXELS_PER_UNIT)


def drawn_by(run):
    envs = [make(observation="rgb", image_size=64, **FRAMES) for _ in range(2)]
    looks = [env.reset(seed=seed)[0] for seed, env in enumerate(envs)]
    words = np.array([0.2, -0.1, 0.1], np.float32)
    for _ in range(2):
        looks += run(lambda env: env.step(words)[0], envs)
    looks += [{"frame": frame} for frame in run(lambda env: env.render(), envs)]
    run(lambda env: env.close(), envs)
    return looks


def here(task, envs):
    return [task(env) for env in envs]


def by_a_thread_each(task, envs):
    done = []
    for env in envs:
        thread = Thread(target=lambda env=env: done.append(task(env)))
        thread.start()
        thread.join()
    return done


def by_a_pool(task, envs):
    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(task, envs))


@pytest.mark.parametrize("run", [by_a_thread_each, by_a_pool])
def test_any_thread_draws_the_same(run):
    assert_same(drawn_by(run), drawn_by(here))


def ended(code, *arguments):
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, check=True).stdout


ASYNC = """
import sys
from functools import partial
import gymnasium as gym
import calfree_gym

made = partial(gym.make, "calfree_gym:CalFree/Reach-v0", observation="rgb", image_size=64)
env = made()
if sys.argv[2] == "drew":
    env.reset(seed=0)
    env.close()
envs = gym.vector.AsyncVectorEnv([made, made], context=sys.argv[1])
try:
    print(envs.reset(seed=0)[0]["left_image"].std() > 10)
except RuntimeError as error:
    print(error)
"""


@FORKS
@pytest.mark.parametrize(
    ("context", "before", "said"),
    [("fork", "drew", 'context="spawn"'), ("fork", "drew not", "True"), ("spawn", "drew", "True")],
)
def test_copies_of_a_process_that_drew_say_so_and_do_not_wait_for_ever(context, before, said):
    assert said in ended(ASYNC, context, before)
