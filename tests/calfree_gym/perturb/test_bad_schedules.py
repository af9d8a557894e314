"""Perturb refuses what it cannot do before anything is changed, and says what would do."""

import gymnasium as gym
import numpy as np
import pytest

from calfree_gym import Perturb
from tests.calfree_gym.perturb.workbench import Workbench, arrays


class Canvas(gym.Env):
    """An environment without MuJoCo, whose observation is an image."""

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012

    def __init__(self, action_space=None, image=None):
        self.render_mode = "rgb_array"
        self.action_space = action_space or gym.spaces.Box(0.0, 512.0, (2,), np.float32)
        self.observation_space = image or gym.spaces.Box(0, 255, (24, 32, 3), np.uint8)

    def render(self):
        return np.full((24, 32, 3), 100, np.uint8)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return np.full(self.observation_space.shape, 100, self.observation_space.dtype), {}

    def step(self, action):
        self.got = action
        return self.reset()[0], 0.0, False, False, {}


def do(kind, **settings):
    return [{"at": {"step": 1}, "do": {"type": kind, **settings}}]


@pytest.mark.parametrize(
    ("schedule", "arguments", "message"),
    [
        (
            do("camera_aim", camera="frnt"),
            {},
            r"schedule\.0: camera_aim names the camera 'frnt' \(did you mean "
            r"front\?\), which there is not; there are: front, looker, wrist, follower",
        ),
        (
            do("camera_aim", camera="wrist"),
            {},
            r"no image shows the camera 'wrist'; give images=.'wrist': KEYS.",
        ),
        (
            do("camera_aim", camera="render"),
            {"images": {"render": ()}},
            "'render' is the viewer's own camera.*front",
        ),
        (do("camera_aim"), {"images": {}}, "no image shows a camera; give images="),
        (
            do("blur"),
            {"images": {"wrist": None}},
            "blur acts on images as they are delivered, and none of 'wrist'",
        ),
        (do("blur"), {"images": {"wrist": "state"}}, r"acts on images \(h, w, 3\) or \(3, h, w\) of uint8"),
        (
            do("blur"),
            {"images": {"wrst": "state"}},
            r"images names the camera 'wrst' \(did you mean wrist\?\)",
        ),
        (
            do("blur"),
            {"images": {"wrist": ("pixels", "top")}},
            "names 'pixels/top', but observations have: pixels/fr",
        ),
        (do("latency"), {"late": ["stat"]}, "late names 'stat', but observations have: pixels/front, state"),
        (do("motor_sign", motor="elbow"), {}, "motor is 'elbow'; allowed: shoulder, reach"),
        (do("joint_zero", joint="elbow"), {}, "joint is 'elbow'; allowed: shoulder, reach"),
        (do("link_length"), {}, r"schedule\.0: link_length needs a robot of calfree's own"),
        (do("camera_am"), {}, r"schedule\.0\.do\.type is 'camera_am' \(did you mean camera_aim"),
        ([], {"per": "live"}, r"per is 'live' \(did you mean life\?\)"),
        ([], {"seed": -1}, "seed is -1; it must be a whole number from 0"),
    ],
)
def test_what_cannot_be_is_refused(schedule, arguments, message):
    env = Workbench(["front"])
    before = arrays(env.model)
    with pytest.raises(ValueError, match=message):
        Perturb(env, schedule, **arguments)
    for name, array in arrays(env.model).items():
        np.testing.assert_array_equal(array, before[name], err_msg=name)


def test_one_in_the_other_is_refused():
    with pytest.raises(ValueError, match="in a Perturb already: give that one the whole schedule"):
        Perturb(gym.wrappers.TimeLimit(Perturb(Workbench()), 5))


@pytest.mark.parametrize("kind", ["camera_aim", "light", "joint_zero"])
def test_where_no_model_is_found_it_says_how_to_tell(kind):
    with pytest.raises(ValueError, match="no MuJoCo model is found behind Canvas") as caught:
        Perturb(Canvas(), do(kind))
    advice = str(caught.value)
    code = advice[advice.index("    from ") : advice.index("    Perturb(env")]
    names = {}
    exec("\n".join(line[4:] for line in code.splitlines()), names)
    env = Workbench(["front"])
    env.sim = env
    perturbed = Perturb(env, do("camera_aim", camera="front"), adapter=names["Mine"]())
    assert perturbed.parts.cameras == ("front",)


def test_without_mujoco_images_actions_and_observations_are_perturbed():
    schedule = [*do("exposure", factor=0.5), *do("motor_sign", motor="action1"), *do("latency", motions=1)]
    env = Perturb(Canvas(), schedule, seed=0, images={"render": ()})
    env.reset()
    for there in (100, 100, 50):
        observation, *_ = env.step(np.float32([56, 56]))
        assert (observation == there).all()
    assert env.unwrapped.got.tolist() == [56, 512 - 56]
    assert (env.render() == 50).all()


@pytest.mark.parametrize("space", [gym.spaces.Discrete(3), gym.spaces.Box(-np.inf, np.inf, (2,))])
def test_actions_that_have_no_range_are_refused(space):
    with pytest.raises(
        ValueError, match=r"motor_gain acts on actions that are numbers \(m,\), each in a range"
    ):
        Perturb(Canvas(space), do("motor_gain"))


@pytest.mark.parametrize(
    "image",
    [
        gym.spaces.Box(0, 1, (24, 32, 3), np.float32),
        gym.spaces.Box(0, 255, (4, 24, 32, 3), np.uint8),
        gym.spaces.Box(0, 255, (24, 32, 1), np.uint8),
    ],
)
def test_images_of_other_kinds_are_refused(image):
    with pytest.raises(
        ValueError, match=r"exposure acts on images \(h, w, 3\) or \(3, h, w\) of uint8; those of 'render'"
    ):
        Perturb(Canvas(image=image), do("exposure"), images={"render": ()})
