"""The batched environment against single ones, bit by bit."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import calfree_gym
from calfree_gym import nominal

ID = "CalFree/Reach-v0"
ROWS, STEPS = 5, 14
SCHEDULE = [
    {"at": {"motion": 4}, "do": {"type": "camera_roll"}},
    {"at": {"trial": 2}, "do": {"type": "motor_gain"}},
    {"at": {"every": {"motion": 5}}, "do": {"type": "joint_zero"}},
]


def words():
    return np.random.default_rng(1).uniform(-0.15, 0.15, (STEPS, ROWS, 3)).astype(np.float32)


def singles(**arguments):
    """What single environments with seeds 10, 11, ... give, stacked; reset a step after they ended."""
    keys = ("achieved_goal", "desired_goal", "observation", "reward", "terminated", "truncated", "error_px")
    of_info = ("is_success", "robot_seconds", "perturbed")
    out = {key: [] for key in (*keys, *of_info, "applied")}
    for row in range(ROWS):
        env = gym.make("CalFree/Reach-v0", max_episode_steps=6, disable_env_checker=True, **arguments)
        observation, info = env.reset(seed=10 + row)
        series, over = [], False
        series.append((observation, 0.0, False, False, info))
        applied = [repr(env.unwrapped.applied)]
        for word in words()[:, row]:
            if over:
                observation, info = env.reset()
                series.append((observation, 0.0, False, False, info))
            else:
                series.append(env.step(word))
            applied.append(repr(env.unwrapped.applied))
            over = series[-1][2] or series[-1][3]
        for key in keys[:3]:
            out[key].append([s[0][key] for s in series])
        for i, key in enumerate(keys[3:6], 1):
            out[key].append([s[i] for s in series])
        out["error_px"].append([s[4]["truth"]["error_px"] for s in series])
        for key in of_info:
            out[key].append([s[4][key] for s in series])
        out["applied"].append(applied)
    return {key: np.array(value) for key, value in out.items()}


def batched(threads, **arguments):
    env = gym.make_vec(
        "CalFree/Reach-v0", num_envs=ROWS, threads=threads, vector_kwargs={}, max_episode_steps=6, **arguments
    )
    observation, infos = env.reset(seed=10)
    series = [(observation, np.zeros(ROWS), np.zeros(ROWS, bool), np.zeros(ROWS, bool), infos)]
    applied = [[repr(of_row) for of_row in env.unwrapped.applied]]
    for word in words():
        series.append(env.step(word))
        applied.append([repr(of_row) for of_row in env.unwrapped.applied])
    out = {key: np.array([s[0][key] for s in series]).swapaxes(0, 1) for key in observation}
    for i, key in enumerate(("reward", "terminated", "truncated"), 1):
        out[key] = np.array([s[i] for s in series]).T
    out["error_px"] = np.array([s[4]["truth"]["error_px"] for s in series]).T
    for key in ("is_success", "robot_seconds", "perturbed"):
        out[key] = np.array([s[4][key] for s in series]).T
    out["applied"] = np.array(applied).T
    return out


@pytest.mark.parametrize("perturbations", [None, SCHEDULE], ids=["quiet", "perturbed"])
@pytest.mark.parametrize("dynamics", ["physics", "kinematic"])
@pytest.mark.parametrize("mount", calfree_gym.MOUNTS)
def test_rows_are_bit_identical_to_single_environments_on_any_number_of_threads(
    mount, dynamics, perturbations
):
    arguments = {
        "camera_mount": mount,
        "dynamics": dynamics,
        "tolerance_px": 70.0,
        "perturbations": perturbations,
    }
    alone, one, two = singles(**arguments), batched(1, **arguments), batched(2, **arguments)
    assert alone["truncated"].any()
    assert alone["terminated"].any()
    for key, value in alone.items():
        np.testing.assert_array_equal(one[key], value, err_msg=key)
        np.testing.assert_array_equal(two[key], value, err_msg=key)


def test_many_rows_change_no_row():
    few = gym.make_vec("CalFree/Reach-v0", num_envs=3, dynamics="kinematic")
    many = gym.make_vec("CalFree/Reach-v0", num_envs=67, dynamics="kinematic")
    few.reset(seed=0)
    many.reset(seed=0)
    for word in words()[:, 0]:
        a, *_ = few.step(np.tile(word, (3, 1)))
        b, *_ = many.step(np.tile(word, (67, 1)))
        for key, value in a.items():
            np.testing.assert_array_equal(value, b[key][:3])


def test_worlds_may_differ_by_row():
    env = gym.make_vec("CalFree/Reach-v0", num_envs=2, world=["nominal", "wild"])
    env.reset(seed=0)
    assert env.unwrapped.worlds[0] == calfree_gym.nominal()
    env.unwrapped.set_world(calfree_gym.nominal(), row=1)
    assert env.unwrapped.worlds[1] == calfree_gym.nominal()
    env = gym.make_vec("CalFree/Reach-v0", num_envs=2)
    env.unwrapped.set_world(calfree_gym.nominal(), row=1)
    env.reset(seed=[5, None])
    assert env.unwrapped.worlds[1] == calfree_gym.nominal()
    with pytest.raises(ValueError, match="list of 3; it must have 2"):
        gym.make_vec("CalFree/Reach-v0", num_envs=2, world=["wild"] * 3)


def test_trials_may_go_on_without_limit_as_single_ones_may():
    arguments = {"max_episode_steps": -1, "terminate_on_success": False, "dynamics": "kinematic"}
    for env in (
        gym.make_vec("CalFree/Reach-v0", num_envs=2, **arguments),
        gym.make("CalFree/Reach-v0", **arguments),
    ):
        env.reset(seed=0)
        still = np.zeros(env.action_space.shape, np.float32)
        assert not any(np.any(env.step(still)[3]) for _ in range(62)), "60 is the usual limit"


@pytest.mark.parametrize("task", ["Reach", "SafeReach", "Grasp", "Insert"])
def test_limits_of_trials_are_checked_in_every_task(task):
    gym.make_vec(f"CalFree/{task}-v0", num_envs=2, max_episode_steps=-1)
    for wrong in (0, -2):
        with pytest.raises(ValueError, match=rf"is {wrong}; it must be .* from 1 to \d+, or -1: no limit"):
            gym.make_vec(f"CalFree/{task}-v0", num_envs=2, max_episode_steps=wrong)
        with pytest.raises(ValueError, match=f"`max_episode_steps` to be positive, actually: {wrong}"):
            gym.make(f"CalFree/{task}-v0", max_episode_steps=wrong)


def test_bad_actions_and_seeds():
    env = gym.make_vec("CalFree/Reach-v0", num_envs=2)
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros((2, 3)))
    with pytest.raises(ValueError, match="max_episode_steps is 0"):
        gym.make_vec("CalFree/Reach-v0", num_envs=2, max_episode_steps=0)
    for name, wrong in (("num_envs", 1.5), ("max_episode_steps", "a"), ("threads", -1)):
        with pytest.raises(ValueError, match=f"{name} is {wrong!r}; it must be a whole number from"):
            gym.make_vec("CalFree/Reach-v0", **{"num_envs": 2, name: wrong})
    with pytest.raises(ValueError, match=r"'NextSte' .did you mean NextStep..; allowed: .*SameStep"):
        gym.make_vec("CalFree/Reach-v0", num_envs=2, autoreset_mode="NextSte")
    with pytest.raises(ValueError, match="3 entries; it must have 2"):
        env.reset(seed=[1, 2, 3])
    for wrong, name in (
        (-1, "seed"),
        (1.5, "seed"),
        (True, "seed"),
        ([0, -1], r"seed\[1\]"),
        ([1.5, 2], r"seed\[0\]"),
    ):
        with pytest.raises(ValueError, match=f"^{name} is .*; it must be a whole number"):
            env.reset(seed=wrong)
    assert env.unwrapped.arms.needs_seed(0)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"shape \(3,\); it must be \(2, 3\)"):
        env.step(np.zeros(3))
    words = np.zeros((2, 3))
    words[1, 2] = np.nan
    with pytest.raises(ValueError, match=r"the action at \(1, 2\) is nan; .* finite"):
        env.step(words)


def test_same_step_autoreset_gives_the_last_observation_and_the_next_first_one():
    arguments = {"num_envs": 3, "max_episode_steps": 4, "dynamics": "kinematic"}
    after = gym.make_vec("CalFree/Reach-v0", **arguments)
    at_once = gym.make_vec("CalFree/Reach-v0", autoreset_mode="SameStep", **arguments)
    assert at_once.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert after.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    after.reset(seed=0)
    at_once.reset(seed=0)
    ended = 0
    for _ in range(9):
        word = np.full((3, 3), 0.05)
        last, *_, truncated, _ = after.step(word)
        first, *_, also_truncated, infos = at_once.step(word)
        np.testing.assert_array_equal(truncated, also_truncated)
        if truncated.all():
            ended += 1
            for key, value in last.items():
                np.testing.assert_array_equal(infos["final_obs"][key], value)
            np.testing.assert_array_equal(infos["_final_obs"], True)
            last, *_ = after.step(word)
        for key, value in last.items():
            np.testing.assert_array_equal(first[key], value)
    assert ended == 2


def test_without_autoreset_rows_wait_for_a_masked_reset():
    env = gym.make_vec(
        "CalFree/Reach-v0",
        num_envs=3,
        max_episode_steps=4,
        autoreset_mode=AutoresetMode.DISABLED,
        dynamics="kinematic",
    )
    env.reset(seed=0)
    env.step(np.full((3, 3), 0.05))
    before, *_ = env.step(np.full((3, 3), 0.05))
    mask = np.array([False, True, False])
    observation, _ = env.reset(options={"reset_mask": mask})
    np.testing.assert_array_equal(observation["observation"][1, 4:], 0)
    for key, value in before.items():
        np.testing.assert_array_equal(observation[key][~mask], value[~mask])
    for _ in range(2):
        *_, truncated, _ = env.step(np.full((3, 3), 0.05))
    np.testing.assert_array_equal(truncated, ~mask)
    with pytest.raises(gym.error.ResetNeeded, match=r"rows \[0, 2\] are over"):
        env.step(np.zeros((3, 3)))
    env.reset(options={"reset_mask": ~mask})
    env.step(np.zeros((3, 3)))
    for wrong in ([True, False, True], np.array([True]), np.zeros(3, bool)):
        with pytest.raises(ValueError, match="reset_mask"):
            env.reset(options={"reset_mask": wrong})


def test_same_step_infos_count_perturbations_of_rows_that_are_not_over():
    every = [{"every": {"motion": 1}, "do": {"type": "camera_roll", "camera": "left", "degrees": 0.1}}]
    env = gym.make_vec(
        ID, num_envs=2, world=nominal(), dynamics="kinematic", autoreset_mode="SameStep", perturbations=every
    )
    env.reset(seed=[0, 1])
    env.step(np.zeros((2, 3)))
    env.unwrapped._max_episode_steps = np.array([2, 60])
    *_, infos = env.step(np.zeros((2, 3)))
    np.testing.assert_array_equal(infos["perturbed"], [0, 1])
    np.testing.assert_array_equal(infos["final_info"]["perturbed"], [1, 1])


def test_rows_and_options_that_are_none_are_named():
    env = gym.make_vec(ID, num_envs=2, dynamics="kinematic")
    for options in ("abc", [("object", (0.4, 0.0, 0.1))]):
        with pytest.raises(ValueError, match="must be a dict"):
            env.reset(options=options)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="row is 7"):
        env.unwrapped.set_world(nominal(), row=7)
