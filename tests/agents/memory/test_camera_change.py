"""A camera of the simulation turned about its centre: how well a few observations tell where all has gone."""

import numpy as np
import pytest

from agents.memory.camera_change import fit_camera
from agents.memory.remembered import Remembered
from calfree_gym.image import lengths_px
from calfree_gym.perturbations import CameraAim
from tests.agents import analytic
from tests.agents.memory.gripper_views import noisy, seen_at


def grippers(env, registers):
    """Noise-free sensor vectors (n, 4) of the gripper at registers (n, 3)."""
    return np.array([analytic.points(env, each)[:2].ravel() for each in registers])


@pytest.mark.parametrize("camera", [0, 1])
def test_three_observations_of_a_turned_camera_tell_where_all_other_points_have_gone(make_env, camera):
    """A shift says how far it was turned, so the perspective follows (at a usual focal length)."""
    env, rng = make_env("stand", world="nominal", keep_in_view=False).unwrapped, np.random.default_rng(0)
    env.reset(seed=0)
    nominal, remembered = env.world, Remembered(3)
    places, elsewhere = rng.uniform(-0.25, 0.25, (100, 3)), rng.uniform(-0.25, 0.25, (30, 3))
    remembered.learn(seen_at(places, noisy(rng, grippers(env, places))))
    before, missed = grippers(env, elsewhere), []
    for _ in range(12):
        env.set_world(CameraAim(("left", "right")[camera], 20.0).apply(nominal, rng))
        registers = rng.uniform(-0.25, 0.25, (3, 3))
        pairs = seen_at(registers, noisy(rng, grippers(env, registers)))
        after = fit_camera(remembered.gripper.function, camera, pairs).sensors(before)
        off = lengths_px((after - grippers(env, elsewhere)).reshape(-1, 2, 2)[:, camera])
        missed.append(np.median(off))
    assert np.median(missed) < 3
