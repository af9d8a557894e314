"""What somebody else tells of his environment: its camera, where it rests, and what it calls by our names."""

import numpy as np
import pytest

from calfree_gym import Perturb
from calfree_gym.perturb.simulation import FREE, Adapter
from tests.calfree_gym.perturb.workbench import Workbench


class Telling(Adapter):
    """Tells of an environment what it is told."""

    def __init__(self, **told):
        self.told = told

    def camera(self, env):
        return self.told.get("camera", FREE)

    def rest(self, env):
        return self.told.get("rest")


def do(kind, **settings):
    return [{"at": {"step": 0}, "do": {"type": kind, **settings}}]


@pytest.mark.parametrize(
    ("adapter", "said"),
    [
        (Adapter, r"adapter is the class Adapter; it must be .* Adapter\(\)"),
        (Telling(camera=7), "the adapter's camera is 7; those of the model: 0: "),
    ],
)
def test_an_adapter_that_cannot_be_is_refused(adapter, said):
    with pytest.raises(ValueError, match=said):
        Perturb(Workbench(["front"]), do("camera_aim", camera="front"), adapter=adapter)


def test_what_a_viewers_own_camera_shows_is_met_where_no_images_are_observed():
    env, blurred = Workbench(["front"], render_mode="rgb_array"), do("blur", camera="render", px=8)
    with pytest.raises(ValueError, match=r"observations have images, .* give images=\{\}"):
        Perturb(env, blurred, adapter=Telling())
    assert Perturb(env, blurred, adapter=Telling(), images={}).parts.cameras == ("render",)


def test_a_rest_of_other_motors_is_refused_before_anything_moves():
    with pytest.raises(ValueError, match=r"the adapter's rest has shape \(3,\); it must have \(2,\)"):
        Perturb(Workbench(), do("motor_sign"), adapter=Telling(rest=np.zeros(3))).reset()


@pytest.mark.parametrize("own", [None, "much"])
def test_what_an_environment_tells_by_the_same_name_is_no_error(own):
    class Tells(Workbench):
        def reset(self, **arguments):
            observation, info = super().reset(**arguments)
            return observation, info | {"perturbed": own}

    assert Perturb(Tells(), do("motor_sign")).reset()[1]["perturbed"] == 1
