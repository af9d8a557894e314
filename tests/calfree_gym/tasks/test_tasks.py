"""What is asked in each task, by hand-made points; and what environments say of their task."""

import importlib

import numpy as np
import pytest
from gymnasium.envs.registration import load_env_creator
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import calfree_gym
from calfree_gym.engine.spaces import image_distances
from calfree_gym.image import IMAGE_UNIT
from calfree_gym.tasks import insert
from calfree_gym.tasks.grasp import held
from calfree_gym.tasks.reach import kept_apart, rendezvous
from tests.calfree_gym.environments import make

coordinates = st.floats(-1, 1, width=32)
nearby = st.sampled_from([0.0, 1e-6, -1e-4, 0.5, 0.7, 1.0, -1.0])


@settings(max_examples=200)
@given(
    arrays(np.float64, (3, 2, 2), elements=coordinates),
    arrays(np.float64, (3, 2, 2), elements=nearby),
    arrays(bool, (3, 4)),
    st.floats(1 / 256, 1.0),
)
def test_what_is_hidden_never_shows_a_rendezvous(objects, apart, visible, tolerance):
    tolerance = float(np.float32(tolerance))
    points = np.concatenate([np.clip(objects + tolerance * apart, -1, 1), objects], axis=1)
    given_ = points.copy()
    kept = kept_apart(points, visible, tolerance)
    np.testing.assert_array_equal(points, given_)
    assert np.abs(kept).max() <= 1
    np.testing.assert_array_equal(kept[visible], points[visible])

    def judged(of):
        sensors = of.astype(np.float32).reshape(-1, 2, 4)
        return rendezvous(image_distances(sensors[:, 0], sensors[:, 1]), np.float32(tolerance))

    all_seen = visible.all(1)
    assert not judged(kept)[~all_seen].any()
    np.testing.assert_array_equal(kept[all_seen], points[all_seen])
    moved = (kept != points).any((1, 2))
    far = np.linalg.norm(points[:, :2] - points[:, 2:], axis=-1).max(-1)
    assert not moved[far > 1.02 * tolerance].any()


FAR, NEAR = 40 * IMAGE_UNIT, 4 * IMAGE_UNIT


def ways(length, noise=0.0):
    """Of a point in both images (1, 2, 2)."""
    way = np.full((1, 2, 2), length / np.sqrt(2))
    return way + np.random.default_rng(0).normal(0, noise, way.shape)


@pytest.mark.parametrize("before", [False, True])
@pytest.mark.parametrize(
    ("gripper", "object_", "blocked", "seen", "wanted"),
    [
        (FAR, FAR, True, True, True),  # it goes with the gripper
        (FAR, 0.0, True, True, False),  # it stays
        (FAR, FAR, False, True, False),  # the jaws are closed on nothing
        (NEAR, 0.0, True, True, None),  # hardly moved: as before
        (FAR, 0.0, True, False, None),  # not seen: as before
    ],
)
def test_what_goes_with_a_gripper_that_moves_is_held(gripper, object_, blocked, seen, wanted, before):
    noise = 2 * IMAGE_UNIT
    blocked, before_, seen = (np.array([each]) for each in (blocked, before, seen))
    found = held(blocked, before_, ways(gripper), ways(object_, noise), seen)
    assert found == (before if wanted is None else wanted)


BASE, TIP = np.array([[[0.0, -0.2], [0.1, -0.2]]]), np.array([[[0.0, 0.0], [0.1, 0.0]]])


@pytest.mark.parametrize(
    ("tip", "base", "hole", "seen", "depth"),
    [
        *((TIP, BASE, TIP - share * (TIP - BASE) + [0.01, 0], True, share) for share in (-0.5, 0, 0.17, 0.3)),
        (TIP, BASE, TIP - 0.1, False, -1),
        (TIP, TIP, BASE, True, 0),  # no axis is seen
    ],
)
def test_depth_is_what_is_beyond_the_hole_on_the_axis(tip, base, hole, seen, depth):
    assert insert.depth_told(tip, base, hole, np.array([seen])) == pytest.approx([depth])


@pytest.mark.parametrize(
    ("off", "within"), [([0] * 5, True), ([0, 0, 0, 0, -0.01], False), ([0, 0, 0.06, 0, 0.5], False)]
)
def test_deep_is_in_only_at_the_hole(off, within):
    desired = np.array([0.1, 0.2, 0.3, 0.4, insert.DEPTH])
    assert insert.inserted(desired + off, desired, 0.05) == within
    assert insert.inserted(np.stack([desired + off] * 2), desired, 0.05).tolist() == [within] * 2


EARLIER = {
    "Reach": ("single:make", "vector:make"),
    "SafeReach": ("safe_reaching:make", "safe_reaching:make_vec"),
    "Grasp": ("grasping:make", "grasping:make_vec"),
    "Insert": ("inserting:InsertEnv", "inserting:InsertVectorEnv"),
}


@pytest.mark.parametrize("dense", ["", "Dense"])
@pytest.mark.parametrize("name", EARLIER)
def test_environments_say_what_their_task_is_and_names_of_earlier_versions_make_them(name, dense):
    if f"CalFree/{name}{dense}-v0" not in calfree_gym.ENV_IDS:
        pytest.skip("it has no dense reward")
    env, rows = make(name + dense).unwrapped, make(name + dense, rows=1).unwrapped
    assert env.task == rows.task == {"SafeReach": "reach"}.get(name, name.lower())
    assert rows.get_attr("task") == (env.task,)
    earlier = [load_env_creator(f"calfree_gym.envs.{entry}") for entry in EARLIER[name]]
    assert earlier == [type(env), type(rows)]


def test_modules_of_earlier_versions_say_where_they_are_now():
    with pytest.warns(DeprecationWarning, match=r"calfree_gym\.envs is now calfree_gym\.tasks"):
        importlib.reload(importlib.import_module("calfree_gym.envs"))
