"""What cannot be is named before anything happens: arguments, objects, words and seeds, in every task."""

import gymnasium as gym
import numpy as np
import pytest

from calfree_gym import nominal
from tests.calfree_gym.environments import TASKS, begun, kinematic, make

AWAY = nominal().to_dict() | {
    "camera_orientation": nominal().camera_orientation[:, [1, 0, 3, 2]] * [-1, 1, -1, 1]
}
GRASP, INSERT, SAFE = ({"task": task} for task in ("Grasp", "Insert", "SafeReach"))
ANY = {**GRASP, "orientation": "any"}
SPHERE = {"shape": "sphere"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"world": "wlid"}, "'wlid'.*did you mean wild.*nominal, coarse, wild, rough"),
        ({"world": 3}, "unknown world 3"),
        ({"world": {"focal_length": [300, 300]}}, "a World lacks camera_orientation"),
        ({"world": {**nominal().to_dict(), "focus": 1}}, "a World has no field focus"),
        ({"world": AWAY}, "not in view on the 'waist' mount"),
        ({"camera_mount": "wrist"}, "'wrist'.*waist, stand"),
        ({"dynamics": "quick"}, "'quick'.*physics, kinematic"),
        ({"tolerance_px": 0}, "tolerance_px is 0"),
        ({"tolerance_px": "4"}, "tolerance_px is '4'"),
        ({"observation": "pixel"}, r"observation is 'pixel' \(did you mean pixels\?\)"),
        ({"image_size": 8}, "image_size is 8; it must be a whole number from 16 to 1024"),
        ({"occlusion": 1}, "occlusion is 1; allowed: True, False"),
        ({"render_mode": "humans"}, "'humans'.*human"),
        ({"width": 100.5}, "width is 100.5; it must be a whole number from 120 to 4096"),
        ({"width": 300, "height": 400}, "width is 300 and height 400; height must be even, and width at"),
        ({"truth": 1}, "truth is 1; allowed: True, False"),
        ({"tell": 3}, "tell is 3; it must be a sequence of names, such as"),
        ({"tell": "joint_angles"}, "sequence of names"),
        ({"tell": ("joint_angels",)}, "'joint_angels'.*joint_angles"),
        ({"redraw": "always"}, "redraw is 'always'.*never, trial"),
        ({"redraw": "trial", "world": nominal()}, "must be a distribution"),
        ({"perturbations": {"at": 3}}, "must be a list"),
        ({"perturbations": [{"at": {"motoin": 3}, "do": {"type": "camera_roll"}}]}, "did you mean motion"),
        ({"rows": 2, "world": ["wild"] * 3}, "list of 3; it must have 2"),
        ({"rows": 1.5}, "num_envs is 1.5; it must be a whole number from"),
        ({"rows": 2, "max_episode_steps": "a"}, "max_episode_steps is 'a'; it must be a whole number from"),
        ({"rows": 2, "threads": -1}, "threads is -1; it must be a whole number from"),
        (
            {"rows": 2, "autoreset_mode": "NextSte"},
            r"'NextSte' .did you mean NextStep..; allowed: .*SameStep",
        ),
        (GRASP | {"shape": "cilinder"}, r"shape is 'cilinder' \(did you mean cylinder\?\)"),
        (GRASP | {"shape": SPHERE}, "a sphere has .*; it must have radius, in m"),
        (GRASP | {"shape": SPHERE | {"radius": 0.05}}, "0.100 m wide, too large for the jaws"),
        (GRASP | {"shape": SPHERE | {"radius": 0.001}}, "radius is 0.001; it must be a number from"),
        (GRASP | {"shape": {"radius": 0.02}}, "a mapping has `shape`"),
        (GRASP | {"redraw": "always"}, "redraw is 'always'"),
        (GRASP | {"orientation": "upside_down"}, "orientation.*upside_down.*lying, any"),
        (ANY | {"observation": "vision"}, "observed by 'points' alone; found 'vision'"),
        (INSERT | {"clearance": 0}, r"clearance is 0; it must be a number from 0.1 to 10.0, in mm"),
        (INSERT | {"clearance": "2"}, r"clearance is '2'; it must be a number"),
        (INSERT | {"clearance": float("nan")}, r"clearance is nan"),
        (INSERT | {"observation": "vision"}, r"observation is 'vision'; allowed: points"),
        (SAFE | {"force_bound": 0}, "force_bound is 0; it must be a positive number, in N"),
        (SAFE | {"force_bound": "65 N"}, "force_bound is '65 N'"),
        (SAFE | {"gains": (2.0, 1.0)}, "gains is .*; it must be two positive numbers, the lesser first"),
        (SAFE | {"gains": 3.0}, "gains is 3.0"),
        (SAFE | {"gains": (0.0, 1.0)}, "gains is"),
    ],
)
def test_arguments(arguments, message):
    with pytest.raises(ValueError, match=message):
        make(**arguments)


@pytest.mark.parametrize("rows", [None, 2])
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"wrold": "wild"},
            r"'wrold' .did you mean world.*; allowed: .*world, arm, camera_mount, .*render_mode",
        ),
        ({"tolerance": "wild"}, r"'tolerance' .did you mean tolerance_px"),
        ({"zzz": "wild"}, r"got an unexpected keyword argument 'zzz'; allowed: "),
        (SAFE | {"force_bond": 3.0}, "did you mean force_bound"),
        (INSERT | {"reward": "dense"}, "unexpected keyword argument 'reward'"),
    ],
)
def test_a_wrong_keyword_gets_near_misses_and_the_allowed_names(rows, arguments, message):
    with pytest.raises(TypeError, match=message):
        make(rows=rows, **arguments)


@pytest.mark.parametrize("task", TASKS)
def test_limits_of_trials(task):
    make(task, rows=2, max_episode_steps=-1)
    for wrong in (0, -2):
        with pytest.raises(ValueError, match=rf"is {wrong}; it must be .* from 1 to \d+, or -1: no limit"):
            make(task, rows=2, max_episode_steps=wrong)
        with pytest.raises(ValueError, match=f"`max_episode_steps` to be positive, actually: {wrong}"):
            make(task, max_episode_steps=wrong)


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ({}, "object", "must be a dict"),
        ({}, {"objekt": (0.4, 0, 0.1)}, r"'objekt'.*'object'"),
        ({}, {"object": (0, 0)}, "metres"),
        ({}, {"object": "here"}, "'here'"),
        ({}, {"object": (4, 0, 0.1)}, r"object at \[4.0, 0.0, 0.1\] is 3.58 m from .*; .* within 2.00 m"),
        ({"rows": 2}, {"object": [(0.4, 0, 0.1), (0.4, 9, 0.1)]}, r"object at \[0.4, 9.0, 0.1\]"),
        ({"rows": 3}, {"reset_mask": [True, False, True]}, "reset_mask"),
        ({"rows": 3}, {"reset_mask": np.array([True])}, "reset_mask"),
        ({"rows": 3}, {"reset_mask": np.zeros(3, bool)}, "reset_mask"),
        (GRASP, {"object": (0.1, 0.0)}, "inside the arm"),
        (GRASP, {"object": (0.9, 0.0)}, "out of reach"),
        (GRASP, {"object": "there"}, r"it must be \(x, y\) or \(x, y, angle\)"),
        (GRASP, {"object": (0.4, np.nan)}, "it must be"),
        (ANY, {"object": (0.4, 0.0)}, r"must be \(x, y, z, qw, qx, qy, qz\)"),
        (ANY, {"object": (0.4, 0.0, 0.1, 2.0, 0, 0, 0)}, "quaternion has length 2.000"),
        (ANY, {"object": (0.4, 0.0, -0.1, 1, 0, 0, 0)}, "is where no thing is held: they are 0.3 to 0.5 m"),
        (INSERT, {"object": (0.9, 0.0, 0.1)}, r"the hole at \[0.9, 0.0, 0.1\] is out of reach.*0.3 to 0.5 m"),
        (INSERT, {"hole": (0.4, 0.0, 0.1)}, "allowed: 'object'"),
    ],
)
def test_options(arguments, options, message):
    env = make(camera_mount="stand", **arguments)
    with pytest.raises(ValueError, match=message):
        env.reset(seed=14, options=options)


@pytest.mark.parametrize(
    ("arguments", "words", "message"),
    [
        ({}, np.zeros(2), r"shape \(2,\).*\(3,\)"),
        ({}, np.zeros((1, 3)), r"shape \(1, 3\)"),
        ({}, np.array([0, np.nan, 0]), "finite"),
        ({}, np.array([0, np.inf, 0]), "finite"),
        ({}, "abc", "'abc'; it must be numbers"),
        ({"rows": 2}, np.zeros(3), r"shape \(3,\); it must be \(2, 3\)"),
        ({"rows": 2}, [[0, 0, 0], [0, 0, np.nan]], r"the action at \(1, 2\) is nan; .* finite"),
        (GRASP, np.zeros(3), r"shape \(3,\); it must be \(5,\)"),
        (INSERT, np.zeros(5), r"shape \(5,\); it must be \(4,\)"),
    ],
)
def test_words(arguments, words, message):
    env = begun(make(world="nominal", **arguments))
    with pytest.raises(ValueError, match=message):
        env.step(words)


@pytest.mark.parametrize(
    ("seed", "message"),
    [
        (-1, "^seed is -1; it must be a whole number"),
        (1.5, "^seed is 1.5; it must be a whole number"),
        (True, "^seed is True; it must be a whole number"),
        ([0, -1], r"^seed\[1\] is -1; it must be a whole number"),
        ([1.5, 2], r"^seed\[0\] is 1.5; it must be a whole number"),
        ([1, 2, 3], "3 entries; it must have 2"),
    ],
)
def test_seeds(seed, message):
    envs = kinematic(rows=2)
    with pytest.raises(ValueError, match=message):
        envs.reset(seed=seed)
    assert envs.unwrapped.arms.needs_seed(0)


def test_worlds_that_are_set():
    env = begun(kinematic().unwrapped)
    with pytest.raises(ValueError, match="not in view on the 'waist' mount"):
        env.set_world(type(nominal()).from_dict(AWAY))
    with pytest.raises(TypeError, match="str"):
        env.set_world("wild")
    with pytest.raises(ValueError, match="row is 7"):
        kinematic(rows=2).unwrapped.set_world(nominal(), row=7)


def test_before_the_first_reset():
    env, envs = make().unwrapped, make(rows=2)
    steps = lambda: env.step(np.zeros(3)), lambda: envs.step(np.zeros((2, 3)))
    for forbidden in (lambda: env.world, *steps, env.get_state, envs.unwrapped.get_state):
        with pytest.raises(gym.error.ResetNeeded, match=r"reset\(\)"):
            forbidden()


def test_what_is_far_or_of_numpy_is_allowed():
    env = kinematic(tolerance_px=np.int64(5))
    assert env.unwrapped.tolerance_px == 5.0
    env.reset(options={"object": (-0.6, 0, 0.1)})  # never reached, but not absurd
