"""What is asked in reaching: a rendezvous needs all points to be seen."""

import gymnasium as gym
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from calfree_gym.engine.spaces import image_distances
from calfree_gym.tasks.reach import kept_apart, rendezvous

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
    """As the environment judges it, in single precision; gripper points lie near those of the objects."""
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


def test_a_rendezvous_takes_points_that_are_seen_without_occlusion_too():
    """Points that were never seen stand in the middle of the image: not a rendezvous, though they meet."""
    dropout = {"at": {"trial": 0}, "do": {"type": "point_dropout", "share": 0.8}}
    env = gym.make("CalFree/Reach-v0", camera_mount="stand", dynamics="kinematic", perturbations=[dropout])
    met = 0
    env.action_space.seed(0)
    for seed in range(60):
        observation, info = env.reset(seed=seed)
        met += info["is_success"]
        for _ in range(2):
            observation, reward, terminated, _, info = env.step(env.action_space.sample())
            seen = observation["observation"][:4] > 0.5
            assert seen.all() or not (terminated or info["is_success"] or reward == 0)
            if terminated:
                break
    assert not met
