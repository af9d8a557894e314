"""Perturb in other people's environments, those that are installed: `make perturbed` installs all.

Frames need `MUJOCO_GL=egl`, or a screen. `pytest -s` prints by how much they differ.
"""

import importlib
import importlib.util
import pickle

import gymnasium as gym
import numpy as np
import pytest

from calfree_gym import Perturb
from calfree_gym.perturb.scope import OF_ACTIONS, OF_OBSERVATIONS
from calfree_gym.perturb.simulation import adapter_of
from tests.calfree_gym.perturb.workbench import arrays

pytestmark = pytest.mark.slow
KNOCK, BACK, STEPS = 1, 2, 3


SMALL = {"render_mode": "rgb_array", "width": 64, "height": 64}


def registered(module):
    """The package, whose environments Gymnasium then knows."""
    package = importlib.import_module(module)
    gym.register_envs(package)
    return package


def fetch():
    registered("gymnasium_robotics")
    env = gym.make("FetchReach-v4", **SMALL)
    env.unwrapped.mujoco_renderer.camera_id = 3
    return env


def adroit():
    registered("gymnasium_robotics")
    return gym.make("AdroitHandDoor-v1", **SMALL)


def metaworld():
    registered("metaworld")
    arguments = {"env_name": "reach-v3", "seed": 0, "render_mode": "rgb_array", "camera_name": "corner"}
    return gym.make("Meta-World/MT1", **arguments)


def dm_control():
    registered("shimmy")
    return gym.make("dm_control/cartpole-swingup-v0", render_mode="rgb_array", render_kwargs={"camera_id": 0})


def aloha():
    registered("gym_aloha")
    size = {f"{what}_{side}": 64 for what in ("observation", "visualization") for side in ("width", "height")}
    return gym.make("gym_aloha/AlohaTransferCube-v0", obs_type="pixels_agent_pos", **size)


def so101():
    package = registered("lerobot_env_so101")
    return gym.make(package.ENV_ID, render_spec=package.GymRenderingSpec(camera_id="front"))


def pusht():
    registered("gym_pusht")
    return gym.make("gym_pusht/PushT-v0", obs_type="pixels_agent_pos", render_mode="rgb_array")


def panda():
    registered("panda_gym")
    return gym.make("PandaReach-v3", render_mode="rgb_array", render_width=64, render_height=64)


def pusher():
    return gym.make("Pusher-v5", **SMALL)


def half_cheetah():
    return gym.make("HalfCheetah-v5", camera_name="track", **SMALL)


NEEDS = {pusher: "imageio", half_cheetah: "imageio", fetch: "gymnasium_robotics"}
NEEDS |= {adroit: "gymnasium_robotics", metaworld: "metaworld", dm_control: "shimmy", aloha: "gym_aloha"}
NEEDS |= {so101: "lerobot_env_so101", pusht: "gym_pusht", panda: "panda_gym"}
"""Families, and the package that each needs."""


@pytest.fixture(params=NEEDS, ids=lambda make: make.__name__)
def make(request):
    make = request.param
    if importlib.util.find_spec(NEEDS[make]) is None:
        pytest.skip(f"{NEEDS[make]} is not installed")
    try:
        env = make()
        env.reset(seed=0)
        env.render()
        env.close()
    except Exception as error:  # whatever a family raises under this version of MuJoCo
        pytest.skip(f"{make.__name__} does not run here by itself: {type(error).__name__}: {error}")
    return make


def knock(do):
    return [{"at": {"step": KNOCK}, "do": do}, {"at": {"step": BACK}, "undo": 0}]


def life(env, renders=True):
    observations = [env.reset(seed=3)[0]]
    frames = [env.render() if renders else None]
    box = env.action_space
    shares = np.random.default_rng(0).uniform(0.4, 0.6, (STEPS, *box.shape))
    for action in (box.low + shares * (box.high - box.low)).astype(box.dtype):
        observations.append(env.step(action)[0])
        frames.append(env.render() if renders else None)
    return observations, frames


def numbers(observation):
    if isinstance(observation, dict):
        return [leaf for key in sorted(observation) for leaf in numbers(observation[key])]
    return [np.asarray(observation)] if np.ndim(observation) < 3 else []


def anew(make, env):
    return make() if make in (metaworld, pusht) else env


def model_of(env):
    adapter = adapter_of(env)
    return adapter and adapter.simulation(env)[0]


def test_frames_differ_exactly_while_the_knock_lasts_and_physics_never(make):
    env = make()
    bare, model = life(env), model_of(env)
    as_built = arrays(model) if model else {}
    poses = ["camera_aim"] if Perturb(env).parts.cameras[0] != "render" else []
    settings = {"camera_aim": {"degrees": 10}, "exposure": {"factor": 0.7}}
    for kind in (*poses, *(["light"] if model else []), "exposure"):
        env = anew(make, env)
        found, model = (
            life(Perturb(env, knock({"type": kind, **settings.get(kind, {})}), seed=1)),
            model_of(env),
        )
        apart = [np.abs(one.astype(float) - two).mean() for one, two in zip(bare[1], found[1], strict=True)]
        print(f"{make.__name__} {kind}: {apart[KNOCK + 1]:.1f} grey levels")
        assert [bool(each) for each in apart] == [KNOCK < i <= BACK for i in range(STEPS + 1)], kind
        for one, two in zip(map(numbers, bare[0]), map(numbers, found[0]), strict=True):
            assert pickle.dumps(one) == pickle.dumps(two), kind
        for name, array in as_built.items():
            np.testing.assert_array_equal(arrays(model)[name], array, err_msg=f"{kind}: {name}")
    env.close()


def test_what_acts_on_physics_and_observations_acts_and_is_the_same_each_time(make):
    env, drawn = make(), []
    bare = [numbers(each) for each in life(env, False)[0]]
    words = {"dead_zone": {"words": 0.9}, "longest_motion": {"words": 0.01}, "point_dropout": {"share": 1.0}}
    for kind in ("joint_zero", *OF_ACTIONS, *OF_OBSERVATIONS, "repeatability"):
        if kind == "joint_zero" and not model_of(env):
            continue
        env = anew(make, env)
        perturbed = Perturb(env, knock({"type": kind, **words.get(kind, {})}), seed=2)
        found = [numbers(each) for each in life(perturbed, False)[0]]
        perturbed.unperturbed()
        assert pickle.dumps(found[: KNOCK + 1]) == pickle.dumps(bare[: KNOCK + 1]), kind
        if kind in ("shortfall", "longest_motion", *OF_OBSERVATIONS):  # others are of one joint
            assert pickle.dumps(found) != pickle.dumps(bare), kind
        if kind == "repeatability":
            drawn.append(pickle.dumps(found))
    assert drawn[0] == drawn[1]
    env.close()
