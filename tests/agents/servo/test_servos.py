"""The servos against the numbers asked of them, cameras rolled while they work, and what they remember."""

import numpy as np
import pytest

import agents
from agents.base import storage
from agents.servo.jacobian import ESTIMATORS
from agents.servo.redundancy import REDUNDANCIES
from tests.agents.trials import STAND_FIRST

SERVOS = [
    ("work_plane_servo", {}),
    ("paper_servo", {}),
    ("unified_servo", {}),
    *[("jacobian_servo", {"estimator": name}) for name in ESTIMATORS],
]


WORK_PLANE = ("work_plane_servo", {}, range(1000, 1500), {"dynamics": "physics"})
JOINTS = {"tell": ("joint_angles",)}
FIFTY = {"max_episode_steps": 50}
REACH = [
    *[("paper_servo", {"redundancy": each}, range(40), FIFTY, 0.97, 14, 5) for each in REDUNDANCIES],
    ("unified_servo", {}, range(40), FIFTY, 0.97, 8, 6),
    *[("jacobian_servo", {"estimator": each}, range(16), {}, 0.93, 10, np.inf) for each in ESTIMATORS],
    ("joint_space_servo", {}, range(3020, 3035), JOINTS, 1, 16, np.inf),
    pytest.param(
        "joint_space_servo", {}, range(3100, 3300), JOINTS, 0.99, 12, np.inf, marks=pytest.mark.slow
    ),
    *[("work_plane_servo", {"camera": each}, range(50), {}, 0.98, 16, np.inf) for each in ("left", "right")],
    pytest.param(*WORK_PLANE, 0.99, 16, np.inf, marks=pytest.mark.slow),
    ("self_calibrating", {}, range(3020, 3035), {}, 0.93, 9, np.inf),
    ("recurrent_servo", {}, range(1000, 1008), {}, 1, 8, np.inf),
]
"""Worlds (none seen in training), the share in which they reach, and medians of motions and millimetres."""


@pytest.mark.parametrize(("name", "settings", "worlds", "options", "least", "most_motions", "most_mm"), REACH)
@pytest.mark.parametrize("mount", STAND_FIRST)
def test_they_reach_in_wild_worlds(
    reach, mount, name, settings, worlds, options, least, most_motions, most_mm
):
    settings = {"camera_mount": mount} if name == "self_calibrating" else settings
    share, motions, off_mm = reach(name, worlds, mount, options, **settings)
    assert share >= least
    assert motions <= most_motions
    assert off_mm <= most_mm


@pytest.mark.parametrize(
    ("worlds", "least"), [(range(16), 0.93), pytest.param(range(1000, 1200), 0.97, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize(("name", "settings"), SERVOS)
@pytest.mark.parametrize("mount", STAND_FIRST)
def test_a_camera_rolled_in_mid_trial_is_tolerated(reach, name, settings, mount, worlds, least):
    rng, reached = np.random.default_rng(0), []
    for seed in worlds:
        roll = [{"at": {"motion": int(rng.integers(1, 6))}, "do": {"type": "camera_roll"}}]
        reached.append(reach(name, [seed], mount, {"perturbations": roll}, **settings)[0])
    assert np.mean(reached) >= least


LASTING = [servo for servo in SERVOS if servo[0] in ("unified_servo", "jacobian_servo")]


@pytest.mark.parametrize(("name", "settings"), LASTING)
@pytest.mark.parametrize("mount", STAND_FIRST)
def test_what_the_last_trial_knew_of_the_jacobian_shortens_the_next(live, make_env, name, settings, mount):
    lengths = np.array([live(name, make_env(mount), seed, trials=4, **settings)[1] for seed in range(8)])
    assert lengths[:, 1:].mean() <= 0.75 * lengths[:, 0].mean()


@pytest.mark.parametrize(("name", "settings"), LASTING)
def test_the_jacobian_is_saved_and_loaded_and_used(live, make_env, name, settings, tmp_path):
    agent, _ = live(name, make_env(), 3, trials=2, **settings)
    agent.save(tmp_path / "servo.npz")
    env = make_env(world=agent.env.unwrapped.world)
    again = agents.make(name, env, **settings).load(tmp_path / "servo.npz")
    fresh = agents.make(name, env, **settings)
    np.testing.assert_array_equal(again.slopes.jacobian, agent.slopes.jacobian)
    observation, _ = env.reset(seed=5)
    np.testing.assert_array_equal(again.predict(observation)[0], agent.predict(observation)[0])
    size = np.abs(again.predict(observation)[0]).max()  # of a step, and without knowledge of a test
    assert np.abs(fresh.predict(observation)[0]).max() < size / 2
    again.slopes = again.slopes._replace(registers=np.array([0.1, -0.2, 0.3]))
    again.save(tmp_path / "servo.npz")
    found = fresh.load(tmp_path / "servo.npz").slopes.registers
    np.testing.assert_array_equal(found, [0.1, -0.2, 0.3], "over other procedures it does not begin at home")


def test_slopes_that_no_life_leaves_are_refused(live, make_env, tmp_path):
    agent, _ = live("unified_servo", make_env(), 3, trials=2)
    kept = agent.arrays()
    for name, bad, said in (
        ("jacobian", np.full((8, 3), 2.0**62), "4\\.61169e\\+18; allowed: .* at most 1e\\+06"),
        ("slope_registers", np.full(3, 1e300), "1e\\+300; allowed"),
        ("slope_variances", -np.abs(kept["slope_variances"]) - 1, "are no covariances"),
        ("slope_variances", kept["slope_variances"] + np.arange(3), "are no covariances"),
        ("slope_changes", -kept["slope_changes"] - 1, "allowed: numbers, 0 or more, at most"),
        ("slope_trials", np.array([1e300]), "allowed: whole numbers, 0 or more, at most"),
        ("slope_trials", np.array([1.5]), "1.5; allowed: whole numbers"),
        ("smooth_lengths", np.zeros((2, 3)), "0; allowed: numbers, above 0, at most"),
        ("smooth_looks", np.zeros(2), "0; allowed: numbers, above 0, at most"),
    ):
        storage.save(tmp_path / "bad.npz", agent.kind, kept | {name: bad}, 80, 3)
        with pytest.raises(ValueError, match=f"damaged: the saved {name} .*{said}"):
            agent.load(tmp_path / "bad.npz")
