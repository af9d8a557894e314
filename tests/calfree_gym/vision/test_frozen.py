"""Cameras that deliver an old image again, on images with noise of their own."""

import warnings
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from calfree_gym.vision import GraspTracker, StereoTracker, TagTracker
from tests.calfree_gym.environments import kinematic
from tests.calfree_gym.vision.drawings import background
from tests.calfree_gym.vision.printed_tags import random_frame
from tests.calfree_gym.vision.test_grasp_tracker import LAYOUT, LEFT, RIGHT, drawn
from tests.calfree_gym.vision.test_tracker import HERE, plain


def noisy(image, seed):
    """An image as a live camera delivers it."""
    return image + np.random.default_rng(seed).integers(0, 2, image.shape, np.uint8)


BALLS = StereoTracker, plain(HERE), plain(HERE)
GRIPPER = partial(GraspTracker, layout=LAYOUT), drawn(**LEFT), drawn(**RIGHT)
TAGS = TagTracker, *(random_frame(np.random.default_rng([4, i]), background)[0] for i in range(2))


@pytest.fixture(params=[BALLS, GRIPPER, TAGS], ids=["balls", "gripper", "tags"])
def case(request):
    """A tracker, and what the left and the right camera look at."""
    tracker, *scenes = request.param
    return tracker(), *scenes


@pytest.mark.parametrize("camera", [0, 1])
def test_a_frozen_camera_sees_nothing_until_its_image_is_another_and_warns_once(case, camera):
    tracker, *scenes = case

    def look(seed, moved):
        images = [noisy(scene, seed + i) for i, scene in enumerate(scenes)]
        images[camera] = old
        points, seen = tracker(*images, moved=moved)
        return points, seen.reshape(-1, 2).T

    for freeze in (0, 100):  # it lives again in between
        old = noisy(scenes[camera], freeze)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            _, seen = look(freeze + 10, moved=True)
            before, seen_again = look(freeze + 20, moved=False)
        assert seen.all()
        assert seen_again.all()
        with pytest.warns(UserWarning, match=f"the {('left', 'right')[camera]} camera has frozen"):
            points, seen = look(freeze + 30, moved=True)
        assert not seen[camera].any()
        assert seen[1 - camera].all()
        np.testing.assert_array_equal(points[camera::2], before[camera::2])
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert tracker.copy()(*scenes, moved=True)[1].all(), "a copy goes on by itself"
            tracker.reset()
            for moved in (True, False):
                assert not look(freeze + 40, moved)[1][camera].any()


def test_a_camera_that_writes_into_the_same_array_has_not_frozen(case):
    tracker, left, right = case
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for seed in range(3):
            left[:] = noisy(left, seed)
            assert tracker(left, noisy(right, seed), moved=True)[1].all()


def test_simulated_images_without_noise_may_be_the_same(opengl):
    """Here of an arm at its stop, on a mount that turns with it."""
    env = kinematic(world="nominal", observation="vision")
    env.reset(seed=0)
    env.unwrapped.set_world(replace(env.unwrapped.world, image_noise=np.zeros(2)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for _ in range(3):
            observation, *_ = env.step(np.array([1, 0, 0], np.float32))
            assert observation["observation"][:2].all()
    env.close()
